"""The best mixture of experiments, by an interior-point method: where its supergradient bounds all others.

What experiments say adds up, so mixtures of them are weights w with sums given, and a concave criterion of
M = M_0 + sum w_k M_k has one maximum. Logarithmic barriers keep the weights positive; Newton's method follows
the maximum as they fade [Boyd, Vandenberghe: Convex Optimization, 2004, ch. 11].
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from oed.foundation.arrays import Array, Places
from oed.kernel.criteria import A, Criterion, D, E
from oed.kernel.measurement.square_root import SquareRoot

FINEST = 1e-13
"""Size of the last barrier, in units in which the information is of order 1."""
FADING = 0.05
"""Share of a barrier that the next one is."""
MOST_STEPS = 60
"""Newton steps for one barrier at most."""
CENTRED = 1e-10
"""Half the squared Newton decrement, over the barrier, below which the next barrier may come."""
LOST = 1e-15
"""Share of the value below which what a step should gain is lost to rounding."""
SHORTER = 14
"""Times that a step may be too long."""
INSIDE = 0.99
"""Share of the way to the nearest bound that one step may go."""


@dataclass(frozen=True)
class Mixture:
    """Weights of experiments, and the plane that bounds all others.

    Attributes:
        weights: of each, (n,).
        value: of the criterion: no mixture of these experiments is much better.
        multiplier: Z >= 0 of what is judged and of what is eliminated, (q, q): trace_bound of its judged part
            and the largest tr(Z M) bounds the criterion.
    """

    weights: Array
    value: float
    multiplier: Array


def mixes(criterion: Criterion) -> bool:
    """Whether the best mixture by a criterion is known."""
    return type(criterion) in _TERMS


def best_mixture(
    criterion: Criterion,
    matrices: Array,
    known: Array,
    judged: int,
    groups: Places,
    totals: Array,
    finest: float = FINEST,
) -> Mixture | None:
    """The weights that make a criterion of E, D or A largest; None where no mixture identifies everything.

    Args:
        criterion: of what is left on the first `judged` parameters, the others eliminated.
        matrices: information of each experiment, (n, q, q).
        known: information that is there anyway, (q, q).
        judged: number of parameters.
        groups: of which group each experiment is, from 0, (n,).
        totals: of the weights of each group.
        finest: barrier, about the share of its value by which the criterion may be less than the most.
    """
    shares = totals[groups] / np.bincount(groups)[groups]
    whole = known + np.tensordot(shares, matrices, axes=1)
    if not SquareRoot.of_matrix(whole).complete:
        return None
    across, weighing = _scaled(whole, judged)
    terms = _TERMS[type(criterion)](judged, weighing)
    moving = matrices * across * shares[:, None, None]
    if terms.level:
        moving = np.concatenate([moving, -weighing[None]])
    program = _Program(terms, moving, known * across, len(matrices), groups, totals, shares)

    def mixture(point: Array) -> Mixture:
        weights = point[: len(matrices)] * shares
        found = known + np.tensordot(weights, matrices, axes=1)
        own = schur(found, judged)
        gradient = None if terms.level else criterion.supergradient(own)
        if gradient is None:
            multiplier = across * terms.multiplier(program.whole(point))
            multiplier /= np.trace(multiplier[:judged, :judged])
        else:
            back = projection(found, judged)
            multiplier = back.T @ gradient @ back
        return Mixture(weights, float(criterion.value([own])), multiplier)

    def bound(one: Mixture) -> float:
        most = largest(one.multiplier, matrices, groups) @ totals
        return criterion.trace_bound(
            one.multiplier[:judged, :judged], float(most + np.sum(one.multiplier * known))
        )

    # The last ones may have lost more to rounding than they gain.
    return min(map(mixture, program.path(finest)), key=bound)


def _scaled(whole: Array, judged: int) -> tuple[Array, Array]:
    # Units in which all numbers are of order 1, and the sum of the judged parameters' variances in these.
    sizes = np.diag(whole) ** -0.5
    weighing = np.diag((np.arange(len(whole)) < judged) * sizes**2)
    return np.outer(sizes, sizes), weighing / np.trace(weighing)


def largest(multiplier: Array, matrices: Array, groups: Places) -> Array:
    """The largest tr(Z M) of each group's experiments, (groups,)."""
    values = np.einsum("ab,kab->k", multiplier, matrices)
    most = np.full(int(groups.max()) + 1, -np.inf)
    np.maximum.at(most, groups, values)
    return most


