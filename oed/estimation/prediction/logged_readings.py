"""What is read of segments of logs, as a function of the unknowns and of the segments' starts; and first
guesses of these.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from oed.estimation.prediction.layout import SegmentLayout
from oed.estimation.prediction.segments import Driven, SegmentReadings
from oed.estimation.setup.unknowns import PLACE, Unknowns
from oed.foundation.arrays import Array, Bools
from oed.kernel.dynamics.system import follows_state
from oed.robots.models.model import Model
from oed.robots.sensors.relative_poses import RelativePoses

POSE = 3
"""States of a robot's pose."""
SETTLED = 100.0
"""Time after which a robot follows inputs that are held [s]."""


@dataclass(frozen=True)
class LoggedReadings:
    """The readings that unknowns predict.

    Attributes:
        layout: the segments.
        unknowns: common to them.
        offsets: of the clocks, as far as known, (clocks,) [s].
        quantities: that are read.
    """

    layout: SegmentLayout
    unknowns: Unknowns
    offsets: Array
    quantities: tuple[str, ...]

    @classmethod
    def of(cls, layout: SegmentLayout, unknowns: Unknowns, offsets: Array) -> LoggedReadings:
        """Those that the logs hold."""
        return cls(layout, unknowns, offsets, layout.quantities)

    def reading(self, *quantities: str) -> LoggedReadings:
        """Other quantities of the same drives."""
        return replace(self, quantities=quantities)

    def __call__(self, values: Array, starts: Array) -> Array:
        """The readings (S, n + 1, quantities), SI, at unknowns (q,) and starts (S, states)."""
        parameters, place, clocks = self.unknowns.parts(values)
        return self._at(starts, parameters, place, self._offsets(clocks))

    def _begun(self, starts: Array) -> Array:
        # Whole states: where a motion that a sensor read of itself begins is of no matter.
        return np.pad(starts, ((0, 0), (POSE, 0))) if self.layout.relative else starts

    def _on_grid(self, found: Array) -> Array:
        # Motions stand at the last of a segment's times.
        if not self.layout.relative:
            return found
        return np.pad(found, ((0, 0), (self.layout.periods, 0), *((0, 0),) * (found.ndim - 2)))

    def derivatives(self, values: Array, starts: Array) -> tuple[Array, Array, Array]:
        """The readings, and their derivatives by the unknowns (S, n + 1, quantities, q) and by the segment's
        own start (S, n + 1, quantities, states).
        """
        (parameters, place, clocks), steps = self.unknowns.parts(values), self.layout.steps
        offsets = self._offsets(clocks)
        inputs = self.layout.inputs(offsets)
        driven = Driven(self._begun(starts), inputs, steps, parameters, place)
        found, slopes = map(self._on_grid, self._segments.derivatives(driven))
        columns, size = [self.unknowns.slopes(slopes)], len(parameters)
        if len(clocks):
            columns.append(self.layout.clock_slopes(partial(self._at, starts, parameters, place), offsets))
        last = size + len(self.unknowns.robot.states)
        # A copy: a view would keep all columns.
        return found, np.concatenate(columns, axis=-1), slopes[..., last - starts.shape[1] : last].copy()

    @property
    def wrapping(self) -> Bools:
        """Which quantities jump by full turns as they are predicted, (quantities,): no states."""
        return np.zeros(len(self.quantities), dtype=bool)

    def disturbed(self, values: Array, starts: Array, noise: Array) -> tuple[Array, Array]:
        """The readings with noise in the inputs, and their derivatives by the unknowns; by clocks they are 0.

        Args:
            values: of the unknowns.
            starts: start states of the segments.
            noise: of every period's inputs, (S, n, inputs).
        """
        parameters, place, clocks = self.unknowns.parts(values)
        inputs = self.layout.inputs(self._offsets(clocks)) + noise
        found, slopes = self._segments.derivatives(
            Driven(starts, inputs, self.layout.steps, parameters, place)
        )
        own = self.unknowns.slopes(slopes)
        return found, np.pad(own, (*[(0, 0)] * (own.ndim - 1), (0, len(clocks))))

    def first_starts(self, values: Array) -> Array:
        """Starts (S, states) near enough for a search to begin from, at unknowns (q,); of motions only the
        states after the pose, (S, states - 3).
        """
        parameters, place, clocks = self.unknowns.parts(values)
        robot, layout = self.unknowns.robot, self.layout
        further = further_starts(robot, layout, self._offsets(clocks), parameters)
        if layout.relative:
            return further
        return first_starts(robot, layout, partial(self, values), place, further)

    def rates(self, values: Array, starts: Array, readings: Array) -> tuple[Array, Array]:
        """Speeds [m/s], 0 where positions are not read, and yaw rates [rad/s] at readings (S, n + 1, k).

        Args:
            values: of the unknowns.
            starts: start states of the segments.
            readings: of the segments, (S, n + 1, ...).
        """
        places = [index for index, name in enumerate(self.quantities) if name in ("x", "y")]
        still = np.zeros(readings.shape[:2])
        speeds = self.layout.rates(readings[..., places]) if len(places) == 2 else still
        headings = [index for index, name in enumerate(self.quantities) if name == "heading"]
        turned = readings[..., headings] if headings else self.reading("heading")(values, starts)
        return speeds, self.layout.rates(turned)

    def _at(self, starts: Array, parameters: Array, place: Array, offsets: Array) -> Array:
        inputs = self.layout.inputs(offsets)
        driven = Driven(self._begun(starts), inputs, self.layout.steps, parameters, place)
        return self._on_grid(self._segments(driven))

    def _offsets(self, clocks: Array) -> Array:
        return self.offsets + clocks if len(clocks) else self.offsets

    @cached_property
    def _segments(self) -> SegmentReadings:
        layout, robot = self.layout, self.unknowns.robot
        if layout.relative:
            return SegmentReadings(robot, RelativePoses(every=layout.periods), layout.count, layout.periods)
        return SegmentReadings.logged(robot, self.quantities, layout.count, layout.periods)


