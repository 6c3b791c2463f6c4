"""The best wheel speeds when every sample is a measurement of its own: a bound by dynamic programming.

Then F = S (sum w w') S whatever the headings. For any Z >= 0 a concave criterion is bounded by the largest
tr(Z F), as the smallest eigenvalue is for tr Z = 1: a convex function of the speeds. Limits on speeds and on
their differences are totally unimodular, so its maximum is at speeds that lie on a lattice: a bound plus or
minus multiples of the largest step. Dynamic programming on that lattice is exact. Cutting planes find the
best Z; branching on the signs of the speeds at some times closes what gap is left.
"""

from __future__ import annotations

import heapq
import itertools
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from oed.bounds.lattice_program import LatticeProgram as LatticeProgram
from oed.bounds.lattice_program import SpeedLimits as SpeedLimits
from oed.bounds.lattice_program import lattice as lattice
from oed.bounds.targets import Target, target_of
from oed.foundation.arrays import Array
from oed.kernel.criteria import Criterion, E

CUTS = 30
"""Cutting planes for one node at most."""
WORK = 3e9
"""Comparisons that a search may take by default: some 5 s."""
PER_PERIOD, PER_PLANE = 4e4, 1.5e6
"""What a period of one pass, and finding the next Z, cost besides, in comparisons' time."""
SMALLEST = E()
"""The smallest eigenvalue."""


@dataclass(order=True)
class _Node:
    priority: float
    serial: int
    conditions: dict[int, tuple[int, int]] = field(compare=False)
    bound: float = field(compare=False)
    multiplier: Array = field(compare=False)
    paths: list[Array] = field(compare=False)
    shares: Array = field(compare=False)


@dataclass(frozen=True)
class Part:
    """A part of all speeds, and the Z (2, 2) that bounds it; the parts of a search hold all of them.

    Attributes:
        conditions: signs of both speeds by period, about the middle of their bounds.
        multiplier: Z.
    """

    conditions: Mapping[int, tuple[int, int]]
    multiplier: Array


@dataclass(frozen=True)
class LatticeBound:
    """What the search found.

    Attributes:
        upper: no speeds within the limits have a larger value of the criterion.
        root: the bound before any branching.
        lower: the criterion of the best speeds found.
        speeds: those, (N, 2).
        nodes: branchings' nodes.
        complete: whether the gap asked for was reached, rather than the most nodes or the time limit.
        parts: into which the branchings took all speeds apart.
        limits: those of the speeds.
        target: what is bounded.
    """

    upper: float
    root: float
    lower: float
    speeds: Array
    nodes: int
    complete: bool
    parts: tuple[Part, ...]
    limits: SpeedLimits
    target: Target

    def of_others(self, limits: SpeedLimits, weights: Array, constant: Array) -> float:
        """A bound of slightly other limits and weights, by the same parts: any Z is valid for those too.

        Args:
            limits: of the speeds.
            weights: of the rows.
            constant: that is added.
        """
        # Parts that left out what is the same the other way round need limits of which that is true.
        own = limits.both_ways if self.limits.symmetric else limits
        program, target = LatticeProgram(own, weights), self.target.beside(constant)
        return max(
            target.bound(part.multiplier, program.maximise(part.multiplier, part.conditions)[0])
            for part in self.parts
        )


def lattice_bound(
    limits: SpeedLimits,
    weights: Array,
    constant: Array,
    *,
    gap: float = 2e-4,
    nodes: int | None = None,
    time_limit: float | None = None,
    criterion: Criterion = SMALLEST,
) -> LatticeBound:
    """Bound a criterion of S (sum w w') S + constant over all speeds within `limits`.

    Args:
        limits: of the speeds.
        weights: S (2,).
        constant: (2, 2), e.g. a prior's information.
        gap: share of the best speeds found by which the bound may exceed it.
        nodes: after which the bound so far is taken; by default after so many cutting planes, `usual_planes`,
            as take some seconds.
        time_limit: the same by the clock [s]; what is found then depends on the machine.
        criterion: E, D or A; the smallest eigenvalue by default.
    """
    program = LatticeProgram(limits, weights)
    planes = usual_planes(program) if nodes is None else CUTS * nodes
    deadline = np.inf if time_limit is None else time.perf_counter() + time_limit
    target = target_of(criterion, constant)
    return _Search(program, target, gap, nodes or planes, planes, deadline).run()


def usual_planes(program: LatticeProgram) -> int:
    """Cutting planes that take about as long for every lattice: a matter of the study, not of the machine."""
    return max(1, round(WORK / (program.steps + PER_PERIOD * program.limits.samples + PER_PLANE)))