def projection(whole: Array, judged: int) -> Array:
    """T = [I, -M12 M22^-1], (judged, q): T M T' is what is left on the judged, the others eliminated."""
    across = np.linalg.solve(whole[judged:, judged:], whole[judged:, :judged]).T
    return np.hstack([np.eye(judged), -across])


def schur(whole: Array, judged: int) -> Array:
    """What is left of M (q, q) on the judged parameters, the others eliminated."""
    back = projection(whole, judged)
    return np.asarray(back @ whole @ back.T)


Derivatives = tuple[float, Array, Array]
"""A value, its gradient and its second derivatives."""


def _volume(whole: Array, matrices: Array) -> Derivatives:
    # log det M along M_k.
    sign, value = np.linalg.slogdet(whole)
    if sign <= 0:
        return -np.inf, np.zeros(0), np.zeros(0)
    each = np.linalg.solve(whole, matrices)
    gradient = np.trace(each, axis1=1, axis2=2)
    flat = each.reshape(len(each), -1)
    return float(value), gradient, -flat @ each.transpose(0, 2, 1).reshape(len(each), -1).T


@dataclass(frozen=True)
class _Terms(ABC):
    """A criterion of M(v) that is to be large.

    Attributes:
        judged: number of parameters.
        weighing: of what is judged, diagonal, (q, q).
        level: whether a level t, the last of v, is to be large in its place.
    """

    judged: int
    weighing: Array
    level: bool = False

    @abstractmethod
    def derivatives(self, whole: Array, matrices: Array, barrier: float) -> Derivatives:
        """Of the criterion by v; minus infinity where it has no value.

        Args:
            whole: M(v), (q, q).
            matrices: its derivatives by v, (n, q, q).
            barrier: that keeps a level below the criterion.
        """

    def multiplier(self, whole: Array) -> Array:
        """Z of a level, up to its size, where M(v) is `whole`."""
        inverse = np.linalg.inv(whole)
        return np.asarray((inverse + inverse.T) / 2)


class _DTerms(_Terms):
    """Log det of what is left."""

    def derivatives(self, whole: Array, matrices: Array, barrier: float) -> Derivatives:
        value, gradient, second = _volume(whole, matrices)
        if self.judged == len(whole) or not np.isfinite(value):
            return value, gradient, second
        own = slice(self.judged, None)
        less, slope, curve = _volume(whole[own, own], matrices[:, own, own])
        return value - less, gradient - slope, second - curve


class _ATerms(_Terms):
    """Minus the weighted sum of variances."""

    def derivatives(self, whole: Array, matrices: Array, barrier: float) -> Derivatives:
        if np.linalg.slogdet(whole)[0] <= 0:
            return -np.inf, np.zeros(0), np.zeros(0)
        inverse = np.linalg.inv(whole)
        spread, each = inverse @ self.weighing, inverse @ matrices
        both = spread @ each
        value, gradient = -float(np.trace(spread)), np.einsum("kab,ba->k", each, spread)
        half = both.reshape(len(both), -1) @ each.transpose(0, 2, 1).reshape(len(both), -1).T
        return value, gradient, -(half + half.T)


class _ETerms(_Terms):
    """A level t with M - t weighing >= 0, kept so by a barrier."""

    def derivatives(self, whole: Array, matrices: Array, barrier: float) -> Derivatives:
        value, gradient, second = _volume(whole, matrices)
        if np.isfinite(value) and np.linalg.eigvalsh(whole)[0] <= 0:
            value = -np.inf
        return barrier * value, barrier * gradient, barrier * second


