"""An interior-point method in NumPy for the weights of readings that maximise a concave criterion.

Logarithmic barriers of size mu keep the weights within their bounds; Newton's method follows the maximum as
mu falls, with multipliers of the bounds as unknowns of their own [Nocedal, Wright, Numerical Optimization,
2006, ch. 14 and 19]. After a step mu is a share of the mean product of a distance and its multiplier, the
smaller the longer the step was. A step for n weights and m columns of curvature costs O(n m^2), m about half
the square of the number of parameters.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from functools import partial

import numpy as np

from oed.foundation.arrays import Array
from oed.optimize.objectives import INSIDE, WeightObjective, longest
from oed.optimize.weight_program import Projection, WeightProgram

TOLERANCE = 1e-11
"""Largest suboptimality of the weights, as a share of the criterion."""
MOST_STEPS = 300
"""Largest number of Newton steps."""
SHORTENINGS = 30
"""Largest number of halvings of a step."""
REFINEMENTS = 2
"""Number of refinements of a Newton step by its residuals."""
SUFFICIENT = 1e-4
"""Share of the rise that the slope promises with which a step is accepted [Armijo, 1966]."""
ROUNDING = 1e-15
"""Share of the barrier function that rounding may take."""


@dataclass(frozen=True)
class Iterate:
    """Iterate of the method: weights, level and multipliers.

    Attributes:
        weights: weights x, (n,).
        level: level t; 0 without a level.
        prices: multipliers of the bounds and inequalities, in the order of `WeightProgram.distances`.
        balance: multipliers of the equalities, (e,).
        dual: multipliers of the level.
        point: information at the weights.
    """

    weights: Array
    level: float
    prices: Array
    balance: Array
    dual: Array
    point: Projection


def maximise(program: WeightProgram, objective: WeightObjective) -> tuple[Array, Array]:
    """Return the weights (n,) that maximise an objective, and its gradient (p, p) by S there.

    Args:
        program: rows and constraints, strictly inside of which all weights can be 1.
        objective: objective of the judged information.
    """
    weights = np.ones(len(program.upper))
    point, distances = program.project(weights), program.distances(weights)
    level, count = objective.first_level(point), len(distances) + objective.barriers
    # The first barriers are each as large as the criterion: equal weights are nearly best then.
    barrier = objective.scale(point, level)
    dual, balance = objective.central(point, level, barrier), np.zeros(len(program.equalities))
    iterate = Iterate(weights, level, barrier / distances, balance, dual, point)
    for _ in range(MOST_STEPS):
        successor, rise, length = _step(program, objective, iterate, barrier)
        iterate, before = successor or iterate, barrier
        tolerance = TOLERANCE * objective.scale(iterate.point, iterate.level)
        # What another step and the barriers may hide of the criterion.
        if count * barrier + rise <= 2 * tolerance:
            break
        products = float(iterate.prices @ program.distances(iterate.weights))
        products += objective.products(iterate.point, iterate.level, iterate.dual)
        barrier = max(min(barrier, (1 - INSIDE * length) * products / count), tolerance / count)
        if successor is None and barrier == before:
            break
    return iterate.weights, objective.gradient(iterate.point, iterate.dual)


def _step(
    program: WeightProgram, objective: WeightObjective, iterate: Iterate, barrier: float
) -> tuple[Iterate | None, float, float]:
    # The iterate after a Newton step, None where rounding leaves none that leads higher; mu times the squared
    # decrement, 0 without a step; and the share of the step that is taken.
    slope = objective.slope(program, iterate.point, iterate.level, barrier, iterate.dual)
    distances = program.distances(iterate.weights)
    # Differences from the current multipliers: the multipliers themselves would lose all digits by
    # cancellation.
    uphill = (
        slope.by_weight + program.weighted_slope(barrier / distances) - program.equalities.T @ iterate.balance
    )
    diagonal, priced = program.weighted_curvature(iterate.prices / distances)
    curvature = np.hstack([slope.curvature, priced])
    level = np.hstack([slope.level_curvature, np.zeros((len(slope.by_level), priced.shape[1]))])
    try:
        system = _NewtonSystem(diagonal, curvature, level, program.equalities)
    except np.linalg.LinAlgError:
        return None, 0.0, 1.0
    change, curved, raised, balance = system.solve(uphill, slope.by_level)
    rise = float(uphill @ change + slope.by_level @ raised)
    moves = program.moves(change)
    prices = barrier / distances - iterate.prices - iterate.prices / distances * moves
    dual = slope.dual_change(curved)
    # One length of all unknowns keeps their products alike.
    length = min(
        longest(distances, moves), longest(iterate.prices, prices), objective.length(iterate.dual, dual)
    )
    before = _barrier_function(program, objective, iterate, barrier)
    rounding = ROUNDING * max(abs(before), objective.scale(iterate.point, iterate.level))
    for _ in range(SHORTENINGS if rise > 0 else 0):
        weights = iterate.weights + length * change
        with suppress(np.linalg.LinAlgError):
            successor = Iterate(
                weights,
                iterate.level + length * float(raised.sum()),
                iterate.prices + length * prices,
                iterate.balance + length * balance,
                iterate.dual + length * dual,
                program.project(weights),
            )
            after = _barrier_function(program, objective, successor, barrier)
            if after >= before + SUFFICIENT * length * rise - rounding:
                return successor, rise, length
        length /= 2
    return None, 0.0, 1.0


def _barrier_function(
    program: WeightProgram, objective: WeightObjective, iterate: Iterate, barrier: float
) -> float:
    value = objective.value(iterate.point, iterate.level, barrier)
    return value + barrier * float(np.log(program.distances(iterate.weights)).sum())


class _NewtonSystem:
    """Linear system of a Newton step.

    Unknowns are the changes dx of the weights, dt of the level, dv of the equalities' multipliers, and y:

        D dx + U y + A'dv = uphill,  y = U'dx + l'dt,  l y = by_level,  A dx = 0.

    It is solved for the shorter of y and dx. Both lose digits where D is small; refinement by the residuals
    of these equations restores them.
    """

    def __init__(self, diagonal: Array, curvature: Array, level: Array, equalities: Array) -> None:
        """Factorise the system.

        Args:
            diagonal: D, (n,).
            curvature: U, (n, m).
            level: l, (h, m).
            equalities: A, (e, n).

        Raises:
            LinAlgError: a system that rounding leaves singular, as of readings that are alike with small
                barriers.
        """
        # Loading SciPy takes longer than a search without weights needs in all.
        from scipy.linalg import lapack

        self.units, self.level = diagonal**-0.5, level
        self.scaled, self.rows = self.units[:, None] * curvature, equalities * self.units
        scaled, rows = self.scaled, self.rows
        count, size = scaled.shape
        self.for_weights = count <= size
        head = min(count, size)
        self.level_at, self.balance_at = slice(head, head + len(level)), slice(head + len(level), None)
        system = np.zeros((head + len(level) + len(rows),) * 2)
        if self.for_weights:
            system[:head, :head] = scaled @ scaled.T
            system[self.level_at, :head] = level @ scaled.T
            system[self.level_at, self.level_at] = level @ level.T
            system[self.balance_at, :head] = rows
        else:
            system[:head, :head] = scaled.T @ scaled
            system[self.level_at, :head] = -level
            system[self.balance_at, :head] = rows @ scaled
            system[self.balance_at, self.balance_at] = rows @ rows.T
        system[:head, head:] = system[head:, :head].T
        system[np.arange(head), np.arange(head)] += 1.0
        self.sizes = np.sqrt(np.abs(np.diag(system)))
        self.sizes[self.sizes == 0] = 1.0
        # LAPACK is called directly: the overhead of SciPy's functions exceeds the work on small systems.
        *factors, singular = lapack.dgetrf(system / np.outer(self.sizes, self.sizes), overwrite_a=True)
        if singular:
            raise np.linalg.LinAlgError("the Newton system is singular")
        self.solution = partial(lapack.dgetrs, *factors)

    def solve(self, uphill: Array, by_level: Array) -> tuple[Array, Array, Array, Array]:
        """Return dx (n,), y (m,), dt (h,) and dv (e,)."""
        right = [self.units * uphill, np.zeros(self.scaled.shape[1]), by_level, np.zeros(len(self.rows))]
        change, curved, raised, balance = self._solve(right)
        for _ in range(REFINEMENTS):
            residuals = [
                right[0] - change - self.scaled @ curved - self.rows.T @ balance,
                change @ self.scaled + raised @ self.level - curved,
                right[2] - self.level @ curved,
                -self.rows @ change,
            ]
            corrections = self._solve(residuals)
            change, curved, raised, balance = (
                value + correction
                for value, correction in zip((change, curved, raised, balance), corrections, strict=True)
            )
        return self.units * change, curved, raised, balance

    def _solve(self, right: list[Array]) -> tuple[Array, Array, Array, Array]:
        # dx in units of D^-1/2, y, dt and dv for any right-hand sides; the second is that of y - U'dx - l'dt.
        first, second, third, fourth = right
        scaled, rows, level = self.scaled, self.rows, self.level
        if self.for_weights:
            sides = [first - scaled @ second, third - level @ second, fourth]
        else:
            sides = [second + first @ scaled, -third, rows @ first - fourth]
        solution = self.solution(np.concatenate(sides) / self.sizes)[0] / self.sizes
        head, raised, balance = solution[: len(sides[0])], solution[self.level_at], solution[self.balance_at]
        if self.for_weights:
            return head, second + head @ scaled + raised @ level, raised, balance
        return first - scaled @ head - rows.T @ balance, head, raised, balance
