"""The best wheel speeds when every sample is a measurement of its own: a bound by dynamic programming.

Then F = S (sum w w') S whatever the headings. For any Z >= 0 with tr Z = 1 the smallest eigenvalue of F is at
most the largest tr(Z F), a convex function of the speeds. Limits on speeds and on their differences are
totally unimodular, so its maximum is at speeds that lie on a lattice: a bound plus or minus multiples of the
largest step. Dynamic programming on that lattice is exact. Cutting planes find the best Z; branching on the
signs of the speeds at some times closes what gap is left.
"""

from __future__ import annotations

import heapq
import itertools
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy

from oed.foundation.arrays import Array, Places

DIRECTIONS = 96
"""Corners of the polygon inside which Z is sought; every Z inside is valid."""
CUTS = 30
"""Cutting planes for one node at most."""
ENOUGH = 1e-5
"""Share of the bound by which one more cutting plane has to lower it."""
WORK = 3e9
"""Comparisons that a search may take by default: some 5 s."""
PER_PERIOD, PER_PLANE = 4e4, 1.5e6
"""What a period of one pass, and finding the next Z, cost besides, in comparisons' time."""


@dataclass(frozen=True)
class SpeedLimits:
    """Limits of two inputs held in N periods.

    Attributes:
        samples: N.
        bounds: (2, 2): smallest and largest value of each input.
        step: largest change from a period to the next; infinite for none.
        ends: largest magnitude in the first and the last period; infinite for none.
    """

    samples: int
    bounds: Array
    step: float
    ends: float

    @property
    def symmetric(self) -> bool:
        """Whether driving everything the other way round is allowed as well."""
        return bool(np.allclose(self.bounds.sum(axis=1), 0.0))

    @property
    def both_ways(self) -> SpeedLimits:
        """Limits that also allow everything the other way round."""
        largest = np.abs(self.bounds).max(axis=1)
        return replace(self, bounds=np.stack([-largest, largest], axis=1))


def lattice(low: float, high: float, step: float, ends: float) -> Array:
    """Values that optimal speeds take, ascending: every bound, plus or minus multiples of the step.

    Args:
        low: bound of the speed.
        high: bound of the speed.
        step: largest change in one period.
        ends: largest magnitude at begin and end; infinite where that is free.
    """
    seeds = [low, high, (low + high) / 2] + ([-ends, ends] if np.isfinite(ends) else [])
    seeds = [seed for seed in seeds if low <= seed <= high]
    if not np.isfinite(step):
        return np.unique(seeds)
    count = int(np.ceil((high - low) / step)) + 1
    values = np.concatenate([seed + step * np.arange(-count, count + 1) for seed in seeds])
    inside = np.sort(values[(values >= low) & (values <= high)])
    # Values that rounding alone keeps apart are one.
    return np.asarray(inside[np.concatenate([[True], np.diff(inside) > 1e-9 * max(1.0, high - low)])])


