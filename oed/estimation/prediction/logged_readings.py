"""What is read of segments of logs, as a function of the unknowns and of the segments' starts; and first
guesses of these.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from oed.estimation.prediction.layout import SegmentLayout, cut, without_turns
from oed.estimation.prediction.localisation import located
from oed.estimation.prediction.motion_readings import MotionReadings, Moved
from oed.estimation.prediction.segments import Driven, Labelled, SegmentReadings
from oed.estimation.setup.unknowns import PLACE, Unknowns
from oed.foundation.arrays import Array, Bools
from oed.kernel.dynamics.system import follows_state
from oed.kernel.measurement.sensor import Sensor
from oed.robots.models.model import Model
from oed.robots.sensors.mapped import points_seen
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
        quantities: states that are read.
        sensors: that read beside them.
    """

    layout: SegmentLayout
    unknowns: Unknowns
    offsets: Array
    quantities: tuple[str, ...]
    sensors: Labelled = ()

    @classmethod
    def of(cls, layout: SegmentLayout, unknowns: Unknowns, offsets: Array) -> LoggedReadings:
        """Those that the logs hold."""
        return cls(layout, unknowns, offsets, layout.states, layout.sensors)

    def reading(self, *quantities: str) -> LoggedReadings:
        """Other states of the same drives."""
        return replace(self, quantities=quantities, sensors=())

    def __call__(self, values: Array, starts: Array) -> Array:
        """The readings (S, n + 1, quantities), SI, at unknowns (q,) and starts (S, states)."""
        parameters, place, clocks = self.unknowns.parts(values)
        return self._at(starts, parameters, place, self._offsets(clocks))

    def _begun(self, starts: Array) -> Array:
        # Whole states: where a motion that a sensor read of itself begins is of no matter.
        return np.pad(starts, ((0, 0), (POSE, 0)))

    def derivatives(self, values: Array, starts: Array) -> tuple[Array, Array, Array]:
        """The readings, and their derivatives by the unknowns (S, n + 1, quantities, q) and by the segment's
        own start (S, n + 1, quantities, states).
        """
        parameters, place, clocks = self.unknowns.parts(values)
        offsets = self._offsets(clocks)
        if self.layout.relative:
            found, slopes = self._motions.derivatives(Moved(self._begun(starts), offsets, parameters, place))
        else:
            driven = self._driven(starts, offsets, parameters, place)
            found, slopes = self._segments.derivatives(driven)
            found = self._beside_inputs(found, driven)
        columns, size = [self.unknowns.slopes(slopes)], len(parameters)
        if len(clocks):
            read = partial(self._at, starts, parameters, place)
            columns.append(self.layout.clock_slopes(read, offsets, self.wrapping))
        last = size + len(self.unknowns.robot.states)
        # A copy: a view would keep all columns.
        return found, np.concatenate(columns, axis=-1), slopes[..., last - starts.shape[1] : last].copy()

    def path(self, values: Array, starts: Array) -> Array:
        """The robot's states, of its origin, (S, n + 1, states)."""
        parameters, place, clocks = self.unknowns.parts(values)
        every = self.reading(*self.unknowns.robot.states)
        return every._at(starts, parameters, np.zeros_like(place), self._offsets(clocks))

    def by_errors(self, values: Array, starts: Array) -> Array | None:
        """Derivatives of what is read of each period by an error of its motion: ahead, to the left [m],
        turned [rad], (S, n + 1, quantities, 3); None where nothing is read of periods.
        """
        if not any(sensor.when == "in periods" for _, sensor in self.sensors):
            return None
        parameters, place, clocks = self.unknowns.parts(values)
        found = self._segments.by_twist(self._driven(starts, self._offsets(clocks), parameters, place))
        lengths = np.pad(self.layout.steps, ((0, 0), (0, 1)))[..., None, None]
        mean = np.divide(found, lengths, out=np.zeros_like(found), where=lengths > 0)
        each = [sensor.when == "in periods" for _, sensor in self.sensors for _ in sensor.entries]
        return np.asarray(mean * np.array([False] * len(self.quantities) + each)[:, None])

    @cached_property
    def wrapping(self) -> Bools:
        """Which readings jump by full turns, (quantities,): no states, but turns in which these change."""
        width = len(self.quantities) + sum(len(one.entries) for _, one in self.sensors)
        sensor = self._sensor
        return np.isin(np.arange(width), sensor.angles if self.layout.relative else sensor.wrapping)

    def disturbed(self, values: Array, starts: Array, noise: Array) -> tuple[Array, Array]:
        """The readings with noise in the inputs, and their derivatives by the unknowns; by clocks they are 0.

        Args:
            values: of the unknowns.
            starts: start states of the segments.
            noise: of every period's inputs, (S, n, inputs).
        """
        parameters, place, clocks = self.unknowns.parts(values)
        driven = self._driven(starts, self._offsets(clocks), parameters, place)
        added = np.repeat(noise, self.layout.parts_of_steps, axis=1)
        found, slopes = self._segments.derivatives(driven._replace(inputs=driven.inputs + added))
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
        points = points_seen([sensor for _, sensor in self.sensors])
        if len(points) and not {"x", "y"} <= set(layout.states):
            return self._located(values, points, further)
        return first_starts(robot, layout, partial(self, values), place, further)

    def _located(self, values: Array, points: Array, further: Array) -> Array:
        # Whole stretches are located; segments begin where these pass.
        layout = self.layout
        whole = cut(layout.logs, np.inf, layout.cut_at, layout.sensors)
        if whole.count == layout.count:
            begin = np.pad(further, ((0, 0), (3, 0)))
            return located(*self._misfit(values), begin, points)
        stretches = replace(self, layout=whole)
        starts = stretches.first_starts(values)
        paths = stretches.path(values, starts)
        return np.array([_passing(whole, paths, layout, row) for row in range(layout.count)])

    def _misfit(self, values: Array) -> tuple[Callable[[Array], Array], Callable[[Array], Array]]:
        # Residuals in units of the noise specified, (S, K), by the starts, and their slopes, (S, K, states).
        (parameters, place, clocks), layout = self.unknowns.parts(values), self.layout
        first, count = len(parameters), layout.count
        each = (one.deviations or (1.0,) * len(one.entries) for _, one in self.sensors)
        weights = layout.valid / np.concatenate([np.ones(len(self.quantities)), *each])

        def driven(starts: Array) -> Driven:
            return self._driven(starts, self._offsets(clocks), parameters, place[: self._constants])

        def residuals(starts: Array) -> Array:
            left = without_turns(layout.readings - self._segments(driven(starts)), self.wrapping)
            return np.asarray((left * weights).reshape(count, -1))

        def slopes(starts: Array) -> Array:
            own = self._segments.derivatives(driven(starts))[1][..., first : first + starts.shape[1]]
            return np.asarray((-own * weights[..., None]).reshape(count, -1, starts.shape[1]))

        return residuals, slopes

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
        own = place[: self._constants]
        if self.layout.relative:
            return self._motions(Moved(self._begun(starts), offsets, parameters, own))
        driven = self._driven(starts, offsets, parameters, own)
        return self._beside_inputs(self._segments(driven), driven)

    def _driven(self, starts: Array, offsets: Array, parameters: Array, own: Array) -> Driven:
        finer = self.layout.in_small_steps
        return Driven(starts, finer.inputs(offsets), finer.steps, parameters, own)

    def _beside_inputs(self, found: Array, driven: Driven) -> Array:
        # What is read on the inputs' own clock is that of the times which it was put on the grid with.
        finer, chosen = self.layout.in_small_steps, self.layout.beside_inputs if self.sensors else None
        if chosen is None or driven.inputs is finer.cut_inputs:
            return found
        return np.where(chosen, self._segments(driven._replace(inputs=finer.cut_inputs)), found)

    def _offsets(self, clocks: Array) -> Array:
        return self.offsets + clocks if len(clocks) else self.offsets

    @cached_property
    def _segments(self) -> SegmentReadings:
        layout = self.layout
        return SegmentReadings.logged(
            self.unknowns.robot,
            self.quantities,
            layout.count,
            layout.periods,
            self.sensors,
            layout.parts_of_steps,
        )

    @cached_property
    def _motions(self) -> MotionReadings:
        return MotionReadings(self.unknowns.robot, self.layout)

    @cached_property
    def _sensor(self) -> Sensor:
        return RelativePoses() if self.layout.relative else self._segments.sensor

    @cached_property
    def _constants(self) -> int:
        # Without the sensors beside the poses only the pose sensor's own.
        return len(self._sensor.nuisances)


def _passing(whole: SegmentLayout, paths: Array, layout: SegmentLayout, row: int) -> Array:
    # The state (states,) in which stretches pass a segment's begin.
    begin = layout.times[row, 0]
    among = np.flatnonzero(whole.owner == layout.owner[row])
    places = [int(np.argmin(np.abs(whole.times[one] - begin))) for one in among]
    off = [abs(whole.times[one, place] - begin) for one, place in zip(among, places, strict=True)]
    nearest = int(np.argmin(off))
    return np.asarray(paths[among[nearest], places[nearest]])


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
    for column, name in enumerate(layout.states):
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
