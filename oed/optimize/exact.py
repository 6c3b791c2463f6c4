"""Whole readings that are proved to be the best, by branch and bound on their relaxations."""

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
from oed.optimize.weights import Weights, best_weights, exceeds, exchanged_weights

NODES = 200
"""Relaxations that are solved by default: some seconds."""
SMALL = 60
"""Readings from which on the first bound is all that branching would tell in reasonable time."""
WHOLE = 1e-6
"""Distance from a whole number up to which a weight counts as one."""
CLOSE = 1e-9
"""Share of the criterion by which a node has to promise more than the best weights have."""


@dataclass(frozen=True)
class Exact:
    """The best whole readings found, and an upper bound on all others.

    Attributes:
        weights: whole weights.
        bound: upper bound on the criterion of all whole readings within the budgets.
        nodes: number of relaxations solved.
    """

    weights: Weights
    bound: float
    nodes: int


@dataclass(frozen=True)
class _Node:
    """Whole readings between two numbers of each."""

    low: Array
    high: Array


@typed
def exact_weights(
    criterion: Criterion,
    parts: Parts,
    known: Weights,
    budgets: Sequence[Budget],
    nodes: int = NODES,
) -> Exact:
    """Return the best whole readings within budgets, as far as so many relaxations prove it.

    Args:
        criterion: a concave criterion.
        parts: information of the readings.
        known: whole weights to begin with.
        budgets: budgets of all readings, with totals of whole ones.
        nodes: number of relaxations at most.
    """
    search = _Search(criterion, parts, tuple(budgets), known)
    upper = np.zeros(len(parts.readings))
    for budget in budgets:
        upper[list(budget.places)] = budget.upper
    return search.run(_Node(np.zeros(len(upper)), upper), nodes if len(upper) <= SMALL else 1)


class _Search:
    def __init__(
        self, criterion: Criterion, parts: Parts, budgets: tuple[Budget, ...], start: Weights
    ) -> None:
        self.criterion, self.parts, self.budgets = criterion, parts, budgets
        self.best, self.solved = start, 0
        # The largest bound of nodes that are not looked into any further.
        self.closed = -np.inf

    def run(self, first: _Node, nodes: int) -> Exact:
        """Return the best of all whole readings between two numbers of each."""
        waiting = list[tuple[float, int, _Node, Array]]()
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
        return exceeds(bound, self.best.value, CLOSE)

    def _push(self, waiting: list[tuple[float, int, _Node, Array]], node: _Node) -> None:
        # A node that may hold better weights, with its relaxed weights.
        relaxation = self._relaxed(node)
        if relaxation is None:
            return
        weights, bound = relaxation
        if np.all(np.abs(weights - np.rint(weights)) < WHOLE):
            self._keep(np.rint(weights))
        if self._promises(bound):
            heapq.heappush(waiting, (-bound, self.solved, node, weights))
        else:
            self.closed = max(self.closed, bound)

    def _keep(self, weights: Array) -> None:
        value = float(self.criterion.judge([self.parts.root(weights)]))
        if value > self.best.value:
            self.best = exchanged_weights(self.criterion, self.parts, weights, self.budgets)

    def _relaxed(self, node: _Node) -> tuple[Array, float] | None:
        # The best relaxed weights and their bound, with readings that are surely taken as prior information;
        # None where no weights are left within the budgets.
        free = np.flatnonzero(node.high > node.low)
        places = {place: number for number, place in enumerate(free.tolist())}
        budgets = list[Budget]()
        for budget in self.budgets:
            total = budget.total - budget.spent(node.low)
            members = [place for place in budget.places if place in places]
            sizes = [size for place, size in zip(budget.places, budget.sizes, strict=True) if place in places]
            tops = (node.high - node.low)[members]
            if total < -WHOLE or total > float(np.array(sizes) @ tops) + WHOLE:
                return None
            if members and total > WHOLE:
                kept = tuple(places[place] for place in members)
                rest = replace(budget, places=kept, sizes=tuple(sizes), total=total, tops=tuple(tops))
                budgets.append(rest)
        taken = sorted(place for budget in budgets for place in budget.places)
        self.solved += 1
        if not taken:
            return node.low, float(self.criterion.judge([self.parts.root(node.low)]))
        readings = free[taken]
        number = {place: at for at, place in enumerate(taken)}
        budgets = [
            replace(budget, places=tuple(number[place] for place in budget.places)) for budget in budgets
        ]
        some = self.parts.taken(node.low, readings)
        if not self._identifies(some, budgets):
            return None
        best = best_weights(self.criterion, some, budgets)
        weights = node.low.copy()
        weights[readings] += best.values
        return weights, weight_bound(self.criterion, some, best.values, best.gradient, budgets)

    def _identifies(self, parts: Parts, budgets: Sequence[Budget]) -> bool:
        # Whether even weights identify what the criterion asks for: else no choice of readings is any good.
        even = np.zeros(len(parts.readings))
        for budget in budgets:
            even[list(budget.places)] = budget.even * budget.upper
        return bool(self.criterion.identifiable([parts.root(even)]))


def _branches(node: _Node, weights: Array) -> Iterator[_Node]:
    # Two nodes, apart by the weight that is farthest from a whole number; none where all are whole.
    apart = np.abs(weights - np.rint(weights))
    place = int(apart.argmax())
    if apart[place] < WHOLE:
        return
    below = np.floor(weights[place])
    high, low = node.high.copy(), node.low.copy()
    high[place], low[place] = below, below + 1
    yield _Node(node.low, high)
    yield _Node(low, node.high)
