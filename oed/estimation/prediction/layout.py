"""Drives cut into segments: what is read at which time, and which wheel motion lies between.

Drives are logged, or designed and their readings simulated. A log's segments begin at poses of their own,
which are nuisance parameters: so that neither a sensor's frame nor what went wrong before matters. Neighbours
share the pose between them, and no motion is lost.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Literal

import numpy as np

from oed.estimation.prediction.grids import GAP as GAP
from oed.estimation.prediction.grids import grid_of, usual_of
from oed.estimation.prediction.segments import Labelled
from oed.foundation.arrays import Array, Bools, Places
from oed.foundation.errors import FileIssue, LogError
from oed.kernel.dynamics.trajectory import Trajectory
from oed.logs.log import BRIDGED, Log

READINGS_APART = 0.1
"""Share of the time between two readings of the inputs by which a part of a step may be longer: jitter."""
REMEMBERED = 3
"""Offsets of the clocks whose inputs are remembered: those of a point and of its slopes."""
FULL_TURN = 2 * np.pi
CLOCK_STEP = 1e-3
"""Step of the difference quotient by a clock's offset [s]: motion is piecewise linear in time anyway."""
BEFORE, PARTS = 5.0, 50
"""Time that is looked back on before a segment [s], and in how many periods: longer than any lag lasts."""
MOST_PARTS = 2_000_000
"""Parts of all steps together, at most: what is carried along takes some hundred bytes for each."""
JITTER = 1.1
"""Parts of a motion, in those of the usual one, up to which it is driven along with this."""
SHORTEST, FEWEST = 1.0, 8
"""Length of the shortest segments that are tried [s], and how many steps they have at least."""


