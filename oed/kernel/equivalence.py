"""How good any choice of readings can be: the equivalence theorem of concave criteria.

[Kiefer and Wolfowitz, The equivalence of two extremum problems, 1960; Pukelsheim, Optimal Design of
Experiments, 1993]
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from oed.foundation.arguments import typed
from oed.foundation.arrays import Array
from oed.kernel.criteria import Criterion
from oed.kernel.parts import Budget, Parts


def directional_derivatives(parts: Parts, weights: Array, gradient: Array) -> Array:
    """tr(G F) that every reading adds at a weight of 1, (n,): the switching function.

    Args:
        parts: of the information.
        weights: of the readings, (n,).
        gradient: G, a supergradient of the criterion at these, (judged, judged).
    """
    whole = _on_all(parts, weights, gradient)
    return np.asarray(np.einsum("ab,nba->n", whole, parts.matrices))


@typed
def weight_bound(
    criterion: Criterion, parts: Parts, weights: Array, gradient: Array, budgets: Sequence[Budget]
) -> float:
    """What no weights of the readings within budgets exceed by a criterion.

    The others' elimination only lowers tr(G F): with T of these weights, tr(G F') <= tr(T'GT M').
    Infinite where there is no such plane, as of weights that leave undetermined what the criterion asks for.

    Args:
        criterion: concave, of one block.
        parts: of the information.
        weights: of the readings, where the plane touches, (n,).
        gradient: a supergradient there, (judged, judged).
        budgets: of all readings.
    """
    if not np.all(np.isfinite(gradient)) or not np.any(gradient):
        return float(np.inf)
    values = directional_derivatives(parts, weights, gradient)
    most = float(np.trace(_on_all(parts, weights, gradient) @ parts.known))
    most += sum(one.largest(values) for one in budgets)
    return criterion.homogeneous_bound(parts.information(weights), gradient, most)


def _on_all(parts: Parts, weights: Array, gradient: Array) -> Array:
    # T'GT, (q, q).
    back = parts.projection(weights)
    return np.asarray(back.T @ gradient @ back)
