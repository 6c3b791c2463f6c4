"""Bound by dynamic programming on wheel speeds where every sample is a measurement of its own.

Then F = S (sum w w') S does not depend on headings. For any Z >= 0 the largest tr(Z F) bounds a concave
criterion, as it bounds the smallest eigenvalue for tr Z = 1. It is a convex function of the speeds. The
limits on speeds and their differences are totally unimodular, so its maximum is at speeds on a lattice: a
bound plus or minus multiples of the largest step. Dynamic programming on that lattice is exact. Cutting
planes find the best Z; branching on the signs of the speeds in some periods closes the remaining gap.
"""

from __future__ import annotations

import heapq
import itertools
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from oed.bounds.certificate import SMALLEST
from oed.bounds.lattice_program import LatticeProgram, SpeedLimits
from oed.bounds.targets import Target
from oed.foundation.arrays import Array
from oed.kernel.criteria import Criterion

CUTS = 30
"""Largest number of cutting planes of one node."""
ENOUGH = 1e-5
"""Share by which another cutting plane has to lower a bound."""
WORK = 3e9
"""Default number of comparisons of a search: some 5 s."""
PER_PERIOD, PER_PLANE = 4e4, 1.5e6
"""Overhead of a period of one pass, and of finding the next Z, in comparisons."""


@dataclass(order=True)
class _LatticeNode:
    priority: float
    serial: int
    conditions: dict[int, tuple[int, int]] = field(compare=False)
    bound: float = field(compare=False)
    multiplier: Array = field(compare=False)
    paths: list[Array] = field(compare=False)
    shares: Array = field(compare=False)


@dataclass(frozen=True)
class SpeedSubset:
    """Subset of the speeds, and the Z that bounds it; the subsets of a search cover all speeds.

    Attributes:
        conditions: signs of both speeds, relative to the middle of their bounds, by period.
        multiplier: multiplier Z, (2, 2).
    """

    conditions: Mapping[int, tuple[int, int]]
    multiplier: Array


