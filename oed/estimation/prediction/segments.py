"""Pieces of drives: the readings that a sensor makes of them, and their derivatives.

Each segment is driven from a start of its own; of a system without states nothing is followed. All segments
are computed in one call; shorter ones are padded with periods of no time, which change nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, Literal, NamedTuple

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array, block_columns
from oed.kernel.dynamics.direct_call import DirectCall
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.system import System, carrier, stepper
from oed.kernel.measurement.blocks import Nuisance
from oed.kernel.measurement.readings import moment_reading, reading_by_signal
from oed.kernel.measurement.sensor import Moment, Sensor
from oed.robots.models.model import Model
from oed.robots.sensors.mounting import CameraArm
from oed.robots.sensors.placed import PlacedSensor

What = Literal["readings", "slopes", "whitening", "by twist"]
Labelled = tuple[tuple[str, Sensor], ...]
"""Sensors by their names."""

PERIODS = 10
"""Periods that one call of a function takes, for a call takes longer than a period."""
SHORTEST = 1e-300
"""Time of a period of no time, in which nothing moves [s]."""
BASE = 4
"""Calls that CasADi nests in one: with more of them a function takes longer to be made."""
WHITENING = 2
"""Place of the whitening among the results of `moment_reading`."""
OUTPUTS: dict[What, tuple[int, ...]] = {
    "readings": (0,),
    "slopes": (0, 1),
    "whitening": (WHITENING,),
    "by twist": (),
}
"""Of the function of a moment's reading."""


class Driven(NamedTuple):
    """What readings of segments depend on, SI.

    Attributes:
        starts: states at the segments' beginnings, (S, states).
        inputs: held in each period, (S, n, inputs).
        times: lengths of the periods [s], 0 beyond a segment's end, (S, n).
        parameters: of the system, (p,).
        nuisances: the sensor's own, (k,).

    Side by side, starts, parameters and nuisances have a leading axis.
    """

    starts: Array
    inputs: Array
    times: Array
    parameters: Array
    nuisances: Array


class LoggedStates(PlacedSensor):
    """What logs hold, as a sensor: a robot's states at all times, x, y and heading at the sensor's place, in
    units of their noise; and after them what other sensors read, of a period at its begin.

    Attributes:
        places: of what is read among the robot's states.
        every: periods from one reading to the next, in which the robot is driven; what is read of a period is
            the mean of them.
        lever_arm: unknown, like the angle by which the sensor is turned.
        others: further sensors by their names.
    """

    kind: Literal["logged_states"] = "logged_states"
    places: tuple[int, ...]
    lever_arm: CameraArm = CameraArm(known=False)  # type: ignore[assignment]  # Another mounting.
    others: Labelled = ()

    @property
    def nuisances(self) -> tuple[Nuisance, ...]:
        """The sensor's place: ahead, to the left [m], turned [rad]; and those of other sensors."""
        return (*super().nuisances, *nuisances_of(self.others))

    def reading(self, moment: Moment) -> Expression:
        """The states' values, then the readings of the others."""
        values = [*self.sensor_pose(moment), *ca.vertsplit(moment.state)[3:]]
        read = [values[place] for place in self.places]
        for label, sensor in self.others:
            own = {one.name: moment.nuisances[f"{label}.{one.name}"] for one in sensor.nuisances}
            read.append(sensor.reading(replace(moment, nuisances=own)))
        return ca.vertcat(*read)

    def whitening(self, moment: Moment) -> Expression:
        """Unity."""
        return ca.SX.eye(len(self.places) + sum(len(sensor.entries) for _, sensor in self.others))

    @property
    def wrapping(self) -> tuple[int, ...]:
        """Those of the others."""
        found, first = list[int](), len(self.places)
        for _, sensor in self.others:
            found += [first + place for place in sensor.wrapping]
            first += len(sensor.entries)
        return tuple(found)

    @property
    def of_periods(self) -> bool:
        """Whether any of it is the mean of a period."""
        return any(sensor.when == "in periods" for _, sensor in self.others)


