"""By how much a limit is exceeded, at an instant and at most over a stretch of time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.kernel.between.periods import Periods, Stretches
from oed.kernel.dynamics.direct_call import MOST, DirectCall
from oed.kernel.dynamics.enclosures import Enclosure, enclosed
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.intervals import ONE, Interval, number
from oed.kernel.dynamics.rollout import Instant, instant_of
from oed.kernel.dynamics.system import System
from oed.kernel.limit import Rows

AT_ONCE = 1024
"""Stretches bounded in one call."""
SHARED, THREADS = 1_000_000, 2
"""Operations of a call (rows times operations of each) from which threads share it, for starting them takes
0.1 ms, and how many threads: no more, for searches and simulations run in several processes already.
"""


class Excess:
    """By how much a limit's rows are exceeded at an instant, and how much at most over a stretch of a period.

    Attributes:
        size: of the limit.
        sensitive: whether the rows look at sensitivities.
        per_metre: what the rows change by at most per metre that the mean speed of a period says.
        by_splines: whether they look at the inputs' splines between the middles of the periods.
    """

    def __init__(
        self,
        rows_of: Callable[[Instant], Rows],
        system: System,
        *,
        per_metre: float = np.inf,
        sensitive: bool = False,
        run: int = 0,
    ) -> None:
        """Write the rows of an instant and bound them.

        Args:
            rows_of: an instant's.
            system: that is driven.
            per_metre: what the rows change by at most per metre that the mean speed of a period says.
            sensitive: whether the rows look at sensitivities.
            run: of which run the instants are.

        Raises:
            NotEnclosed: an operation that no bounds are known for.
        """
        self._inputs = inputs = len(system.inputs)
        self.sensitive, self.per_metre = sensitive, per_metre
        self._given = _symbols(system, sensitive)
        state, held, own, slopes, period = self._given
        asked, fraction = ca.SX.sym("asked", inputs), ca.SX.sym("fraction")
        instant = instant_of(
            system,
            state=state,
            held=held,
            parameters=own,
            period=period,
            asked=asked,
            fraction=fraction,
            sensitivities=ca.reshape(slopes, len(system.states), -1) if sensitive else None,
            run=run,
        )
        rows = rows_of(instant)
        self.size, excess = rows.size, ca.cse(exceeded(rows))
        self.by_splines = bool(ca.depends_on(excess, asked))
        self._affine = _affine(excess, asked, own)
        arguments = [*self._given, asked, fraction]
        both = ca.vertcat(excess, instant.speeds)
        self._at = ca.Function("at", [ca.vertcat(*arguments)], [ca.densify(both)])
        self._over = self._bounded(ca.Function("excess", arguments, [excess]), inputs)
        self._mapped: dict[tuple[str, int], DirectCall] = {}

    def _bounded(self, excess: ca.Function, inputs: int) -> ca.Function:
        # Of a stretch the values at both ends, the highest between, and bounds of the slopes.
        names = ("asked_begin", "asked_end", "low", "high", "slope_low", "slope_high")
        asked = [ca.SX.sym(name, inputs) for name in names]
        begin, end = ca.SX.sym("begin"), ca.SX.sym("end")
        each = zip(*(ca.vertsplit(one) for one in asked[2:]), strict=True)
        entries = [Enclosure(Interval(low, high), Interval(least, most)) for low, high, least, most in each]
        points = [[Enclosure(number(one)) for one in ca.vertsplit(given)] for given in self._given]
        if not self.by_splines:
            entries = [Enclosure(number(0.0))] * inputs
        found = enclosed(excess, [*points, entries, [Enclosure(Interval(begin, end), ONE)]])
        ends = [excess(*self._given, *at) for at in ((asked[0], begin), (asked[1], end))]
        bounds = [one.value.high for one in found]
        bounds += [one.slope.low for one in found] + [one.slope.high for one in found]
        results = ca.densify(ca.cse(ca.vertcat(*ends, *bounds)))
        return ca.Function("over", [ca.vertcat(*self._given, *asked, begin, end)], [results])

    def everywhere(self, periods: Periods) -> Stretches:
        """All periods; cut where splines have knots, if the rows look at them."""
        return periods.pieces if self.by_splines else periods.whole

    def exactly(self, periods: Periods) -> float | None:
        """The most at any time of one drive, of rows that are affine in the inputs' splines: splines
        themselves, whose extremes are known. None of others.
        """
        if self._affine is None:
            return None
        gains, offsets = (np.array(one) for one in self._affine(periods.parameters[0]))
        drive = periods.trajectory
        values = replace(drive, coefficients=drive.coefficients @ gains.T).extremes(0) + offsets.T
        return float(_highest(values, values).max())

    def over(self, periods: Periods, stretches: Stretches, enough: Array) -> tuple[Array, Array]:
        """The larger excess of both ends, and the largest there may be between, (K,) each.

        Nobody needs to know how much less than `enough` (K,) that is: the cheapest bound will do.

        Args:
            periods: of the drives.
            stretches: parts of these, K.
            enough: excess that is known of each already, (K,).
        """
        own = periods.splines(stretches) if self.by_splines else np.zeros((6, len(stretches), self._inputs))
        parts = [
            self._some(periods, stretches.chosen(some), own[:, some], enough[some])
            for some in (slice(first, first + AT_ONCE) for first in range(0, len(stretches), AT_ONCE))
        ]
        found, bounds = zip(*parts, strict=True)
        return np.concatenate(found), np.concatenate(bounds)

    def _some(
        self, periods: Periods, stretches: Stretches, splines: Array, enough: Array
    ) -> tuple[Array, Array]:
        given = periods.table[stretches.row]
        begin, end = stretches.begin[:, None], stretches.end[:, None]
        table, width = np.hstack([given, *splines, begin, end]), end - begin
        if not np.isfinite(self.per_metre):
            over = self._call("over", self._over, table)
            return self._closer(over, width)
        ends = (np.hstack([given, splines[side], at]) for side, at in enumerate((begin, end)))
        values = self._call("at", self._at, np.vstack(list(ends)))
        found = _highest(*np.split(values[:, :-1], 2))
        speeds = values[: len(found), -1]
        bounds = found + self.per_metre * speeds * width[:, 0] * periods.lasting / 2
        near = ~(bounds <= np.maximum(enough, found))
        if near.any():
            _, closer = self._closer(self._call("over", self._over, table[near]), width[near])
            bounds[near] = np.fmin(bounds[near], closer)
        return found, np.maximum(bounds, found)

    def _call(self, name: str, function: ca.Function, table: Array) -> Array:
        # Mapped over a power of two: few maps serve all numbers of stretches.
        count = len(table)
        size = 1 << (count - 1).bit_length()
        if (name, size) not in self._mapped:
            self._mapped[name, size] = DirectCall(_side_by_side(function, size))
        filled = np.vstack([table, np.repeat(table[:1], size - count, axis=0)])
        (found,) = self._mapped[name, size](filled)
        return found.reshape(size, -1)[:count]

    def _closer(self, over: Array, width: Array) -> tuple[Array, Array]:
        # The larger excess of both ends, and the largest between by bounds of values and slopes.
        begin, end, *bounds = np.split(over, 5, axis=1)
        found = _highest(begin, end)
        return found, np.maximum(found, _peaks(begin, end, bounds, width))


def _side_by_side(function: ca.Function, size: int) -> ca.Function:
    # Short functions are compiled once they have been called for long; threads share calls of long ones.
    long = function.n_instructions() > MOST and function.n_instructions() * size > SHARED
    return function.map(size, "thread", THREADS) if long else function.map(size)


def exceeded(rows: Rows) -> Expression:
    """By how much each side of each row is exceeded."""
    values, sides = ca.vec(rows.expression), []
    for sign, bounds in ((1, rows.upper), (-1, rows.lower)):
        places = np.flatnonzero(np.isfinite(bounds))
        if len(places):
            sides.append(sign * (values[places.tolist()] - ca.DM(bounds[places])))
    return ca.densify(ca.vertcat(*sides))


def _symbols(system: System, sensitive: bool) -> list[ca.SX]:
    # State, held inputs, parameters, sensitivities, period.
    states, parameters = len(system.states), len(system.parameters)
    return [
        ca.SX.sym("state", states),
        ca.SX.sym("inputs", len(system.inputs)),
        ca.SX.sym("p", parameters),
        ca.SX.sym("S", states * (parameters + states) if sensitive else 0),
        ca.SX.sym("period"),
    ]


def _affine(excess: Expression, asked: Expression, own: Expression) -> ca.Function | None:
    # parameters -> gains (rows, inputs) and offsets (rows, 1) of rows that are affine in what is asked for
    # and look at nothing else but the parameters.
    gains, offsets = ca.jacobian(excess, asked), ca.substitute(excess, asked, ca.DM.zeros(asked.shape))
    others = [one for one in ca.symvar(ca.veccat(gains, offsets)) if not ca.depends_on(own, one)]
    if others or not ca.depends_on(excess, asked):
        return None
    return ca.Function("affine", [own], [ca.densify(gains), ca.densify(offsets)])


def _highest(begin: Array, end: Array) -> Array:
    # Of all rows at both ends; what is not a number keeps nothing.
    found = np.maximum(begin, end).max(axis=1)
    return np.where(np.isnan(found), np.inf, found)


def _peaks(begin: Array, end: Array, bounds: list[Array], width: Array) -> Array:
    # The highest that any row can be with these values at both ends, between them no more than the first of
    # the bounds and slopes within the others.
    high, least, most = bounds
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        after = (end - begin - least * width) / (most - least)
        between = begin + most * after
    between = np.where(np.isfinite(between), between, np.inf)
    peak = np.where(least >= 0, end, np.where(most <= 0, begin, between))
    peak = np.maximum(peak, np.maximum(begin, end))
    return np.asarray(np.fmin(peak, np.where(np.isnan(high), np.inf, high)).max(axis=1))