@dataclass(frozen=True)
class SegmentLayout:
    """Segments of drives on grids of times, padded to equal length.

    Not every quantity is read at every time, and at some nothing is: motion is only carried through them.

    Attributes:
        logs: in order; those from one file share the offset between its two clocks. () of a designed drive.
        owner: the log of each segment, (S,).
        times: of the grid on the poses' clock, (S, n + 1) [s]; the last one repeated beyond the end.
        readings: (S, n + 1, quantities), SI, finite; of a designed drive (S, readings, 1), whenever they are
            read.
        valid: which of them there are, shaped alike.
        seconds: the length that was asked for [s]; infinite for whole logs.
        held: inputs of a designed drive, (S, n, inputs); None of logs.
        relative: whether each segment is one motion that a sensor read of itself, from its first time to its
            last, and the readings are those.
        sizes: of errors whose covariances are given, in those of a typical reading of the same kind,
            (S, 1, quantities).
        whitener: A (S, q, q) with A C A' = 1 for the correlations C of these errors at the last time.
        sensors: that read beside the poses, by their names.
        averaged: of how many readings each is the mean, shaped like them; None where each is one.
        cut_at: the clocks' offset of each log, with which readings on the inputs' clock were put on the grid.
        parts: of motions, how many equal ones each is driven in, (S,); None of other segments.
    """

    logs: tuple[Log, ...]
    owner: Places
    times: Array
    readings: Array
    valid: Bools
    seconds: float
    held: Array | None = None
    relative: bool = False
    sizes: Array | None = None
    whitener: Array | None = None
    sensors: Labelled = ()
    averaged: Array | None = None
    cut_at: tuple[float, ...] = ()
    parts: Places | None = None

    @classmethod
    def of_drive(cls, trajectory: Trajectory, readings: Array) -> SegmentLayout:
        """A designed drive, whose runs are the segments.

        Args:
            trajectory: the drive.
            readings: of each run, (runs, M), SI.
        """
        runs = trajectory.runs
        held = trajectory.inputs.reshape(runs, trajectory.samples // runs, -1)
        times = np.tile(trajectory.period * np.arange(held.shape[1] + 1), (runs, 1))
        valid = np.ones((*readings.shape, 1), dtype=bool)
        return cls((), np.arange(runs), times, readings[..., None], valid, math.inf, held)

    @property
    def count(self) -> int:
        """S."""
        return len(self.owner)

    @property
    def periods(self) -> int:
        """Of the longest segment, n."""
        return int(self.times.shape[1]) - 1

    @cached_property
    def quantities(self) -> tuple[str, ...]:
        """What is read: states of the robot, then the entries of other sensors, as `ranges[2]`."""
        return (*self.states, *(f"{name}{entry}" for name, one in self.sensors for entry in one.entries))

    @property
    def states(self) -> tuple[str, ...]:
        """Which of the robot's states are read."""
        return self.logs[0].quantities if self.logs else ()

    @cached_property
    def steps(self) -> Array:
        """Time between the grid's, 0 beyond a segment's end, (S, n) [s]."""
        return np.diff(self.times, axis=1)

    @property
    def last(self) -> Places:
        """Place of each segment's last time on its grid, (S,)."""
        return np.asarray(np.count_nonzero(self.steps > 0, axis=1))

    @cached_property
    def parts_of_steps(self) -> int:
        """Number of equal parts that each step of logs is driven in: none is longer than the time between two
        readings of the inputs, for what these do within a step is more than one arc.
        """
        usual = np.array([usual_of(log.input_times) for log in self.logs])
        if self.relative or not len(usual):
            return 1
        longest = float((self.steps / usual[self.owner][:, None]).max())
        return int(np.clip(np.ceil(longest - READINGS_APART), 1, max(1, MOST_PARTS // self.steps.size)))

    @cached_property
    def in_small_steps(self) -> SegmentLayout:
        """The grid on which the segments are driven: every step in its parts."""
        parts = self.parts_of_steps
        if parts == 1:
            return self
        within = self.times[:, :-1, None] + self.steps[..., None] * (np.arange(parts) / parts)
        times = np.concatenate([within.reshape(self.count, -1), self.times[:, -1:]], axis=1)
        return replace(self, times=times)

    @cached_property
    def in_parts(self) -> tuple[tuple[Places, SegmentLayout], ...]:
        """Motions that are driven together, which they are and a layout of their parts: those in up to twice
        as many as others, for each number of parts is a function of its own.
        """
        assert self.parts is not None
        usual, found = JITTER * float(np.median(self.parts)), list[tuple[Places, SegmentLayout]]()
        doublings = np.ceil(np.log2(self.parts / usual))
        for one in np.unique(doublings):
            rows = np.flatnonzero(doublings == one)
            count, begins, ends = self.parts[rows, None], self.times[rows, :1], self.times[rows, -1:]
            passed = np.minimum(np.arange(count.max() + 1) / count, 1.0)
            finer = replace(self, owner=self.owner[rows], times=begins + (ends - begins) * passed)
            found.append((rows, finer))
        return tuple(found)

    def read_together(self, places: Sequence[int]) -> Bools:
        """When all of some quantities are read, (S, n + 1)."""
        return np.asarray(self.valid[..., list(places)].all(axis=-1))

    def first_readings(self, place: int) -> Array:
        """What each segment reads first of a quantity, (S,), SI; 0 where it never does."""
        rows = np.arange(self.count)
        first = np.argmax(self.valid[..., place], axis=1)
        return np.where(self.valid[rows, first, place], self.readings[rows, first, place], 0.0)

    @cached_property
    def clocks(self) -> tuple[str, ...]:
        """The files, each with an offset between its clocks."""
        return tuple(dict.fromkeys(log.file for log in self.logs))

    @cached_property
    def clock(self) -> Places:
        """The clock of each segment, (S,)."""
        own = [self.clocks.index(log.file) for log in self.logs]
        return np.array(own)[self.owner]

    def inputs(self, offsets: Array) -> Array:
        """Mean inputs in the grid's steps, (S, n, inputs).

        Args:
            offsets: what the inputs' clock shows when the poses' shows 0, of each clock (clocks,) [s].
        """
        if self.held is not None:
            return self.held
        if self.cut_at and np.array_equal(offsets, self.cut_offsets):
            return self.cut_inputs
        key = offsets.tobytes()
        if key not in self._known_inputs:
            while len(self._known_inputs) >= REMEMBERED:
                del self._known_inputs[next(iter(self._known_inputs))]
            self._known_inputs[key] = self._mean_inputs(offsets)
        return self._known_inputs[key]

    @cached_property
    def _known_inputs(self) -> dict[bytes, Array]:
        # By the clocks' offsets, the last asked for.
        return {}

    def _mean_inputs(self, offsets: Array) -> Array:
        lengths, columns = self.steps[..., None], self.logs[0].integrals.shape[1]
        moves = np.zeros((self.count, self.periods, columns))
        for number, log in enumerate(self.logs):
            own = np.flatnonzero(self.owner == number)
            turned = log.integrals_at(self.times[own].ravel(), offsets[self.clocks.index(log.file)])
            moves[own] = np.diff(turned.reshape(*self.times[own].shape, columns), axis=1)
        found = np.divide(moves, lengths, out=np.zeros_like(moves), where=lengths > 0)
        found.flags.writeable = False
        return found

    def before(self, offsets: Array) -> tuple[Array, Array]:
        """Mean inputs (S, periods, inputs) in the time before each segment, and the periods' lengths [s].

        Periods before a log's inputs begin are of no time; `offsets` as for `inputs`.
        """
        first = [log.input_times[0] - offsets[self.clocks.index(log.file)] for log in self.logs]
        ends = self.times[:, :1]
        begins = np.minimum(np.array(first)[self.owner][:, None], ends)
        times = np.maximum(ends + np.linspace(-BEFORE, 0.0, PARTS + 1), begins)
        whole = replace(self, times=times)
        return whole.inputs(offsets), whole.steps

    @cached_property
    def beside_inputs(self) -> Bools | None:
        """Which readings are means of periods on the inputs' own clock, (S, 1, quantities): these say nothing
        of the clocks' offset. None of none.
        """
        found, first = np.zeros((self.count, 1, len(self.quantities)), dtype=bool), len(self.states)
        for name, sensor in self.sensors:
            columns = slice(first, first := first + len(sensor.entries))
            for number, log in enumerate(self.logs) if sensor.when == "in periods" else ():
                own = any(one.sensor == name and one.clock == "inputs" for one in log.sensors)
                found[self.owner == number, :, columns] = own
        return found if found.any() else None

    @cached_property
    def cut_offsets(self) -> Array:
        """The clocks' offsets that the logs were cut with, (clocks,) [s]."""
        return np.array([self.cut_at[[log.file for log in self.logs].index(file)] for file in self.clocks])

    @cached_property
    def cut_inputs(self) -> Array:
        """Mean inputs in the grid's steps at these, (S, n, inputs)."""
        return self._mean_inputs(self.cut_offsets)

    def rates(self, values: Array) -> Array:
        """How fast values (S, n + 1, k) change, by the steps before and after each time, (S, n + 1); the mean
        of motions.
        """
        if self.relative:
            size = np.linalg.norm(values[:, -1:], axis=-1) / self.steps.sum(axis=1, keepdims=True)
            return np.asarray(np.broadcast_to(size, values.shape[:2]))
        moves = np.linalg.norm(np.diff(values, axis=1), axis=-1)
        around, times = np.zeros(values.shape[:2]), np.zeros(values.shape[:2])
        for found, steps in ((around, moves), (times, self.steps)):
            found[:, :-1] += steps
            found[:, 1:] += steps
        return np.divide(around, times, out=np.zeros_like(around), where=times > 0)

    def clock_slopes(
        self, read: Callable[[Array], Array], offsets: Array, wrapping: Bools | Literal[False] = False
    ) -> Array:
        """Derivatives of readings by every clock's offset, (S, ..., clocks).

        Args:
            read: readings (S, ...) with clocks at offsets (clocks,) [s].
            offsets: where the derivatives are taken.
            wrapping: which of a time's readings are angles that jump by full turns.
        """
        change = read(offsets + CLOCK_STEP) - read(offsets - CLOCK_STEP)
        slope = without_turns(change, wrapping) / (2 * CLOCK_STEP)
        own = self.clock[:, None] == np.arange(len(offsets))
        return np.asarray(slope[..., None] * own.reshape(len(own), *[1] * (slope.ndim - 1), -1))


def without_turns(values: Array, wrapping: Bools | Literal[False]) -> Array:
    """Values (..., k) less all full turns, of those that are angles."""
    return np.asarray(values - FULL_TURN * np.rint(values / FULL_TURN) * wrapping)


def cut(
    logs: Sequence[Log], seconds: float, offsets: Sequence[float], sensors: Labelled = ()
) -> SegmentLayout:
    """Logs cut into segments of about `seconds` each; infinite for whole logs.

    Args:
        logs: with the same quantities.
        seconds: length of a segment.
        offsets: of each log's clocks, as far as known [s]: readings before the inputs begin or after they
            end are left out.
        sensors: whose readings beside the poses are on the grid as well, by their names.

    Raises:
        LogError: nothing is left of any log.
    """
    grids = [grid_of(log, sensors, offset) for log, offset in zip(logs, offsets, strict=True)]
    pieces = [
        (number, slice(grid.read[part[0]], grid.read[part[-1]] + 1))
        for number, (log, grid, offset) in enumerate(zip(logs, grids, offsets, strict=True))
        for stretch in stretches(replace(log, pose_times=grid.read_times), offset, seconds)
        for part in _parts(grid.read_times[stretch], stretch, seconds)
    ]
    if not pieces:
        text = "no poses while the wheels are logged; are the two clocks together?"
        raise LogError([FileIssue(log.file, 0, 0, "", text) for log in logs])
    shape = (len(pieces), max(part.stop - part.start for _, part in pieces))
    times, readings = np.zeros(shape), np.zeros((*shape, grids[0].readings.shape[1]))
    valid, averaged = np.zeros(readings.shape, dtype=bool), np.ones(readings.shape)
    for row, (number, part) in enumerate(pieces):
        grid, length = grids[number], part.stop - part.start
        times[row, :length] = grid.times[part]
        times[row, length:] = grid.times[part.stop - 1]
        for whole, own in ((readings, grid.readings), (valid, grid.valid), (averaged, grid.averaged)):
            whole[row, :length] = own[part]
        # The period after a segment's end is the next one's.
        valid[row, length - 1, grid.of_periods] = False
    owner = np.array([number for number, _ in pieces])
    return SegmentLayout(
        tuple(logs),
        owner,
        times,
        readings,
        valid,
        seconds,
        sensors=sensors,
        averaged=averaged if sensors else None,
        cut_at=tuple(offsets),
    )


def shortest_seconds(layout: SegmentLayout) -> float:
    """Length of the shortest segments worth trying, for logs of such steps [s]."""
    return max(SHORTEST, FEWEST * usual_step(layout))


def usual_step(layout: SegmentLayout) -> float:
    """The median of the steps [s]."""
    return float(np.median(layout.steps[layout.steps > 0]))


def stretches(log: Log, offset: float, seconds: float = math.inf) -> list[Places]:
    """Indices of poses that motion of the wheels connects, each at least two.

    Args:
        log: of both clocks.
        offset: of the inputs' clock [s].
        seconds: length of the segments to be cut: without poses the wheels carry on for as long, but for no
            longer than `oed.logs.log.BRIDGED`.
    """
    moments = log.pose_times + offset
    inside = np.flatnonzero((moments >= log.input_times[0]) & (moments <= log.input_times[-1]))
    if len(inside) < 2:
        return []
    breaks = np.flatnonzero(_interrupted(log, inside, offset, seconds)) + 1
    return [part for part in np.split(inside, breaks) if len(part) > 1]


def _interrupted(log: Log, inside: Places, offset: float, seconds: float) -> Bools:
    # Between which poses nothing connects them: neither clock may jump.
    times, own, usual = log.pose_times[inside], np.diff(log.input_times), usual_of(log.pose_times)
    longest = max(GAP * usual, min(seconds, BRIDGED)) if log.gap is None else log.gap
    found = np.diff(times) > longest
    if log.motions is not None and log.motions.begins is not None:
        found |= np.isin(times[1:], log.motions.begins)
    late = np.flatnonzero(own > (GAP * max(float(np.median(own)), usual) if log.gap is None else log.gap))
    for index in late:
        first, last = log.input_times[index] - offset, log.input_times[index + 1] - offset
        found |= (times[:-1] < last) & (times[1:] > first)
    for moment in log.breaks:
        found |= (times[:-1] < moment) & (times[1:] > moment)
    return np.asarray(found)


def _parts(times: Array, stretch: Places, seconds: float) -> list[Places]:
    # Nearly equal parts whose ends are shared.
    length = times[-1] - times[0]
    count = max(1, round(length / seconds)) if np.isfinite(seconds) else 1
    edges = np.searchsorted(times, times[0] + length * np.arange(1, count) / count)
    marks = np.unique([0, *edges.tolist(), len(times) - 1])
    return [stretch[first : last + 1] for first, last in pairwise(marks)]