def nuisances_of(sensors: Labelled) -> tuple[Nuisance, ...]:
    """The sensors' nuisances, their names made unique."""
    return tuple(
        replace(one, name=f"{label}.{one.name}") for label, sensor in sensors for one in sensor.nuisances
    )


@dataclass(frozen=True)
class SegmentReadings:
    """What a sensor reads of segments with given inputs.

    Attributes:
        model: the system.
        sensor: reads K times of a segment, q numbers each.
        count: S, segments.
        periods: n, of the longest of them.
    """

    model: System
    sensor: Sensor
    count: int
    periods: int

    @classmethod
    def logged(
        cls,
        model: Model,
        quantities: Sequence[str],
        count: int,
        periods: int,
        sensors: Labelled = (),
        parts: int = 1,
    ) -> SegmentReadings:
        """What logs hold of segments: the model's states of those names, at all n + 1 times.

        Args:
            model: the robot.
            quantities: names of its states.
            count: segments.
            periods: of each, n.
            sensors: that read beside them.
            parts: in which each of the periods is driven.
        """
        places = tuple(map(model.states.index, quantities))
        sensor = LoggedStates(places=places, others=sensors, every=parts)
        return cls(model, sensor, count, parts * periods)

    def __call__(self, driven: Driven) -> Array:
        """The readings (S, K, q), SI."""
        (found,) = self._called("readings", driven)
        return self._by_segment(found)

    def derivatives(self, driven: Driven) -> tuple[Array, Array]:
        """The readings, and their derivatives (S, K, q, p + states + k); (R, S, ...) side by side.

        The columns are the parameters, the segment's own start, the sensor's nuisances.
        """
        if driven.parameters.ndim > 1:
            return self._side_by_side(driven)
        found, slopes = self._called("slopes", driven)
        return self._by_segment(found), self._by_segment(slopes, self._width)

    def _side_by_side(self, driven: Driven) -> tuple[Array, Array]:
        many = len(driven.parameters)
        call = _segments(self.model, self.sensor, self.count, self.periods, "slopes", many)
        found, slopes = call(
            driven.starts,
            np.tile(driven.inputs, (many, 1, 1)),
            np.tile(driven.times, (many, 1)),
            np.repeat(driven.parameters, self.count, axis=0),
            np.repeat(driven.nuisances, self.count, axis=0),
        )
        shape = (many, self.count, -1, self._size)
        return found.reshape(shape), slopes.reshape(*shape, self._width)

    def by_twist(self, driven: Driven) -> Array:
        """Derivatives of the readings by a robot's twist at their times, (S, K, q, 3)."""
        (found,) = self._called("by twist", driven)
        return self._by_segment(found, 3)

    def whitening(self, driven: Driven) -> Any:
        """A with A R A' = 1 for the covariance R of all readings' noise: (S K q, S K q), sparse."""
        # Loaded late: a check of a study needs none of it.
        from scipy.sparse import csr_array

        (found,) = self._called("whitening", driven)
        rows, columns = moment_reading(self.sensor, self.model).sparsity_out(WHITENING).get_triplet()
        values = found.reshape(-1, len(rows))
        first = self._size * np.arange(len(values))[:, None]
        places = (first + rows).ravel(), (first + columns).ravel()
        return csr_array((values.ravel(), places), shape=2 * (self._size * len(values),))

    def _by_segment(self, found: Array, *width: int) -> Array:
        return found.reshape(self.count, -1, self._size, *width)

    @cached_property
    def _size(self) -> int:
        return int(moment_reading(self.sensor, self.model).size1_out(0))

    @cached_property
    def _width(self) -> int:
        return len(self.model.parameters) + len(self.model.states) + len(self.sensor.nuisances)

    def _called(self, what: What, driven: Driven) -> list[Array]:
        if what not in self._calls:
            self._calls[what] = _segments(self.model, self.sensor, self.count, self.periods, what)
        return self._calls[what](*driven)

    @cached_property
    def _calls(self) -> dict[What, DirectCall]:
        # Those that were asked for: to find them by robot and sensor again takes longer than many of them.
        return {}


