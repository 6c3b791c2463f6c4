"""Generations of a search, one after another: pymoo's own, and those of its genetic algorithm on arrays.

Pymoo keeps every candidate as an object; making, filling and reading these takes longer than scoring drives
does. Its genetic operators work on arrays anyway: here they are called on them directly, with the same random
numbers in the same order, so that the same seed leads to the same drives.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from oed.foundation.arrays import Array, Bools, Places

Scored = tuple[Array, Array]
Scoring = Callable[[Array], Scored]
"""Candidates (K, size) -> criterion (K,) and by how much each limit is exceeded, in shares of its size, below
0 within it (K, limits).
"""

APART = 1e-16
"""Distance up to which pymoo takes two candidates for the same."""
MATINGS = 100
"""Rounds of mating after which a generation stays smaller than was asked for."""


@dataclass(frozen=True, eq=False)
class Standing:
    """The candidates that a search goes on from.

    Attributes:
        unknowns: (K, size).
        costs: the criterion with its sign changed, (K,).
        excess: by how much each limit is exceeded, in shares of its size, (K, limits).
    """

    unknowns: Array
    costs: Array
    excess: Array

    @cached_property
    def violation(self) -> Array:
        """Sum of what all limits are exceeded by, (K,)."""
        return np.asarray(np.maximum(0.0, self.excess).sum(axis=1))

    @property
    def feasible(self) -> Bools:
        """Which candidates keep all limits, (K,)."""
        return self.violation <= 0

    def chosen(self, places: Places) -> Standing:
        """Those at these places."""
        return Standing(self.unknowns[places], self.costs[places], self.excess[places])

    def joined(self, other: Standing) -> Standing:
        """These, and then the others."""
        return Standing(
            np.concatenate([self.unknowns, other.unknowns]),
            np.concatenate([self.costs, other.costs]),
            np.concatenate([self.excess, other.excess]),
        )


class Generations(ABC):
    """A search that goes on generation by generation.

    Attributes:
        evaluations: candidates scored so far.
    """

    evaluations: int = 0

    @property
    @abstractmethod
    def ended(self) -> bool:
        """Whether there is no further generation."""

    @abstractmethod
    def advance(self) -> None:
        """Make, score and select the next generation."""

    @property
    @abstractmethod
    def standing(self) -> Standing:
        """The candidates selected last."""

    @abstractmethod
    def tighten(self, shares: Array) -> None:
        """Make each limit tighter by a share of its size, (limits,), for those candidates."""


class OfPymoo(Generations):
    """Those of an algorithm of pymoo's that is set up."""

    def __init__(self, algorithm: Any) -> None:
        """Begin with its first generation."""
        self._algorithm = algorithm

    @property
    def ended(self) -> bool:
        """Whether the algorithm has no next generation."""
        return not self._algorithm.has_next()

    def advance(self) -> None:
        """Let the algorithm make its next one."""
        self._algorithm.next()
        self.evaluations = int(self._algorithm.evaluator.n_eval)

    @property
    def standing(self) -> Standing:
        """The algorithm's population."""
        unknowns, costs, excess = self._algorithm.pop.get("X", "F", "G")
        return Standing(np.asarray(unknowns, dtype=float), costs[:, 0], excess)

    def tighten(self, shares: Array) -> None:
        """Change the constraints of the algorithm's population, and let pymoo sum up its violations anew."""
        population = self._algorithm.pop
        population.set("G", population.get("G") + shares)
        population.set("CV", [None] * len(population))


@dataclass(frozen=True)
class Operators:
    """What makes the next candidates, all of pymoo's.

    Attributes:
        crossover: of two parents, with two children.
        mutation: of a child.
        bounds: problem of pymoo's with the bounds that they look at.
    """

    crossover: Any
    mutation: Any
    bounds: Any


