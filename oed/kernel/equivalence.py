"""Upper bounds on any choice of readings by the equivalence theorem of concave criteria.

[Kiefer and Wolfowitz, The equivalence of two extremum problems, 1960; Pukelsheim, Optimal Design of
Experiments, 1993]
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from oed.foundation.arguments import typed
from oed.foundation.arrays import Array
from oed.kernel.criteria import Criterion
from oed.kernel.parts import Budget, Cost, Parts


def directional_derivatives(parts: Parts, weights: Array, gradient: Array) -> Array:
    """tr(G F) that every reading adds at a weight of 1, (n,): the switching function.

    Args:
        parts: information of the readings.
        weights: weights of the readings, (n,).
        gradient: G, a supergradient of the criterion at these, (judged, judged).
    """
    return _added(parts, parts.projection(weights).T @ root_of(gradient))


@typed
def weight_bound(
    criterion: Criterion,
    parts: Parts,
    weights: Array,
    gradient: Array,
    budgets: Sequence[Budget],
    costs: Sequence[Cost] = (),
) -> float:
    """Return an upper bound on a criterion over all weights of the readings within budgets.

    Infinite where there is no such plane, as of weights that leave undetermined what the criterion asks for.

    Args:
        criterion: concave, of one block.
        parts: information of the readings.
        weights: weights of the readings, where the plane touches, (n,).
        gradient: a supergradient there, (judged, judged).
        budgets: budgets of all readings.
        costs: costs that the weights may not exceed.
    """
    if not np.all(np.isfinite(gradient)) or not np.any(gradient):
        return float(np.inf)
    # The others' elimination only lowers tr(G F): with T of these weights, tr(G F') <= tr(T'GT M').
    # By a root of G, and of exactly that product: rounding of G is no matter then, and that of rows small.
    root = root_of(gradient)
    back = parts.projection(weights).T @ root
    values = _added(parts, back)
    most = float(((parts.known_rows @ back) ** 2).sum())
    most += _largest(values, budgets, costs)
    return criterion.homogeneous_bound(parts.information(weights), root, most)


def _largest(values: Array, budgets: Sequence[Budget], costs: Sequence[Cost]) -> float:
    # The largest weighted sum of values (n,). Any multipliers of the costs bound it; those of the linear
    # program make the bound tight. Beside costs, budgets need not be spent.
    if not costs:
        return sum(budget.largest(values) for budget in budgets)
    spent, upper = np.zeros((len(budgets), len(values))), np.zeros(len(values))
    for row, budget in zip(spent, budgets, strict=True):
        row[list(budget.places)], upper[list(budget.places)] = budget.sizes, budget.upper
    prices = np.array([cost.sizes for cost in costs])
    totals, most = [budget.total for budget in budgets], np.array([cost.most for cost in costs])
    limits = {"A_ub": np.vstack([prices, spent]), "b_ub": np.concatenate([most, totals])}
    solution = scipy.optimize.linprog(
        -values, bounds=np.stack([np.zeros(len(upper)), upper], axis=1), **limits
    )
    multipliers = np.zeros(len(costs))
    if solution.success:
        multipliers = np.clip(-solution.ineqlin.marginals[: len(costs)], 0.0, None)
    reduced = np.clip(values - multipliers @ prices, 0.0, None)
    return float(multipliers @ most) + sum(budget.largest(reduced) for budget in budgets)


def root_of(gradient: Array) -> Array:
    """S, (p, p), with S S' the supergradient G but for rounding: what is negative in it is left out."""
    sizes = np.sqrt(np.clip(np.diag(gradient), 0.0, None))
    units = np.where(sizes > 0, sizes, 1.0)
    values, vectors = np.linalg.eigh(gradient / np.outer(units, units))
    return np.asarray(units[:, None] * vectors * np.sqrt(np.clip(values, 0.0, None)))


def _added(parts: Parts, back: Array) -> Array:
    # tr(G T M T') of what every reading adds, (n,), with T'S for the root S of G.
    squares = ((parts.rows @ back) ** 2).sum(axis=1)
    return np.asarray(np.bincount(parts.places, squares, minlength=len(parts.readings)), dtype=float)