@lru_cache(maxsize=16)
def _segments(
    model: System, sensor: Sensor, count: int, periods: int, what: What, many: int = 1
) -> DirectCall:
    # Parameters and nuisances are common to all segments, but for those of many drives side by side. Few are
    # remembered: each holds the indices of all its numbers, and of a long log these take as much room as the
    # numbers themselves.
    function = _segment(model, sensor, periods, what)
    common = [3, 4] if many == 1 else []
    mapped = function.map("segments", "serial", many * count, common, []) if many * count > 1 else function
    return DirectCall(mapped)


@lru_cache(maxsize=32)
def _segment(model: System, sensor: Sensor, periods: int, what: What) -> ca.Function:
    states, size = len(model.states), len(model.parameters)
    start, parameters = ca.MX.sym("start", states), ca.MX.sym("p", size)
    inputs, times = ca.MX.sym("inputs", len(model.inputs), periods), ca.MX.sym("times", 1, periods)
    nuisances = ca.MX.sym("nuisances", len(sensor.nuisances))
    slopes = what == "slopes"
    own = ca.vec(ca.horzcat(ca.DM.zeros(states, size), ca.DM.eye(states)))
    begin = ca.vertcat(start, own) if slopes else start
    whole = _followed(model, begin, inputs, parameters, times, slopes=slopes)
    poses = whole[:states, :]
    instants = sensor.instants(periods)
    count = len(instants[0])
    held, lengths = _held(sensor, inputs, times, instants)
    moments = [ca.vertcat(*(poses[:, columns] for columns in instants)), ca.vertcat(*held)]
    moments += [ca.repmat(parameters, 1, count), ca.repmat(nuisances, 1, count)]
    moments.append(lengths)
    if slopes:
        width = size + states
        carried = ca.reshape(whole[states:, :], states, width * (periods + 1))
        places = (block_columns(np.array(columns), width) for columns in instants)
        moments.append(ca.vertcat(*(carried[:, own] for own in places)))
    found = _moment(sensor, model, what).map(count).call(moments)
    return ca.Function(what.replace(" ", "_"), [start, inputs, times, parameters, nuisances], found)


def _followed(
    model: System,
    begin: Expression,
    inputs: Expression,
    parameters: Expression,
    times: Expression,
    *,
    slopes: bool,
) -> Expression:
    # States at all times, (states, n + 1), with their slopes below them where these are wanted.
    if not model.states:
        return ca.MX(0, times.shape[1] + 1)
    whole, rest = divmod(times.shape[1], PERIODS)
    parts, last = [begin], whole * PERIODS
    for length, count, own in (
        (PERIODS, whole, slice(0, last)),
        (1, rest, slice(last, last + rest)),
    ):
        if count:
            function = _several(model, length, slopes=slopes).mapaccum("followed", count, {"base": BASE})
            repeated = ca.repmat(parameters, 1, count)
            parts.append(function(parts[-1][:, -1], inputs[:, own], repeated, times[:, own])[1])
    return ca.horzcat(*parts)


@lru_cache(maxsize=32)
def _several(model: System, periods: int, *, slopes: bool) -> ca.Function:
    # (state, inputs (m, n), parameters, times (1, n)) -> the state after the last period, and after each.
    # With slopes a state has its derivatives by parameters and start, column by column, below it.
    states, size = len(model.states), len(model.parameters)
    width = states * (1 + size + states) if slopes else states
    start, parameters = ca.SX.sym("start", width), ca.SX.sym("p", size)
    inputs, times = ca.SX.sym("inputs", len(model.inputs), periods), ca.SX.sym("times", 1, periods)
    one, found = _period(model, slopes=slopes), [start]
    for period in range(periods):
        found.append(one(found[-1], inputs[:, period], parameters, times[period]))
    return ca.Function("several", [start, inputs, parameters, times], [found[-1], ca.horzcat(*found[1:])])


