"""Best mixture of experiments, and the supergradient that bounds all mixtures.

The information of experiments adds up, so a mixture is a set of weights with given sums, and a concave
criterion of the weights has one maximum.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from oed.foundation.arrays import Array, Places
from oed.kernel.criteria import Criterion
from oed.kernel.measurement.square_root import SquareRoot
from oed.kernel.parts import Budget, Parts, Reading
from oed.optimize.weights import best_weights


@dataclass(frozen=True)
class Mixture:
    """Optimal weights of experiments, and the supergradient that bounds all weights.

    Attributes:
        weights: weight of each experiment, (n,).
        value: criterion of the mixture, maximal to the solver's tolerance.
        multiplier: matrix Z >= 0 of all parameters, judged and eliminated, (q, q): `trace_bound` of its
            judged part and the largest tr(Z M) bounds the criterion.
    """

    weights: Array
    value: float
    multiplier: Array


def best_mixture(
    criterion: Criterion, matrices: Array, prior: Array, judged: int, groups: Places, totals: Array
) -> Mixture | None:
    """Return the weights that maximise E, D or A; None if no mixture identifies all parameters.

    Args:
        criterion: criterion of the information about the first `judged` parameters, the others eliminated.
        matrices: information of each experiment, (n, q, q).
        prior: information without any experiment, (q, q).
        judged: number of judged parameters.
        groups: index of each experiment's group, (n,).
        totals: sum of the weights of each group, (groups,).
    """
    shares = totals[groups] / np.bincount(groups)[groups]
    if not SquareRoot.of_matrix(prior + np.tensordot(shares, matrices, axes=1)).complete:
        return None
    count, size, _ = matrices.shape
    parts = Parts(
        (Reading("", 0, 0.0),) * count,
        SquareRoot.of_matrix(matrices).rows.reshape(-1, size),
        np.repeat(np.arange(count), size),
        SquareRoot.of_matrix(prior).rows,
        judged,
        np.ones(count),
        tuple((place,) for place in range(count)),
    )
    members = [np.flatnonzero(groups == group).tolist() for group in range(len(totals))]
    budgets = [
        Budget(tuple(places), (1.0,) * len(places), float(total), float(total))
        for places, total in zip(members, totals, strict=True)
    ]
    best = best_weights(criterion, parts, budgets)
    back = parts.projection(best.values)
    return Mixture(best.values, best.value, back.T @ best.gradient @ back)