_TERMS: dict[type[Criterion], Callable[[int, Array], _Terms]] = {
    D: _DTerms,
    A: _ATerms,
    E: partial(_ETerms, level=True),
}


@dataclass(frozen=True)
class _Program:
    # Weights are in units of even shares.
    terms: _Terms
    moving: Array
    known: Array
    count: int
    groups: Places
    totals: Array
    shares: Array

    def whole(self, point: Array) -> Array:
        return np.asarray(self.known + (point[None] @ self._flat).reshape(self.known.shape))

    @cached_property
    def _flat(self) -> Array:
        return self.moving.reshape(len(self.moving), -1)

    @cached_property
    def rows(self) -> Array:
        # Of the weights' sums.
        rows = np.zeros((len(self.totals), len(self.moving)))
        rows[self.groups, np.arange(self.count)] = self.shares / self.totals[self.groups]
        return rows

    def path(self, finest: float) -> Iterator[Array]:
        """Where the last barriers lead to."""
        point = np.ones(len(self.moving))
        if self.terms.level:
            # M - t weighing is positive definite for any t below 0.
            point[-1] = -1.0
        barrier = 1.0
        while barrier > finest:
            here = self._all(point, barrier)
            for _ in range(MOST_STEPS):
                moved = self._moved(point, here, barrier)
                if moved is None:
                    break
                point, here, near = moved
                if near:
                    break
            barrier *= FADING
            if barrier < finest / FADING**3:
                yield point

    def _all(self, point: Array, barrier: float) -> Derivatives:
        weights = point[: self.count]
        value, gradient, second = self.terms.derivatives(self.whole(point), self.moving, barrier)
        if not np.isfinite(value):
            return value, gradient, second
        gradient, second = gradient.copy(), second.copy()
        gradient[: self.count] += barrier / weights
        second[np.arange(self.count), np.arange(self.count)] -= barrier / weights**2
        if self.terms.level:
            value += point[-1]
            gradient[-1] += 1.0
        return value + barrier * float(np.log(weights).sum()), gradient, second

    def _moved(
        self, point: Array, here: Derivatives, barrier: float
    ) -> tuple[Array, Derivatives, bool] | None:
        # One damped Newton step, what is there, and whether it was hardly needed; None if it leads nowhere.
        (value, gradient, second), count = here, len(point)
        # In the weights' own units, or those that fade would hide the others.
        units = np.ones(count)
        units[: self.count] = point[: self.count]
        rows = self.rows * units
        system = np.zeros((count + len(rows),) * 2)
        system[:count, :count] = second * np.outer(units, units)
        system[count:, :count], system[:count, count:] = rows, rows.T
        right = np.zeros(len(system))
        right[:count] = -gradient * units
        step = units * _solution(system, right)[:count]
        rise = float(gradient @ step)
        if not np.isfinite(rise) or rise <= LOST * abs(value):
            return None
        ratios = step[: self.count] / point[: self.count]
        length = min(1.0, INSIDE / max(-ratios.min(), 1e-300))
        for _ in range(SHORTER):
            trial = point + length * step
            there = self._all(trial, barrier)
            if there[0] >= value + 1e-4 * length * rise - 1e-15 * abs(value):
                return trial, there, rise / 2 <= CENTRED * barrier
            length /= 4
        return None


def _solution(system: Array, right: Array) -> Array:
    try:
        return np.asarray(np.linalg.solve(system, right))
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.lstsq(system, right, rcond=1e-15)[0])


def evenly(count: int) -> tuple[Places, Array]:
    """Groups and totals of experiments of which one is made."""
    return np.zeros(count, dtype=np.int64), np.ones(1)


__all__: Sequence[str] = ["Mixture", "best_mixture", "evenly", "mixes", "projection", "schur"]