@lru_cache(maxsize=32)
def _period(model: System, *, slopes: bool) -> ca.Function:
    # Of one period: what it computes twice is looked for here, in a tenth of the expressions.
    states, size = len(model.states), len(model.parameters)
    start = ca.SX.sym("start", states)
    given = start, ca.SX.sym("inputs", len(model.inputs)), ca.SX.sym("p", size), ca.SX.sym("time")
    after = ca.densify(stepper(model)(*given))
    if not slopes:
        return ca.Function("period", [*given], [ca.cse(after)])
    own = ca.SX.sym("S", states, size + states)
    both = ca.vertcat(after, ca.vec(carrier(model)(own, *given)))
    return ca.Function("period", [ca.vertcat(start, ca.vec(own)), *given[1:]], [ca.cse(both)])


def _held(
    sensor: Sensor, inputs: Expression, times: Expression, instants: Sequence[Sequence[int]]
) -> tuple[list[Expression], Expression]:
    # Inputs at the readings' instants, and how long each reading lasts.
    if isinstance(sensor, LoggedStates) and sensor.of_periods and sensor.every > 1:
        # What is read of a period that is driven in parts is the mean of these.
        instants = [range(len(instants[0]))]
        inputs, times = _means(inputs, times, sensor.every)
    last = times.shape[1] - 1
    # At the last time the inputs are those held until then.
    held = [inputs[:, [min(column, last) for column in columns]] for columns in instants]
    return held, _lengths(sensor, times, instants)


def _means(inputs: Expression, times: Expression, parts: int) -> tuple[Expression, Expression]:
    # Of periods that so many parts make up each: mean inputs, and how long they are.
    sums = ca.kron(ca.DM.eye(times.shape[1] // parts), ca.DM.ones(parts, 1))
    lengths = times @ sums
    driven = (inputs * ca.repmat(times, inputs.shape[0], 1)) @ sums
    return driven / ca.repmat(ca.fmax(lengths, SHORTEST), inputs.shape[0], 1), lengths


def _lengths(sensor: Sensor, times: Expression, instants: Sequence[Sequence[int]]) -> Expression:
    # Of the periods that are read, or the time that a reading lasts.
    if sensor.when == "in periods" or (isinstance(sensor, LoggedStates) and sensor.of_periods):
        # What logs hold of a period stands at its begin; after the last time there is none.
        return ca.horzcat(times, 0)[:, instants[0]]
    if sensor.when == "at samples":
        return ca.MX.zeros(1, len(instants[0]))
    ends, begins = instants
    clock = ca.horzcat(0.0, ca.cumsum(times, 1))
    return clock[:, ends] - clock[:, begins]


@lru_cache(maxsize=32)
def _moment(sensor: Sensor, model: System, what: What) -> ca.Function:
    # What is wanted of one moment's reading; how the pose follows from the unknowns comes last, if at all.
    whole = moment_reading(sensor, model)
    symbols = [ca.SX.sym(whole.name_in(place), *whole.size_in(place)) for place in range(whole.n_in())]
    pose, carried, *others = symbols
    if what == "by twist":
        return ca.Function(
            "moment", [pose, *others], [reading_by_signal(sensor, model, "twist")(pose, *others)]
        )
    found = whole.call(symbols)
    wanted = [ca.densify(found[place]) for place in OUTPUTS[what]]
    if what == "whitening":
        wanted = [ca.vertcat(*found[WHITENING].nonzeros())]
    return ca.Function("moment", [pose, *others, *([carried] if what == "slopes" else [])], wanted)
