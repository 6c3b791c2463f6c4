"""The best mixture of experiments, and the supergradient that bounds all others.

What experiments say adds up, so mixtures of them are weights with given sums: a concave criterion of them has
one maximum.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from oed.foundation.arrays import Array, Places
from oed.kernel.criteria import A, Criterion, D, E
from oed.kernel.measurement.square_root import SquareRoot
from oed.kernel.parts import Budget, Parts, Reading
from oed.optimize.weights import best_weights


@dataclass(frozen=True)
class Mixture:
    """Weights of experiments, and the plane that bounds all others.

    Attributes:
        weights: weight of each experiment, (n,).
        value: the criterion: no mixture of these experiments is much better.
        multiplier: Z >= 0 of what is judged and of what is eliminated, (q, q): trace_bound of its judged part
            and the largest tr(Z M) bounds the criterion.
    """

    weights: Array
    value: float
    multiplier: Array


def mixes(criterion: Criterion) -> bool:
    """Return whether the best mixture bounds a criterion."""
    return type(criterion) in (D, A, E)


def best_mixture(
    criterion: Criterion, matrices: Array, known: Array, judged: int, groups: Places, totals: Array
) -> Mixture | None:
    """Return the weights that maximise E, D or A; None where no mixture identifies everything.

    Args:
        criterion: the criterion of what is left on the first `judged` parameters, the others eliminated.
        matrices: information of each experiment, (n, q, q).
        known: information that is there anyway, (q, q).
        judged: number of parameters.
        groups: number of each experiment's group, from 0, (n,).
        totals: sum of the weights of each group.
    """
    shares = totals[groups] / np.bincount(groups)[groups]
    if not SquareRoot.of_matrix(known + np.tensordot(shares, matrices, axes=1)).complete:
        return None
    count, size, _ = matrices.shape
    parts = Parts(
        (Reading("", 0, 0.0),) * count,
        SquareRoot.of_matrix(matrices).rows.reshape(-1, size),
        np.repeat(np.arange(count), size),
        SquareRoot.of_matrix(known).rows,
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
