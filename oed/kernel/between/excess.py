"""Excess of a limit: its value at an instant, and an upper bound over a stretch of a sample period."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.kernel.between.periods import Periods, Stretches
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.interval_function import IntervalFunction
from oed.kernel.dynamics.rollout import Instant, instant_of
from oed.kernel.dynamics.system import System
from oed.kernel.limit import Rows

AT_ONCE = 1024
"""Stretches bounded in one call: their numbers fit into a processor's cache."""


class Excess:
    """Excess of a limit's rows at an instant, and its upper bound over a stretch of a period.

    Attributes:
        size: size of the limit.
        per_metre: most that the rows change per metre of way at the mean speed of a period.
        reads_splines: the rows depend on the inputs' splines between the middles of the periods.
        is_bounded: every operation of the rows has bounds.
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
        """Write the rows of an instant.

        Args:
            rows_of: function that returns the rows of an instant.
            system: system that is driven.
            per_metre: most that the rows change per metre of way at the mean speed of a period.
            sensitive: the rows depend on sensitivities of the state.
            run: place of the run that the instants belong to.
        """
        states, inputs, parameters = len(system.states), len(system.inputs), len(system.parameters)
        state, held, spline = (
            ca.SX.sym("state", states),
            ca.SX.sym("held", inputs),
            ca.SX.sym("spline", inputs),
        )
        parameter, period = ca.SX.sym("p", parameters), ca.SX.sym("period")
        slopes = ca.SX.sym("S", states * (parameters + states) if sensitive else 0)
        fraction = ca.SX.sym("fraction")
        instant = instant_of(
            system,
            state=state,
            held=held,
            parameters=parameter,
            period=period,
            asked=spline,
            fraction=fraction,
            sensitivities=ca.reshape(slopes, states, -1) if sensitive else None,
            run=run,
        )
        rows = rows_of(instant)
        excess = ca.cse(exceeded(rows))
        arguments = ca.vertcat(state, held, parameter, slopes, period, spline, fraction)
        self.size, self.per_metre = rows.size, per_metre
        self.reads_splines = bool(ca.depends_on(excess, spline))
        # A stretch moves the fraction, and the splines with it, whose slopes by the fraction are given too.
        rates = ca.SX.sym("rates", inputs)
        by_fraction = ca.jtimes(excess, ca.vertcat(spline, fraction), ca.vertcat(rates, 1))
        last = arguments.numel() - 1
        moving = [last, *(range(last - inputs, last + 1 + inputs) if self.reads_splines else ())]
        rows = ca.Function("excess", [arguments, rates], [excess, ca.densify(by_fraction)])
        self._rows = IntervalFunction(rows, moving)
        self._speed = IntervalFunction(ca.Function("speed", [arguments], [instant.speeds]), ())
        self._affine = _affine_in(excess, spline, parameter)
        self.is_bounded = self._rows.is_bounded

    def everywhere(self, periods: Periods) -> Stretches:
        """Return all periods, cut at the splines' knots if the rows read the splines."""
        return periods.pieces if self.reads_splines else periods.entire

    def exact_most(self, periods: Periods) -> float | None:
        """Return the largest excess on one drive if the rows are affine in the splines, else None.

        Such rows are splines themselves, whose extremes are known.
        """
        if self._affine is None:
            return None
        gains, offsets = (np.array(part) for part in self._affine(periods.parameters[0]))
        drive = periods.trajectory
        values = replace(drive, coefficients=drive.coefficients @ gains.T).extremes(0) + offsets.T
        return float(_nan_as_infinite(values.T).max())

    def over(self, periods: Periods, stretches: Stretches, enough: Array) -> tuple[Array, Array]:
        """Return the larger excess of both ends and an upper bound of the excess between, (K,) each.

        The bound is a cheap one where that is at most `enough`.

        Args:
            periods: periods of the drives.
            stretches: parts of these periods, K.
            enough: excess that is known already, (K,).
        """
        parts = [
            self._over(periods, stretches.chosen(part), enough[part])
            for part in (slice(first, first + AT_ONCE) for first in range(0, len(stretches), AT_ONCE))
        ]
        values, bounds = zip(*parts, strict=True)
        return np.concatenate(values), np.concatenate(bounds)

    def _over(self, periods: Periods, stretches: Stretches, enough: Array) -> tuple[Array, Array]:
        begins, count = periods.begins[:, stretches.row], len(stretches)
        fractions = np.array([stretches.begin, stretches.end])
        width, inputs = fractions[1] - fractions[0], periods.held.shape[1]
        ends, (values, slopes) = np.zeros((2, inputs, count)), np.zeros((2, inputs, count))
        if self.reads_splines:
            ends, (values, slopes) = periods.splines(stretches)
        both = [*np.tile(begins, 2), *np.hstack(list(ends)), fractions.ravel()]
        begin, end = np.split(_table(self._rows.exact(both), 2 * count), 2, axis=1)
        most, bounds = _most(np.maximum(begin, end)), np.full(count, np.inf)
        if np.isfinite(self.per_metre):
            (speed,) = self._speed.exact([*begins, *ends[0], fractions[0]])
            bounds = most + self.per_metre * speed * width * periods.duration / 2
        near = ~(bounds <= np.maximum(enough, most))
        if near.any():
            moving = [*values[..., near], fractions[:, near], *slopes[..., near]]
            row_values, row_slopes = self._rows.bounds([*begins[:, near], *moving])
            peaks = _peaks(begin[:, near], end[:, near], row_values, row_slopes, width[near])
            bounds[near] = np.minimum(bounds[near], _most(peaks))
        return most, np.maximum(bounds, most)


def exceeded(rows: Rows) -> Expression:
    """Return the excess of each side of each row."""
    values, sides = ca.vec(rows.expression), []
    for sign, bounds in ((1, rows.upper), (-1, rows.lower)):
        places = np.flatnonzero(np.isfinite(bounds))
        if len(places):
            sides.append(sign * (values[places.tolist()] - ca.DM(bounds[places])))
    return ca.densify(ca.vertcat(*sides))


def _affine_in(excess: Expression, spline: Expression, parameter: Expression) -> ca.Function | None:
    # parameters -> gains (rows, inputs) and offsets (rows, 1) of rows that are affine in the splines and
    # depend on nothing else but the parameters.
    gains, offsets = ca.jacobian(excess, spline), ca.substitute(excess, spline, ca.DM.zeros(spline.shape))
    symbols = ca.symvar(ca.veccat(gains, offsets))
    if not all(ca.depends_on(parameter, symbol) for symbol in symbols) or not ca.depends_on(excess, spline):
        return None
    return ca.Function("affine", [parameter], [ca.densify(gains), ca.densify(offsets)])


def _table(rows: Sequence[Any], count: int) -> Array:
    return np.stack([np.broadcast_to(row, count) for row in rows])


def _nan_as_infinite(values: Array) -> Array:
    # A value that is no number satisfies no limit.
    return np.where(np.isnan(values), np.inf, values)


def _most(values: Array) -> Array:
    return np.asarray(_nan_as_infinite(values).max(axis=0))


def _peaks(begin: Array, end: Array, values: Array, slopes: Array, width: Array) -> Array:
    # The highest values (rows, K) that rows with these ends and bounds of value and slope can have between.
    least, most = slopes[:, 0], slopes[:, 1]
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        between = begin + most * (end - begin - least * width) / (most - least)
    between = np.where(np.isfinite(between), between, np.inf)
    peak = np.where(least >= 0, end, np.where(most <= 0, begin, between))
    return np.asarray(np.minimum(np.maximum(peak, np.maximum(begin, end)), values[:, 1]))