class OnArrays(Generations):
    """Those of pymoo's elitist genetic algorithm, without its objects."""

    def __init__(
        self, operators: Operators, scoring: Scoring, sampling: Array, generations: int, seed: int
    ) -> None:
        """Begin with a sampling.

        Args:
            operators: that make candidates.
            scoring: of them.
            sampling: the first candidates, (population, size).
            generations: at most.
            seed: of all random numbers.
        """
        self._operators, self._scoring, self._sampling = operators, scoring, sampling
        self._left, self._rng = generations, np.random.default_rng(seed)
        self._selected: Standing | None = None

    @property
    def ended(self) -> bool:
        """Whether all generations were made, or mating gave nothing new."""
        return self._left <= 0

    @property
    def standing(self) -> Standing:
        """The fittest of all so far."""
        assert self._selected is not None
        return self._selected

    def tighten(self, shares: Array) -> None:
        """Tighten them for the fittest, which stay until the next generation is selected."""
        self._selected = replace(self.standing, excess=self.standing.excess + shares)

    def advance(self) -> None:
        """Score the sampling; later, mate, score, and keep the fittest."""
        self._left -= 1
        if self._selected is None:
            self._selected = self._scored(self._sampling[~repeated(self._sampling)])
            return
        children = self._children()
        if not len(children):
            self._left = 0
        both = self._selected.joined(self._scored(children)) if len(children) else self._selected
        self._selected = both.chosen(np.lexsort([both.costs, both.violation])[: len(self._sampling)])

    def _scored(self, candidates: Array) -> Standing:
        values, excess = self._scoring(candidates)
        self.evaluations += len(candidates)
        return Standing(candidates, -values, excess)

    def _children(self) -> Array:
        wanted, standing = len(self._sampling), self.standing
        made = np.empty((0, standing.unknowns.shape[1]))
        for _ in range(MATINGS):
            matings = -(-(wanted - len(made)) // 2)
            born = self._born(standing.unknowns[winners(standing, matings, self._rng)])
            born = born[~repeated(born)]
            for other in (standing.unknowns, made):
                born = born[~known(born, other)]
            made = np.concatenate([made, born])[:wanted]
            if len(made) == wanted:
                break
        return made

    def _born(self, parents: Array) -> Array:
        # As the `do` of pymoo's operators has it, between candidates and objects.
        operators, rng = self._operators, self._rng
        pairs = np.swapaxes(parents, 0, 1)
        children = np.array(pairs)
        crossed = rng.random(len(parents)) < operators.crossover.prob.get()
        if crossed.any():
            own = operators.crossover._do(operators.bounds, pairs, random_state=rng)
            children[:, crossed] = own[:, crossed]
        children = children.reshape(-1, parents.shape[-1])
        mutated = operators.mutation._do(operators.bounds, children, random_state=rng)
        kept = rng.random(len(children)) <= operators.mutation.prob.get()
        children[kept] = mutated[kept]
        return children


def winners(standing: Standing, matings: int, rng: np.random.Generator) -> Places:
    """Places (matings, 2) of parents: the better of two candidates drawn, each time.

    Args:
        standing: the candidates.
        matings: pairs of parents.
        rng: of the draws.
    """
    count, drawn = len(standing.costs), 4 * matings
    places = np.concatenate([rng.permutation(count) for _ in range(-(-drawn // count))])[:drawn]
    first, second = places.reshape(-1, 2).T
    costs, violation = standing.costs, standing.violation
    broken = (violation[first] > 0) | (violation[second] > 0)
    one = np.where(broken, violation[first], costs[first])
    other = np.where(broken, violation[second], costs[second])
    won = np.where(one < other, first, second)
    for index in np.flatnonzero(~(one < other) & ~(one > other)):
        won[index] = rng.choice([first[index], second[index]])
    return won.reshape(-1, 2)


def repeated(candidates: Array) -> Bools:
    """Which candidates (K,) of (K, size) are the same as one before them."""
    later, former = _alike(candidates, candidates)
    return _marked(len(candidates), later[former < later])


def known(candidates: Array, others: Array) -> Bools:
    """Which candidates (K,) of (K, size) are the same as one of others (L, size)."""
    return _marked(len(candidates), _alike(candidates, others)[0])


def _marked(count: int, places: Places) -> Bools:
    found = np.zeros(count, dtype=bool)
    found[places] = True
    return found


def _alike(candidates: Array, others: Array) -> tuple[Places, Places]:
    # Pairs of a candidate and another that are the same: of those alike by one weighted sum of the unknowns,
    # in order, which are far fewer than all.
    if not len(candidates) or not len(others):
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    weights = 1.0 + np.arange(candidates.shape[1])
    slack = 1e-12 * (1.0 + max(np.abs(table).max() for table in (candidates, others))) * weights.sum()
    sums, theirs = candidates @ weights, others @ weights
    order = np.argsort(theirs)
    last = np.searchsorted(theirs[order], sums + slack, side="right")
    count = last - np.searchsorted(theirs[order], sums - slack)
    one = np.repeat(np.arange(len(candidates)), count)
    other = order[np.arange(len(one)) + np.repeat(last - np.cumsum(count), count)]
    apart = np.linalg.norm(candidates[one] - others[other], axis=1)
    return one[apart <= APART], other[apart <= APART]