class LatticeProgram:
    """Dynamic programming over both inputs: the speeds of largest tr(Z F) under sign conditions."""

    def __init__(self, limits: SpeedLimits, weights: Array) -> None:
        """Lay out the lattice within limits of the speeds, for weights S (2,) of F = S (sum w w') S."""
        self.limits, self.weights = limits, weights
        self.grids = [lattice(low, high, limits.step, limits.ends) for low, high in limits.bounds]
        first, second = np.meshgrid(*self.grids, indexing="ij")
        self.scaled = np.stack([weights[0] * first, weights[1] * second])
        self.neighbours = [_neighbours(grid, limits.step) for grid in self.grids]
        self.ends = np.maximum(np.abs(first), np.abs(second)) <= limits.ends * (1 + 1e-12)
        middle = limits.bounds.mean(axis=1)
        self.signs = {
            (one, other): (one * (first - middle[0]) >= -1e-9) & (other * (second - middle[1]) >= -1e-9)
            for one, other in itertools.product((1, -1), repeat=2)
        }

    @property
    def steps(self) -> int:
        """Comparisons of one pass, a measure of its time."""
        first, second = self.neighbours
        return int(self.limits.samples * len(first) * len(second) * (first.shape[1] + second.shape[1]))

    def maximise(self, matrix: Array, conditions: Mapping[int, tuple[int, int]]) -> tuple[float, Array]:
        """The largest tr(Z F), and the speeds (N, 2) that reach it (scaled by S); -inf if there are none."""
        cost = np.einsum("aij,ab,bij->ij", self.scaled, matrix, self.scaled)
        count = self.limits.samples
        values = self._kept(cost, count - 1, conditions)
        table = [values]
        for index in range(count - 2, -1, -1):
            values = self._kept(self._best_next(values) + cost, index, conditions)
            table.append(values)
        table.reverse()
        best = float(values.max())
        return best, self._trace(table) if np.isfinite(best) else np.zeros((count, 2))

    def _kept(self, values: Array, index: int, conditions: Mapping[int, tuple[int, int]]) -> Array:
        # Values of the speeds that are allowed in a period; -inf for the others.
        if index in (0, self.limits.samples - 1):
            values = np.where(self.ends, values, -np.inf)
        if index in conditions:
            values = np.where(self.signs[conditions[index]], values, -np.inf)
        return values

    def _best_next(self, values: Array) -> Array:
        first, second = self.neighbours
        values = values[first].max(axis=1)
        return np.asarray(values[:, second].max(axis=2))

    def _trace(self, table: Sequence[Array]) -> Array:
        first, second = self.neighbours
        place = np.unravel_index(int(np.argmax(table[0])), table[0].shape)
        places = [place]
        for values in table[1:]:
            rows, columns = first[place[0]], second[place[1]]
            part = values[np.ix_(rows, columns)]
            row, column = np.unravel_index(int(np.argmax(part)), part.shape)
            place = (rows[row], columns[column])
            places.append(place)
        rows, columns = np.array(places).T
        return np.asarray(self.scaled[:, rows, columns].T)


def _neighbours(grid: Array, step: float) -> Places:
    # (n, m): which values may follow each, the last one repeated where there are fewer.
    reach = step * (1 + 1e-9)
    low = np.searchsorted(grid, grid - reach, side="left")
    high = np.searchsorted(grid, grid + reach, side="right")
    width = int((high - low).max())
    return np.asarray(np.minimum(low[:, None] + np.arange(width), high[:, None] - 1))