def first_starts(
    robot: Model, layout: SegmentLayout, paths: Callable[[Array], Array], place: Array, further: Array
) -> Array:
    """States (S, states) at which the segments begin, near enough for a search to start from.

    A heading that is not read is the one that turns the predicted path onto the positions best.

    Args:
        robot: whose states they are.
        layout: the segments.
        paths: readings (S, n + 1, quantities) predicted for starts (S, states).
        place: of the pose sensor: ahead, to the left [m], turned [rad], (3,).
        further: states after the pose, where they are not read, (S, states - 3).
    """
    starts = np.pad(further, ((0, 0), (3, 0)))
    for column, name in enumerate(layout.quantities):
        starts[:, robot.states.index(name)] = layout.first_readings(column)
    if "heading" in layout.quantities:
        starts[:, 2] -= place[2]
    elif {"x", "y"} <= set(layout.quantities):
        places = [layout.quantities.index("x"), layout.quantities.index("y")]
        both = layout.read_together(places)
        starts[:, 2] = _turns(paths(starts)[..., places], layout.readings[..., places], both)
    # The robot's origin stands off the sensor by the lever arm.
    arm = (place[0] + 1j * place[1]) * np.exp(1j * starts[:, 2])
    starts[:, :2] -= np.column_stack([arm.real, arm.imag])
    return starts


def further_starts(
    robot: Model,
    layout: SegmentLayout,
    offsets: Array,
    parameters: Array,
    inputs: Array | None = None,
) -> Array:
    """States after the pose (S, states - 3) at which segments begin, by the inputs before them.

    A log's robot rests before its inputs begin. They are 0 of a robot that moves by its inputs alone: nothing
    depends on them.

    Args:
        robot: whose states they are.
        layout: the segments.
        offsets: of the clocks, (clocks,) [s].
        parameters: (p,), SI.
        inputs: instead of the logged ones, (S, n, inputs): they are taken to be held before as they begin.
    """
    starts = np.zeros((layout.count, len(robot.states)))
    if not follows_state(robot):
        return starts[:, 3:]
    if inputs is None:
        held, times = layout.before(offsets)
    else:
        held, times = inputs[:, :1], np.full((layout.count, 1), SETTLED)
    driven = SegmentReadings.logged(robot, robot.states[3:], *times.shape)
    return driven(Driven(starts, held, times, parameters, np.zeros(len(PLACE))))[:, -1]


def _turns(predicted: Array, measured: Array, valid: Bools) -> Array:
    # The rotation of least squares about the mean [Horn, Closed-form solution of absolute orientation, 1987].
    weight = valid[..., None] / np.maximum(valid.sum(axis=1), 1)[:, None, None]
    paths = []
    for path in (predicted, measured):
        centred = (path - (path * weight).sum(axis=1, keepdims=True)) * (weight > 0)
        paths.append(centred[..., 0] + 1j * centred[..., 1])
    return np.asarray(np.angle((paths[1] * paths[0].conj()).sum(axis=1)))
