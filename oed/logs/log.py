"""What a robot logged: its wheels' motion and reference poses, each on a clock of its own."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from oed.foundation.arrays import Array, Bools
from oed.foundation.equality import ByValue
from oed.foundation.presenting import Card, Presented, dataframe, given
from oed.foundation.text import given_text
from oed.logs.motions import Motions

BRIDGED = 10.0
"""Longest time without poses through which the wheels carry a segment on [s]. A robot lost for longer may
have been carried elsewhere, and a new start costs little."""


@dataclass(frozen=True)
class Finding:
    """One thing about a log that the reader of its estimates should know.

    Attributes:
        name: short and fixed, e.g. "gap", "stationary_start", "clock_offset".
        message: a sentence with the place and the size.
        doubtful: whether it casts doubt on the estimates (else it is only noted).
    """

    name: str
    message: str
    doubtful: bool = False


@dataclass(frozen=True)
class SensorReadings:
    """What one sensor of the study read during a drive, at times of its own.

    Attributes:
        sensor: its name, as `log: sensors:` has it.
        times: (m,) [s], rising.
        values: (m, q), SI; not-a-number where an entry was not read.
        clock: whose clock the times are on.
    """

    sensor: str
    times: Array
    values: Array
    clock: Literal["inputs", "poses"]

    def on(self, clock: Literal["inputs", "poses"], offset: float) -> Array:
        """The times on a clock, where the inputs' shows `offset` [s] when the poses' shows 0."""
        if clock == self.clock:
            return self.times
        return self.times + (offset if clock == "inputs" else -offset)

    def integrals_at(self, times: Array) -> Array:
        """Time integrals of the values at times on the readings' own clock, (len(times), q)."""
        steps = np.diff(self.times)[:, None]
        sums = np.cumsum((self.values[:-1] + self.values[1:]) / 2 * steps, axis=0)
        columns = np.vstack([np.zeros((1, self.values.shape[1])), sums]).T
        return np.column_stack([np.interp(times, self.times, column) for column in columns])


@dataclass(frozen=True, repr=False, eq=False)
class Log(ByValue, Presented):
    """One drive as it was logged. Times rise, numbers are finite, all SI.

    Attributes:
        name: of the drive, shown in tables.
        file: it was read from.
        input_times: (n,) [s], on the clock of the inputs.
        integrals: time integral of each of the robot's inputs since the first of these times, (n, inputs):
            of a wheel's speed the angle it has turned [rad], of a steering angle [rad s].
        pose_times: (m,) [s], on the clock of the poses.
        poses: (m, quantities).
        quantities: which of the robot's states they are, "x", "y", "heading", ...; headings are unwrapped.
        findings: what was found while reading.
        gap: longer steps of either clock are gaps that no segment goes on through [s]. If None, five usual
            steps of the inputs' clock, and `BRIDGED` of the poses'.
        averaged: how many of the sensor's poses each pose is the mean of.
        breaks: times between poses at which every segment ends [s].
        motions: what was read, where that is how the sensor moved; the poses are then the path that these
            make up.
        sensors: what other sensors of the study read. A log without poses has their times as `pose_times`.
    """

    name: str
    file: str
    input_times: Array
    integrals: Array
    pose_times: Array
    poses: Array
    quantities: tuple[str, ...] = ("x", "y", "heading")
    findings: tuple[Finding, ...] = ()
    gap: float | None = None
    averaged: int = 1
    breaks: tuple[float, ...] = ()
    motions: Motions | None = None
    sensors: tuple[SensorReadings, ...] = ()

    @property
    def duration(self) -> float:
        """From the first pose to the last [s]."""
        return float(self.pose_times[-1] - self.pose_times[0])

    def inputs_between(self, edges: Array, offset: float = 0.0) -> Array:
        """Mean inputs (len(edges) - 1, inputs) between successive times on the poses' clock.

        Wheel motion is integrated, not sampled: the means times the periods add up to the angles turned.

        Args:
            edges: rising times [s].
            offset: what the inputs' clock shows when the poses' clock shows 0 [s].
        """
        turned = self.integrals_at(edges, offset)
        return np.asarray(np.diff(turned, axis=0) / np.diff(edges)[:, None])

    def integrals_at(self, times: Array, offset: float = 0.0) -> Array:
        """The integrals at times on the poses' clock, (len(times), inputs); held outside of the log."""
        moments = np.asarray(times) + offset
        # Of a long log only the rows around these times: a look at all of them for each of its parts is long.
        clock = self.input_times
        first = np.searchsorted(clock, moments.min(initial=clock[-1]), side="right") - 1
        last = np.searchsorted(clock, moments.max(initial=clock[0])) + 1
        rows = slice(max(0, min(int(first), int(last) - 1)), int(last))
        return np.column_stack([np.interp(moments, clock[rows], column) for column in self.integrals[rows].T])

    def to_dataframe(self, what: Literal["poses", "inputs"] = "poses") -> Any:
        """A pandas DataFrame of the poses, or of the inputs' time integrals, on its own clock `t` [s]; SI.

        Raises:
            ValueError: neither of these.
            UserMistake: pandas is not installed.
        """
        if what == "poses":
            return dataframe({"t": self.pose_times, **dict(zip(self.quantities, self.poses.T, strict=True))})
        if what == "inputs":
            names = (f"integral_{place + 1}" for place in range(self.integrals.shape[1]))
            return dataframe({"t": self.input_times, **dict(zip(names, self.integrals.T, strict=True))})
        raise ValueError(f"what: expected poses or inputs, got {what!r}")

    def _card(self) -> Card:
        width = self.integrals.shape[1]
        facts = given(
            ("file", self.file),
            ("inputs", f"{width}, {len(self.input_times)} readings"),
            (
                "poses",
                f"{len(self.pose_times)} of {', '.join(self.quantities)}" if self.quantities else "none",
            ),
            *((one.sensor, f"{len(one.times)} readings") for one in self.sensors),
            ("in doubt", " ".join(one.message for one in self.findings if one.doubtful)),
        )
        rows = tuple((one.name, one.message) for one in self.findings)
        return Card(f"Log {self.name}: {given_text(self.duration, 's')}", facts, ("found", "what"), rows)

    def following(self, chosen: Bools) -> Log:
        """With the path that some of the motions make up, the others left out of it alone."""
        assert self.motions is not None
        path = self.motions.rows(chosen).path()
        motions = replace(self.motions, begins=path.begins)
        return replace(self, pose_times=path.times, poses=path.poses, motions=motions)

    def found(self, name: str, message: str, *, doubtful: bool = False) -> Log:
        """The log with one finding more.

        Args:
            name: of the finding, short and fixed.
            message: a sentence.
            doubtful: whether it casts doubt on the estimates.
        """
        return replace(self, findings=(*self.findings, Finding(name, message, doubtful)))