@dataclass(order=True)
class _Node:
    priority: float
    serial: int
    conditions: dict[int, tuple[int, int]] = field(compare=False)
    bound: float = field(compare=False)
    point: Array = field(compare=False)
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
        upper: no speeds within the limits have a larger smallest eigenvalue.
        root: the bound before any branching.
        lower: the smallest eigenvalue of the best speeds found.
        speeds: those, (N, 2).
        multiplier: Z of the bound before any branching, (2, 2).
        nodes: branchings' nodes.
        complete: whether the gap asked for was reached, rather than the most nodes or the time limit.
        parts: into which the branchings took all speeds apart.
        limits: those of the speeds.
    """

    upper: float
    root: float
    lower: float
    speeds: Array
    multiplier: Array
    nodes: int
    complete: bool
    parts: tuple[Part, ...]
    limits: SpeedLimits

    def of_others(self, limits: SpeedLimits, weights: Array, constant: Array) -> float:
        """A bound of slightly other limits and weights, by the same parts: any Z is valid for those too.

        Args:
            limits: of the speeds.
            weights: of the rows.
            constant: that is added.
        """
        # Parts that left out what is the same the other way round need limits of which that is true.
        own = limits.both_ways if self.limits.symmetric else limits
        program = LatticeProgram(own, weights)
        return max(
            program.maximise(part.multiplier, part.conditions)[0] + float(np.sum(part.multiplier * constant))
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
) -> LatticeBound:
    """Bound the smallest eigenvalue of S (sum w w') S + constant over all speeds within `limits`.

    Args:
        limits: of the speeds.
        weights: S (2,).
        constant: (2, 2), e.g. a prior's information.
        gap: share of the best speeds found by which the bound may exceed it.
        nodes: after which the bound so far is taken; by default after so many cutting planes, `usual_planes`,
            as take some seconds.
        time_limit: the same by the clock [s]; what is found then depends on the machine.
    """
    program = LatticeProgram(limits, weights)
    planes = usual_planes(program) if nodes is None else CUTS * nodes
    deadline = np.inf if time_limit is None else time.perf_counter() + time_limit
    return _Search(program, constant, gap, nodes or planes, planes, deadline).run()


def usual_planes(program: LatticeProgram) -> int:
    """Cutting planes that take about as long for every lattice: a matter of the study, not of the machine."""
    return max(1, round(WORK / (program.steps + PER_PERIOD * program.limits.samples + PER_PLANE)))


@dataclass
class _Search:
    program: LatticeProgram
    constant: Array
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
        root = self._node({}, np.zeros(2), np.inf)
        assert root is not None
        queue = [root]
        while queue and queue[0].bound > self.lower * (1 + self.gap):
            if self._spent or self.nodes >= self.most:
                break
            node = heapq.heappop(queue)
            children = self._children(node)
            if not children:
                self.closed.append(node)
            for conditions in children:
                child = self._node(conditions, node.point, node.bound)
                if child is not None:
                    heapq.heappush(queue, child)
        left = [*self.closed, *queue]
        upper = max([self.lower, *(node.bound for node in left)])
        return LatticeBound(
            upper=upper,
            root=root.bound,
            lower=self.lower,
            speeds=self.best / self.program.weights,
            multiplier=_multiplier(root.point),
            nodes=self.nodes,
            complete=upper <= self.lower * (1 + self.gap),
            parts=(*(Part(node.conditions, _multiplier(node.point)) for node in left), *self.empty),
            limits=self.program.limits,
        )

    @property
    def _spent(self) -> bool:
        return self.planes <= 0 or time.perf_counter() > self.deadline

    def _node(self, conditions: dict[int, tuple[int, int]], point: Array, above: float) -> _Node | None:
        # Cutting planes: every point tried gives a valid bound, and a plane under the true function.
        planes: list[tuple[float, Array]] = []
        paths: list[Array] = []
        bound, chosen = above, point
        shares = np.ones(1)
        self.nodes += 1
        for _ in range(CUTS):
            self.planes -= 1
            value, path = self.program.maximise(_multiplier(point), conditions)
            if not np.isfinite(value):
                self.empty.append(Part(conditions, _multiplier(point)))
                return None
            matrix = path.T @ path + self.constant
            value += float(np.sum(_multiplier(point) * self.constant))
            self._note(path, matrix)
            if value < bound:
                bound, chosen = value, point
            paths.append(path)
            planes.append(_plane(matrix))
            least, point, shares = _lowest(planes)
            self._note_joined(paths, shares)
            near = bound - least <= ENOUGH * abs(bound) or bound <= self.lower * (1 + self.gap)
            if near or self._spent:
                break
        return _Node(-bound, next(self.serial), conditions, bound, chosen, paths, shares)

    def _note(self, path: Array, matrix: Array) -> None:
        smallest = float(np.linalg.eigvalsh(matrix)[0])
        if smallest > self.lower:
            self.lower, self.best = smallest, path

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
            smallest = np.linalg.eigvalsh(done + left + self.constant)[:, 0]
            best = int(np.argmax(smallest))
            if smallest[best] > self.lower:
                path = np.concatenate([first[: times[best]], second[times[best] :]])
                self.lower, self.best = float(smallest[best]), path

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


def _multiplier(point: Array) -> Array:
    # Z = (I + point . Pauli) / 2 for a point in the unit disc.
    return np.array([[1 + point[0], point[1]], [point[1], 1 - point[0]]]) / 2


def _plane(matrix: Array) -> tuple[float, Array]:
    # tr(Z F) = offset + slope . point.
    return float(np.trace(matrix)) / 2, np.array([(matrix[0, 0] - matrix[1, 1]) / 2, matrix[0, 1]])


def _lowest(planes: list[tuple[float, Array]]) -> tuple[float, Array, Array]:
    # The lowest point of the planes' maximum over a polygon inside the disc, and the planes' shares in it.
    angles = 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    sides = np.stack([np.cos(angles), np.sin(angles), np.zeros(DIRECTIONS)], axis=1)
    size = max(abs(offset) for offset, _ in planes) or 1.0
    rows = [np.concatenate([slope / size, [-1.0]]) for _, slope in planes]
    offsets = [-offset / size for offset, _ in planes]
    found = scipy.optimize.linprog(
        [0.0, 0.0, 1.0],
        A_ub=np.vstack([rows, sides]),
        b_ub=np.concatenate([offsets, np.full(DIRECTIONS, np.cos(np.pi / DIRECTIONS))]),
        bounds=[(None, None)] * 3,
        method="highs",
    )
    shares = -np.asarray(found.ineqlin.marginals[: len(planes)])
    return float(found.x[2]) * size, np.asarray(found.x[:2]), np.asarray(shares)
