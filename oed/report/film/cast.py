"""What a film shows: drives, run by run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from oed.foundation.arrays import Array
from oed.records.stored.result import Result
from oed.report.parts.reading import heading
from oed.robots.models.arcs import finer

PAUSE = 0.6
"""Rest between two runs [s of the film]."""


@dataclass(frozen=True)
class Motion:
    """A run as it is seen: so close in time that straight lines between its places look like its arcs.

    Attributes:
        times: from 0 to its duration, (n,) [s].
        poses: x, y, heading, and of a tractor its trailer's angle, at the times, (n, states) [m, m, rad].
    """

    times: Array
    poses: Array

    @property
    def duration(self) -> float:
        """How long it takes [s]."""
        return float(self.times[-1])

    def at(self, time: float) -> Array:
        """The pose at a time [s], (states,)."""
        return np.array([np.interp(time, self.times, column) for column in self.poses.T])

    def until(self, time: float) -> Array:
        """The path from the start to where the robot is at a time [s], (k, 2) [m]."""
        passed = self.poses[: int(np.searchsorted(self.times, time, side="right")), :2]
        return np.vstack([passed, self.at(time)[:2]])


def motion(poses: Array, duration: float) -> Motion:
    """The motion through poses (N + 1, states) at even times, by the arcs between them."""
    fine = finer(poses[:, : 4 if poses.shape[1] > 3 else 3])
    return Motion(np.linspace(0.0, duration, len(fine)), fine)


@dataclass(frozen=True)
class Cast:
    """A drive to be shown: its name with what is special about it, and its runs one after the other."""

    title: str
    runs: tuple[Motion, ...]

    @classmethod
    def of(cls, result: Result, title: str = "") -> Cast:
        """A result that has a drive, by its own name or a title."""
        drive = result.drive
        assert drive is not None
        duration = drive.knots[-1] / drive.runs
        return cls(heading(result, title), tuple(motion(poses, duration) for poses in drive.by_run))

    def length(self, speed: float) -> float:
        """How long the film of it plays, without the rest at its end [s]."""
        return sum(run.duration for run in self.runs) / speed + PAUSE * (len(self.runs) - 1)

    def moment(self, time: float, speed: float) -> tuple[int, float]:
        """Which run is shown at a time of the film [s], from 0, and how far it is [s of the robot]."""
        start = 0.0
        for number, run in enumerate(self.runs):
            end = start + run.duration / speed + PAUSE
            if time < end or number == len(self.runs) - 1:
                break
            start = end
        return number, min(max(0.0, time - start) * speed, run.duration)
