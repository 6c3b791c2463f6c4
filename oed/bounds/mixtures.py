"""Best mixtures of experiments, with the multiplier that bounds all mixtures.

A concave criterion of weights with given sums has one maximum, with a supergradient Z there, and no weights
have more than its plane allows: the maximum of tr(Z M) over the experiments [Kiefer, Wolfowitz, The
equivalence of two extremum problems, 1960].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from oed.foundation.arrays import Array, Places
from oed.kernel.criteria import Criterion
from oed.kernel.equivalence import root_of
from oed.kernel.parts import Budget, Parts, Reading
from oed.optimize.weights import best_weights


@dataclass(frozen=True)
class Mixture:
    """Optimal weights of experiments, and the supergradient that bounds all weights.

    Attributes:
        weights: weight of each experiment, (n,).
        value: criterion of the mixture, maximal to the solver's tolerance.
        root: root U of the multiplier Z = U'U of all parameters, judged and eliminated, (judged, q):
            `trace_bound` of its judged part and the largest tr(Z M) bounds the criterion.
    """

    weights: Array
    value: float
    root: Array

    @property
    def multiplier(self) -> Array:
        """Multiplier Z >= 0, (q, q)."""
        return np.asarray(self.root.T @ self.root)


def best_mixture(
    criterion: Criterion,
    experiments: Sequence[Array],
    known_rows: Array,
    judged: int,
    groups: Places,
    totals: Array,
) -> Mixture | None:
    """Return the weights that maximise E, D or A; None if no mixture identifies the judged parameters.

    Args:
        criterion: criterion of the information about the first `judged` parameters, the others eliminated.
        experiments: rows R (k, q) of each experiment, whose information is R'R.
        known_rows: rows of the information without any experiment, (m, q).
        judged: number of judged parameters.
        groups: index of each experiment's group, (n,).
        totals: sum of the weights of each group, (groups,).
    """
    count = len(experiments)
    parts = Parts(
        (Reading("", 0, 0.0),) * count,
        np.concatenate(experiments),
        np.repeat(np.arange(count), [len(rows) for rows in experiments]),
        known_rows,
        judged,
        np.ones(count),
        tuple((place,) for place in range(count)),
    )
    budgets = []
    for group, total in enumerate(totals.tolist()):
        members = np.flatnonzero(groups == group).tolist()
        budgets.append(Budget(tuple(members), (1.0,) * len(members), total, total))
    best = best_weights(criterion, parts, budgets)
    if not best.gradient.any():
        return None
    return Mixture(best.values, best.value, root_of(best.gradient).T @ parts.projection(best.values))
