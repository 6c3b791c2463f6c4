"""Whole readings that are proved to be the best there are, by branch and bound on their relaxations."""

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
"""By how much a weight may miss a whole number and still be one."""
CLOSE = 1e-9
"""Share of the criterion by which a node has to promise more than is known."""


@dataclass(frozen=True)
class Exact:
    """The best whole readings known, and what no others exceed.

    Attributes:
        weights: whole ones.
        bound: on the criterion of all whole readings within the budgets.
        nodes: relaxations solved.
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
    """The best whole readings within budgets, as far as so many relaxations prove it.

    Args:
        criterion: concave.
        parts: of the information.
        known: whole weights to begin with.
        budgets: of all readings, with totals of whole ones.
        nodes: relaxations at most.
    """
    search = _Search(criterion, parts, tuple(budgets), known)
    upper = np.zeros(len(parts.readings))
    for one in budgets:
        upper[list(one.places)] = one.upper
    return search.run(_Node(np.zeros(len(upper)), upper), nodes if len(upper) <= SMALL else 1)


class _Search:
    def __init__(
        self, criterion: Criterion, parts: Parts, budgets: tuple[Budget, ...], known: Weights
    ) -> None:
        self.criterion, self.parts, self.budgets = criterion, parts, budgets
        self.best, self.solved = known, 0

    def run(self, first: _Node, nodes: int) -> Exact:
        """The best of all whole readings between two numbers of each."""
        waiting = list[tuple[float, int, _Node, Array]]()
        self._push(waiting, first)
        while waiting and self.solved < nodes and self._worth(-waiting[0][0]):
            _, _, node, weights = heapq.heappop(waiting)
            for child in _branches(node, weights):
                self._push(waiting, child)
        open_bound = -waiting[0][0] if waiting else -np.inf
        return Exact(self.best, max(open_bound, self.best.value), self.solved)

    def _worth(self, bound: float) -> bool:
        return exceeds(bound, self.best.value, CLOSE)

    def _push(self, waiting: list[tuple[float, int, _Node, Array]], node: _Node) -> None:
        # A node that may hold more than is known, with its relaxed weights.
        found = self._relaxed(node)
        if found is None:
            return
        weights, bound = found
        if np.all(np.abs(weights - np.rint(weights)) < WHOLE):
            self._keep(np.rint(weights))
        if self._worth(bound):
            heapq.heappush(waiting, (-bound, self.solved, node, weights))

    def _keep(self, weights: Array) -> None:
        value = float(self.criterion.judge([self.parts.root(weights)]))
        if value > self.best.value:
            self.best = exchanged_weights(self.criterion, self.parts, weights, self.budgets)

    def _relaxed(self, node: _Node) -> tuple[Array, float] | None:
        # What is surely taken is known beforehand; None where no weights are left within the budgets.
        free = np.flatnonzero(node.high > node.low)
        places = {place: number for number, place in enumerate(free.tolist())}
        budgets = list[Budget]()
        for one in self.budgets:
            total = one.total - one.spent(node.low)
            own = [place for place in one.places if place in places]
            sizes = [size for place, size in zip(one.places, one.sizes, strict=True) if place in places]
            tops = (node.high - node.low)[own]
            if total < -WHOLE or total > float(np.array(sizes) @ tops) + WHOLE:
                return None
            if own and total > WHOLE:
                kept = tuple(places[place] for place in own)
                budgets.append(replace(one, places=kept, sizes=tuple(sizes), total=total, tops=tuple(tops)))
        taken = sorted(place for one in budgets for place in one.places)
        self.solved += 1
        if not taken:
            return node.low, float(self.criterion.judge([self.parts.root(node.low)]))
        rest = free[taken]
        number = {place: at for at, place in enumerate(taken)}
        budgets = [replace(one, places=tuple(number[place] for place in one.places)) for one in budgets]
        some = self.parts.taken(node.low, rest)
        if not self._identifies(some, budgets):
            return None
        found = best_weights(self.criterion, some, budgets)
        weights = node.low.copy()
        weights[rest] += found.values
        return weights, weight_bound(self.criterion, some, found.values, found.gradient, budgets)

    def _identifies(self, parts: Parts, budgets: Sequence[Budget]) -> bool:
        # Whether anything is identifiable with all that is left: else no choice of it is any good.
        every = np.zeros(len(parts.readings))
        for one in budgets:
            every[list(one.places)] = one.even * one.upper
        return bool(self.criterion.identifiable([parts.root(every)]))


def _branches(node: _Node, weights: Array) -> Iterator[_Node]:
    # On the weight that is farthest from a whole number.
    apart = np.abs(weights - np.rint(weights))
    place = int(apart.argmax())
    if apart[place] < WHOLE:
        return
    below = np.floor(weights[place])
    high, low = node.high.copy(), node.low.copy()
    high[place], low[place] = below, below + 1
    yield _Node(node.low, high)
    yield _Node(low, node.high)
