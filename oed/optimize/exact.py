"""Whole readings that are proved to be best, by branch and bound on their relaxations."""

from __future__ import annotations

import heapq
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from oed.foundation.arguments import typed
from oed.foundation.arrays import Array
from oed.kernel.criteria import Criterion
from oed.kernel.equivalence import weight_bound
from oed.kernel.parts import Budget, Parts
from oed.optimize.weights import (
    Weights,
    best_weights,
    criterion_value,
    exceeds,
    exchanged_weights,
    weights_by_budget,
)

NODES = 200
"""Relaxations that are solved by default: some seconds."""
SMALL = 60
"""Number of readings above which branching would hardly improve the first bound in reasonable time."""
INTEGRALITY = 1e-6
"""Distance from a whole number up to which a weight counts as one."""


@dataclass(frozen=True)
class Exact:
    """Best whole readings, and an upper bound on all whole readings.

    Attributes:
        weights: whole weights.
        bound: upper bound on the criterion of all whole readings within the budgets.
        nodes: number of relaxations solved.
    """

    weights: Weights
    bound: float
    nodes: int


@dataclass(frozen=True)
class _Subset:
    """Subset of the whole readings: weights between a lower and an upper number of each, (n,)."""

    low: Array
    high: Array

    def budgets(self, budgets: Sequence[Budget]) -> list[Budget] | None:
        """Return what budgets leave beside the lower numbers; None if no weights keep to them."""
        remaining = list[Budget]()
        for budget in budgets:
            total, tops = budget.total - budget.spent(self.low), (self.high - self.low)[list(budget.places)]
            if not -INTEGRALITY <= total <= float(np.array(budget.sizes) @ tops) + INTEGRALITY:
                return None
            if total > INTEGRALITY:
                remaining.append(replace(budget, total=total, tops=tuple(tops)))
        return remaining


@typed
def exact_weights(
    criterion: Criterion,
    parts: Parts,
    start: Weights,
    budgets: Sequence[Budget],
    nodes: int = NODES,
) -> Exact:
    """Return the best whole readings within budgets, as far as a number of relaxations proves it.

    Args:
        criterion: a concave criterion.
        parts: information of the readings.
        start: whole weights to begin with.
        budgets: budgets of all readings, with totals of whole ones.
        nodes: largest number of relaxations.
    """
    search = _BranchAndBound(criterion, parts, tuple(budgets), start)
    upper = weights_by_budget(budgets, len(parts.readings), lambda budget: budget.upper)
    return search.run(_Subset(np.zeros(len(upper)), upper), nodes if len(upper) <= SMALL else 1)


class _BranchAndBound:
    def __init__(
        self, criterion: Criterion, parts: Parts, budgets: tuple[Budget, ...], start: Weights
    ) -> None:
        self.criterion, self.parts, self.budgets = criterion, parts, budgets
        self.best, self.solved = start, 0
        # The largest bound of nodes that are not branched any further.
        self.closed = -np.inf

    def run(self, first: _Subset, nodes: int) -> Exact:
        """Return the best of all whole readings of a node."""
        waiting = list[tuple[float, int, _Subset, Array]]()
        self._push(waiting, first)
        while waiting and self.solved < nodes and self._promises(-waiting[0][0]):
            negative_bound, _, node, weights = heapq.heappop(waiting)
            children = list(_branches(node, weights))
            if not children:
                self.closed = max(self.closed, -negative_bound)
            for child in children:
                self._push(waiting, child)
        open_bound = -waiting[0][0] if waiting else -np.inf
        return Exact(self.best, max(open_bound, self.closed, self.best.value), self.solved)

    def _promises(self, bound: float) -> bool:
        return exceeds(bound, self.best.value)

    def _push(self, waiting: list[tuple[float, int, _Subset, Array]], node: _Subset) -> None:
        # Adds a node that may hold better weights, with its relaxed weights.
        relaxation = self._relax(node)
        if relaxation is None:
            return
        weights, bound = relaxation
        if np.all(np.abs(weights - np.rint(weights)) < INTEGRALITY):
            self._keep(np.rint(weights))
        if self._promises(bound):
            heapq.heappush(waiting, (-bound, self.solved, node, weights))
        else:
            self.closed = max(self.closed, bound)

    def _keep(self, weights: Array) -> None:
        value = criterion_value(self.criterion, self.parts, weights)
        if value > self.best.value:
            self.best = exchanged_weights(self.criterion, self.parts, weights, self.budgets)

    def _relax(self, node: _Subset) -> tuple[Array, float] | None:
        # The best relaxed weights and their bound, with the lower numbers as prior information; None where
        # no weights are left within the budgets, or none that identify the judged parameters.
        budgets = node.budgets(self.budgets)
        if budgets is None:
            return None
        self.solved += 1
        some = self.parts.taken(node.low, np.arange(len(node.low)))
        best = best_weights(self.criterion, some, budgets)
        if not best.gradient.any():
            return None
        bound = weight_bound(self.criterion, some, best.values, best.gradient, budgets)
        return node.low + best.values, bound


def _branches(node: _Subset, weights: Array) -> Iterator[_Subset]:
    # Two nodes, apart by the weight that is farthest from a whole number; none where all are whole.
    apart = np.abs(weights - np.rint(weights))
    place = int(apart.argmax())
    if apart[place] < INTEGRALITY:
        return
    below = np.floor(weights[place])
    high, low = node.high.copy(), node.low.copy()
    high[place], low[place] = below, below + 1
    yield _Subset(node.low, high)
    yield _Subset(low, node.high)
