"""Logs linear about paths: sizes of the errors by restricted likelihood, and steps of the unknowns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from oed.estimation.methods.fit import Fit, combinations, degrees_of
from oed.estimation.methods.log_errors import DRIFT, FARTHEST, SIZES, ErrorSizes, drift_shows
from oed.estimation.methods.log_filter import POSE, LogFilter
from oed.estimation.methods.smoothing import smoothed
from oed.foundation.arrays import Array, Places

ENOUGH = 0.02
"""Change of -2 times the likelihood's logarithm at which a search for sizes has arrived."""
STEP = 0.05
"""Of logarithms of sizes, for second derivatives of the likelihood."""


@dataclass(frozen=True)
class LinearLogs:
    """All stretches of the logs, linear about unknowns and paths.

    Attributes:
        filters: those of the stretches.
        fit: the fit that the search began from.
        known: information on the unknowns from before, (q, q).
        pull: half the gradient of its misfit, (q,).
        misfit: its misfit less that of the fit.
    """

    filters: tuple[LogFilter, ...]
    fit: Fit
    known: Array
    pull: Array
    misfit: float

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return len(self.pull)

    def likelier(self, errors: ErrorSizes, begin: Array) -> Array:
        """Return logarithms of sizes that are no less likely than those given, (13,).

        The most likely ones presume the best step of the unknowns. Where that leads beyond what is linear
        they may be far off: then those without a step are taken.
        """
        least = self.score(errors, begin)
        for moves in (True, False):
            log_sizes = self.likeliest(errors, begin, moves=moves)
            if self.score(errors, log_sizes) <= least:
                return log_sizes
        return begin

    def likeliest(self, errors: ErrorSizes, begin: Array, *, moves: bool = True) -> Array:
        """Return the most likely logarithms of sizes, (13,), after the best step of the unknowns or none."""
        free = np.flatnonzero(errors.free)
        if not len(free):
            return begin

        def surprise(free_sizes: Array) -> tuple[float, Array]:
            log_sizes = begin.copy()
            log_sizes[free] = free_sizes
            value, slope = self.surprise(errors, log_sizes, moves=moves)
            return value, slope[free]

        bounds = np.column_stack([errors.guess - FARTHEST, errors.guess + FARTHEST])[free]
        options = {"maxiter": 100, "ftol": ENOUGH / max(abs(surprise(begin[free])[0]), 1.0)}
        minimum = scipy.optimize.minimize(
            surprise, begin[free], jac=True, method="L-BFGS-B", bounds=bounds, options=options
        )
        log_sizes = begin.copy()
        log_sizes[free] = minimum.x
        return log_sizes

    def surprise(self, errors: ErrorSizes, log_sizes: Array, *, moves: bool = True) -> tuple[float, Array]:
        """Return -2 times the logarithm of the restricted likelihood, but for a constant, and its slope by
        the logarithms of sizes, (13,).

        Args:
            errors: prior of the sizes.
            log_sizes: logarithms of sizes, (13,).
            moves: whether the likelihood is that after the best step of the unknowns, or without a step.
        """
        square, volume = self._square(log_sizes)
        inverse, more = self._inverse(square)
        pull = square[:-1, -1]
        best = inverse @ pull if moves else np.zeros_like(pull)
        before, slope = errors.surprise(log_sizes)
        value = volume + more + float(square[-1, -1] - pull @ best) + before
        by_square = np.zeros_like(square)
        by_square[:-1, :-1] = inverse + np.outer(best, best)
        by_square[:-1, -1] = by_square[-1, :-1] = -best
        by_square[-1, -1] = 1.0
        for one, places in zip(self.filters, self._places, strict=True):
            slope = slope + one.slope(log_sizes, by_square[np.ix_(places, places)])
        return value, slope

    def score(self, errors: ErrorSizes, log_sizes: Array) -> float:
        """Return -2 times the logarithm of the restricted likelihood of unknowns and paths as they are."""
        square, volume = self._square(log_sizes)
        return volume + self._inverse(square)[1] + float(square[-1, -1]) + errors.surprise(log_sizes)[0]

    def step(self, log_sizes: Array, *, hold_clocks: bool = False) -> tuple[Array, Array]:
        """Return the best step of the unknowns and all starts, and the covariance of the unknowns."""
        square, _ = self._square(log_sizes)
        inverse, _ = self._inverse(square)
        step = np.asarray(-inverse @ square[:-1, -1])
        if hold_clocks:
            clocks = slice(self.size - self.fit.unknowns.clocks, self.size)
            step -= inverse[:, clocks] @ np.linalg.solve(inverse[clocks, clocks], step[clocks])
        return step, inverse[: self.size, : self.size]

    def _inverse(self, square: Array) -> tuple[Array, float]:
        # Of the normal matrix, in units in which unknowns and starts compare; and the logarithm of its
        # determinant in these.
        units = np.append(self.fit.unknowns.scale, np.ones(POSE * len(self.filters)))
        scale = np.outer(units, units)
        scaled = square[:-1, :-1] * scale
        return np.linalg.inv(scaled) * scale, float(np.linalg.slogdet(scaled)[1])

    def smoothed(self, log_sizes: Array, step: Array, paths: Sequence[Array]) -> list[Array]:
        """Return the most likely paths after a step of the unknowns and starts."""
        found, whole = [], np.append(step, 1.0)
        for one, places, path in zip(self.filters, self._places, paths, strict=True):
            found.append(path + smoothed(one.passed(log_sizes), whole[places][None])[0, :, :POSE])
        return found

    def spread(self, errors: ErrorSizes, log_sizes: Array) -> Array:
        """Return the covariance of the logarithms of sizes, (13, 13), by differences of slopes."""
        free = np.flatnonzero(errors.free)
        found = np.zeros((len(log_sizes),) * 2)
        if not len(free):
            return found
        second, here = np.empty((len(free), len(free))), self.surprise(errors, log_sizes)[1][free]
        for column, place in enumerate(free):
            off = np.zeros(len(log_sizes))
            off[place] = STEP
            second[:, column] = (self.surprise(errors, log_sizes + off)[1][free] - here) / STEP
        # Of twice the logarithm; never surer than the prior alone would be of what curves the wrong way.
        values, vectors = np.linalg.eigh((second + second.T) / 4)
        least = 1 / errors.spread[free].max() ** 2
        inverse = (vectors / np.maximum(values, least)) @ vectors.T
        found[np.ix_(free, free)] = inverse
        return found

    def drifts(self, errors: ErrorSizes, log_sizes: Array) -> bool | None:
        """Say whether drift shows, against the most likely sizes of all else without it."""
        places = [SIZES.index(name) for name in DRIFT]
        if not np.any(errors.free[places]):
            return None
        none = errors.without(DRIFT)
        begin = np.where(none.free, log_sizes, none.guess)
        odds = self.surprise(errors, log_sizes)[0] - self.surprise(none, self.likeliest(none, begin))[0]
        return drift_shows(odds)

    def degrees(self, log_sizes: Array, spread: Array) -> tuple[float, float]:
        """Return degrees of freedom by how unsure the sizes leave variances: those of parameters, and of
        combinations of them.
        """
        own = slice(len(self.fit.unknowns.parameters))
        ways = np.hstack([np.eye(own.stop), combinations(self.step(log_sizes)[1][own, own])])
        slopes = np.zeros((len(log_sizes), ways.shape[1]))
        for place in np.flatnonzero(np.diag(spread)):
            off = np.zeros(len(log_sizes))
            off[place] = STEP
            each = (self.step(log_sizes + way * off)[1][own, own] for way in (1, -1))
            sizes = [np.log(np.einsum("au,ab,bu->u", ways, one, ways)) for one in each]
            slopes[place] = np.subtract(*sizes) / (2 * STEP)
        unsure = np.einsum("ku,kl,lu->u", slopes, spread, slopes)
        return degrees_of(unsure[own].max(initial=0.0)), degrees_of(unsure.max(initial=0.0))

    def _square(self, log_sizes: Array) -> tuple[Array, float]:
        # Of all unknowns, starts and 1; what is known from before included.
        width = self.size + POSE * len(self.filters) + 1
        total, volume = np.zeros((width, width)), 0.0
        for one, places in zip(self.filters, self._places, strict=True):
            equations = one.normal_equations(log_sizes)
            total[np.ix_(places, places)] += equations.square
            volume += equations.volume
        total[: self.size, : self.size] += self.known
        total[: self.size, -1] += self.pull
        total[-1, : self.size] += self.pull
        total[-1, -1] += self.misfit
        return total, volume

    @cached_property
    def _places(self) -> list[Places]:
        found = []
        for number, one in enumerate(self.filters):
            first = self.size + POSE * number
            last = self.size + POSE * len(self.filters)
            found.append(np.array([*one.columns, *range(first, first + POSE), last]))
        return found