@dataclass
class _Search:
    program: LatticeProgram
    target: Target
    gap: float
    most: int
    planes: int
    deadline: float
    nodes: int = 0
    lower: float = -np.inf
    best: Array = field(default_factory=lambda: np.zeros(0))
    serial: Iterator[int] = field(default_factory=itertools.count)
    closed: list[_Node] = field(default_factory=list)
    empty: list[Part] = field(default_factory=list)

    def run(self) -> LatticeBound:
        root = self._node({}, np.eye(2) / 2, np.inf)
        assert root is not None
        queue = [root]
        while queue and not self._reached(queue[0].bound):
            if self._spent or self.nodes >= self.most:
                break
            node = heapq.heappop(queue)
            children = self._children(node)
            if not children:
                self.closed.append(node)
            for conditions in children:
                child = self._node(conditions, node.multiplier, node.bound)
                if child is not None:
                    heapq.heappush(queue, child)
        left = [*self.closed, *queue]
        upper = max([self.lower, *(node.bound for node in left)])
        return LatticeBound(
            upper=upper,
            root=root.bound,
            lower=self.lower,
            speeds=self.best / self.program.weights,
            nodes=self.nodes,
            complete=self._reached(upper),
            parts=(*(Part(node.conditions, node.multiplier) for node in left), *self.empty),
            limits=self.program.limits,
            target=self.target,
        )

    def _reached(self, bound: float) -> bool:
        return self.target.excess(bound, self.lower) <= self.gap

    @property
    def _spent(self) -> bool:
        return self.planes <= 0 or time.perf_counter() > self.deadline

    def _node(self, conditions: dict[int, tuple[int, int]], multiplier: Array, above: float) -> _Node | None:
        # Cutting planes: every Z tried gives a valid bound, and a plane that the next Z takes into account.
        matrices: list[Array] = []
        paths: list[Array] = []
        bound, chosen = above, multiplier
        shares = np.ones(1)
        self.nodes += 1
        for _ in range(CUTS):
            self.planes -= 1
            most, path = self.program.maximise(multiplier, conditions)
            if not np.isfinite(most):
                self.empty.append(Part(conditions, multiplier))
                return None
            matrix = path.T @ path + self.target.constant
            value = self.target.bound(multiplier, most)
            self._note(path, matrix)
            if value < bound:
                bound, chosen = value, multiplier
            paths.append(path)
            matrices.append(matrix)
            least, multiplier, shares = self.target.lowest(matrices)
            self._note_joined(paths, shares)
            if self.target.near(bound, least) or self._reached(bound) or self._spent:
                break
        return _Node(-bound, next(self.serial), conditions, bound, chosen, paths, shares)

    def _note(self, path: Array, matrix: Array) -> None:
        value = float(self.target.values(matrix))
        if value > self.lower:
            self.lower, self.best = value, path

    def _note_joined(self, paths: list[Array], shares: Array) -> None:
        # The drives mixed in the bound: one until some time, another from then on, where they can be joined.
        used = [paths[index] for index in np.argsort(-shares)[:2]]
        for first, second in itertools.permutations(used, 2):
            jumps = np.abs(first[:-1] - second[1:]) / np.abs(self.program.weights)
            times = np.flatnonzero((jumps <= self.program.limits.step * (1 + 1e-9)).all(axis=1)) + 1
            if not len(times):
                continue
            done = np.cumsum(np.einsum("ka,kb->kab", first, first), axis=0)[times - 1]
            left = np.cumsum(np.einsum("ka,kb->kab", second, second)[::-1], axis=0)[::-1][times]
            values = self.target.values(done + left + self.target.constant)
            best = int(np.argmax(values))
            if values[best] > self.lower:
                path = np.concatenate([first[: times[best]], second[times[best] :]])
                self.lower, self.best = float(values[best]), path

    def _children(self, node: _Node) -> list[dict[int, tuple[int, int]]]:
        # Where the drives that are mixed in the bound disagree most about going straight or turning.
        used = [(share, path) for share, path in zip(node.shares, node.paths, strict=False) if share > 1e-9]
        middle = self.program.limits.bounds.mean(axis=1) * self.program.weights
        products = np.array([np.sign((path - middle).prod(axis=1)) for _, path in used])
        shares = np.array([share for share, _ in used])
        mean = shares @ products / shares.sum()
        spread = shares @ (products - mean) ** 2
        known = np.array([-1, *node.conditions, len(spread)])
        away = np.abs(np.arange(len(spread))[:, None] - known).min(axis=1)
        # In the middle between times already decided, if there they disagree at all.
        moment = int(np.argmax(away * (0.1 + spread)))
        if away[moment] == 0:
            return []
        symmetric = not node.conditions and self.program.limits.symmetric
        # Driving everything the other way round is as good: at first, one sign is enough.
        pairs = [(1, 1), (1, -1)] + ([] if symmetric else [(-1, 1), (-1, -1)])
        return [{**node.conditions, moment: pair} for pair in pairs]