@dataclass(frozen=True)
class LatticeBound:
    """Result of the search for a bound on a lattice.

    Attributes:
        upper: upper bound on the criterion over all speeds within the limits.
        root: bound before any branching.
        lower: criterion of the best speeds found.
        speeds: best speeds found, (N, 2).
        nodes: number of nodes.
        complete: True if the search reached its gap before its limits on nodes and time.
        parts: subsets of the speeds that remain after branching; they cover all speeds.
        limits: limits of the speeds.
        target: criterion that is bounded.
    """

    upper: float
    root: float
    lower: float
    speeds: Array
    nodes: int
    complete: bool
    parts: tuple[SpeedSubset, ...]
    limits: SpeedLimits
    target: Target

    def bound_for(self, limits: SpeedLimits, weights: Array, constant: Array) -> float:
        """Return a bound for slightly different limits and weights by the same parts: any Z is valid for
        them.

        Args:
            limits: limits of the speeds.
            weights: weights S of the rows, (2,).
            constant: matrix that is added to F, (2, 2).
        """
        # Parts without the mirrored speeds are valid for symmetric limits only.
        covering = limits.both_ways if self.limits.symmetric else limits
        program, target = LatticeProgram(covering, weights), replace(self.target, constant=constant)
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
        limits: limits of the speeds.
        weights: weights S of the rows, (2,).
        constant: matrix that is added to F, (2, 2), e.g. prior information.
        gap: gap between the bound and the best speeds at which the search ends.
        nodes: largest number of nodes; by default the search ends after `usual_planes` cutting planes, some
            seconds.
        time_limit: time limit of the search [s]; its result then depends on the machine.
        criterion: criterion E, D or A; the smallest eigenvalue by default.
    """
    program = LatticeProgram(limits, weights)
    planes = usual_planes(program) if nodes is None else CUTS * nodes
    deadline = np.inf if time_limit is None else time.perf_counter() + time_limit
    target = Target(criterion, constant)
    return _LatticeSearch(program, target, gap, nodes or planes, planes, deadline).run()


def usual_planes(program: LatticeProgram) -> int:
    """Return a number of cutting planes that takes about as long for every lattice, on any machine alike."""
    return max(1, round(WORK / (program.steps + PER_PERIOD * program.limits.samples + PER_PLANE)))


@dataclass
class _LatticeSearch:
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
    closed: list[_LatticeNode] = field(default_factory=list)
    empty: list[SpeedSubset] = field(default_factory=list)

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
        remaining = [*self.closed, *queue]
        upper = max([self.lower, *(node.bound for node in remaining)])
        return LatticeBound(
            upper=upper,
            root=root.bound,
            lower=self.lower,
            speeds=self.best / self.program.weights,
            nodes=self.nodes,
            complete=self._reached(upper),
            parts=(*(SpeedSubset(node.conditions, node.multiplier) for node in remaining), *self.empty),
            limits=self.program.limits,
            target=self.target,
        )

    def _reached(self, bound: float) -> bool:
        return self.target.excess(bound, self.lower) <= self.gap

    @property
    def _spent(self) -> bool:
        return self.planes <= 0 or time.perf_counter() > self.deadline

    def _node(
        self, conditions: dict[int, tuple[int, int]], multiplier: Array, above: float
    ) -> _LatticeNode | None:
        # Cutting planes: every Z gives a valid bound, and a plane that constrains the next Z.
        paths: list[Array] = []
        bound, chosen = above, multiplier
        shares = np.ones(1)
        self.nodes += 1
        for _ in range(CUTS):
            self.planes -= 1
            most, path = self.program.maximise(multiplier, conditions)
            if not np.isfinite(most):
                self.empty.append(SpeedSubset(conditions, multiplier))
                return None
            matrix = path.T @ path + self.target.constant
            value = self.target.bound(multiplier, most)
            self._record_best(path, matrix)
            if value < bound:
                bound, chosen = value, multiplier
            paths.append(path)
            least, multiplier, shares = self.target.lowest(paths)
            self._record_joins(paths, shares)
            if self.target.excess(bound, least) <= ENOUGH or self._reached(bound) or self._spent:
                break
        return _LatticeNode(-bound, next(self.serial), conditions, bound, chosen, paths, shares)

    def _record_best(self, path: Array, matrix: Array) -> None:
        value = float(self.target.values(matrix))
        if value > self.lower:
            self.lower, self.best = value, path

    def _record_joins(self, paths: list[Array], shares: Array) -> None:
        # Joins of the drives in the bound's mixture: one up to some period, another from then on.
        used = [paths[index] for index in np.argsort(-shares)[:2]]
        for first, second in itertools.permutations(used, 2):
            jumps = np.abs(first[:-1] - second[1:]) / np.abs(self.program.weights)
            times = np.flatnonzero((jumps <= self.program.limits.step * (1 + 1e-9)).all(axis=1)) + 1
            if not len(times):
                continue
            done = np.cumsum(np.einsum("ka,kb->kab", first, first), axis=0)[times - 1]
            rest = np.cumsum(np.einsum("ka,kb->kab", second, second)[::-1], axis=0)[::-1][times]
            values = self.target.values(done + rest + self.target.constant)
            best = int(np.argmax(values))
            if values[best] > self.lower:
                path = np.concatenate([first[: times[best]], second[times[best] :]])
                self.lower, self.best = float(values[best]), path

    def _children(self, node: _LatticeNode) -> list[dict[int, tuple[int, int]]]:
        # Branches in the period in which the drives of the mixture disagree most about straight or turn.
        used = [(share, path) for share, path in zip(node.shares, node.paths, strict=False) if share > 1e-9]
        middle = self.program.limits.bounds.mean(axis=1) * self.program.weights
        products = np.array([np.sign((path - middle).prod(axis=1)) for _, path in used])
        shares = np.array([share for share, _ in used])
        mean = shares @ products / shares.sum()
        spread = shares @ (products - mean) ** 2
        decided = np.array([-1, *node.conditions, len(spread)])
        away = np.abs(np.arange(len(spread))[:, None] - decided).min(axis=1)
        # Periods far from decided ones are preferred.
        moment = int(np.argmax(away * (0.1 + spread)))
        if away[moment] == 0:
            return []
        symmetric = not node.conditions and self.program.limits.symmetric
        # Reversed speeds have the same value, so the root needs one sign only.
        pairs = [(1, 1), (1, -1)] + ([] if symmetric else [(-1, 1), (-1, -1)])
        return [{**node.conditions, moment: pair} for pair in pairs]
