"""Centres about which squared distances bound paths, whichever cell they are in at a moment in the middle."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from oed.bounds.blocks import Blocks
from oed.bounds.passage import Passage, followed, passage
from oed.bounds.path_room import Room
from oed.bounds.planes import Plane, best_centre, plane_through
from oed.bounds.value_grid import ValueGrid, over_cells
from oed.foundation.arrays import Array, Bools

TOGETHER = 4
"""Centres that are tried at a time."""
APART = 3
"""Cells between those whose centres are sought at the same time."""
NEAR = 0.04
"""Share of the bound within which cells are worth a centre of their own."""
ENOUGH = 2e-4
"""Share of the bound that one more centre has to lower it by."""


@dataclass
class Search:
    """Centres that bound every cell, on one grid.

    Attributes:
        room: of the paths.
        grid: of the places.
        courses: their steps.
        readings: that count in all; by default those of the courses.
        bounds: lowest bound of each cell so far, (nx - 1, ny - 1).
        centres: that were tried.
        each: what each of them bounds the cells by.
        planes: of paths through a cell.
        closed: cells that have their best centre.
    """

    room: Room
    grid: ValueGrid
    courses: tuple[Blocks, ...]
    readings: float = 0.0
    bounds: Array = field(init=False)
    centres: list[Array] = field(default_factory=list)
    each: list[Array] = field(default_factory=list)
    planes: dict[tuple[int, int], list[Plane]] = field(default_factory=dict)
    closed: set[tuple[int, int]] = field(default_factory=set)

    def __post_init__(self) -> None:
        """Begin with no bound."""
        self.bounds = np.full(self.grid.cells, np.inf)
        counted = float(sum(course.weight * course.count for course in self.courses))
        self.readings = self.readings or counted
        self._factor = self.readings / counted

    def tried(self, centres: Array, kept: bool = False) -> Passage:
        """Note what centres (k, 2) bound."""
        passages = [passage(self.grid, centres, one, self.room.start, kept) for one in self.courses]
        weights = [self._factor * course.weight for course in self.courses]
        values = sum(weight * over_cells(one.values) for weight, one in zip(weights, passages, strict=True))
        cells = np.asarray(values, dtype=float)
        for centre, one in zip(centres, cells, strict=True):
            lowest = np.min([image(one) for image in self.room.images], axis=0)
            self.each.append(lowest)
            self.centres.append(centre)
            self.lower(lowest)
        return passages[0]

    def lower(self, bounds: Array) -> None:
        """Have the cells bounded by no more than this, (nx - 1, ny - 1)."""
        np.minimum(self.bounds, bounds, out=self.bounds)

    def improve(self) -> bool:
        """One more centre for each of the worst cells; whether that was worth while."""
        worst = float(self.bounds[self._own].max())
        chosen, centres = self._chosen(worst)
        if not chosen:
            return False
        found = self.tried(np.array(centres), kept=True)
        for which, cell in enumerate(chosen):
            self._learn(found, which, cell, centres[which])
        return True

    @property
    def _own(self) -> Bools:
        # Of cells that are images of each other one is enough: that with the largest places.
        x, y = (np.arange(cells)[:, None] for cells in self.grid.cells)
        order = x + self.grid.cells[0] * (y.T + 0.0)
        ranks = np.max([image(order) for image in self.room.images], axis=0)
        return np.asarray(order == ranks)

    def _chosen(self, worst: float) -> tuple[list[tuple[int, int]], list[Array]]:
        left = np.where(self._own, self.bounds, -np.inf)
        for cell in self.closed:
            left[cell] = -np.inf
        chosen: list[tuple[int, int]] = []
        centres: list[Array] = []
        if any(self.bounds[cell] >= worst * (1 - ENOUGH) for cell in self.closed):
            return chosen, centres
        while len(chosen) < TOGETHER and left.max() > (1 - NEAR) * worst:
            x, y = (int(one) for one in np.unravel_index(int(left.argmax()), left.shape))
            left[max(x - APART, 0) : x + APART + 1, max(y - APART, 0) : y + APART + 1] = -np.inf
            centre = self._wanted((x, y))
            if centre is None:
                self.closed.add((x, y))
            else:
                chosen.append((x, y))
                centres.append(centre)
        return chosen, centres

    def _wanted(self, cell: tuple[int, int]) -> Array | None:
        # The next centre of a cell, by its planes or at first by those nearby; None where it has its best.
        own = self.planes.setdefault(cell, [])
        low, high = np.array(self.room.low), np.array(self.room.high)
        if own:
            centre, least = best_centre(own, self.readings, low, high)
            return centre if least < self.bounds[cell] * (1 - ENOUGH) else None
        others = [one for one, planes in self.planes.items() if planes]
        if not others:
            return np.asarray(0.3 * (self.grid.low + self.grid.sizes * cell))
        near = min(others, key=lambda one: (one[0] - cell[0]) ** 2 + (one[1] - cell[1]) ** 2)
        return best_centre(self.planes[near], self.readings, low, high)[0]

    def _learn(self, found: Passage, which: int, cell: tuple[int, int], centre: Array) -> None:
        corners = [(cell[0] + x, cell[1] + y) for x in (0, 1) for y in (0, 1)]
        corners.sort(key=lambda one: -float(found.values[which][one]))
        for node in corners[:2]:
            path = followed(self.grid, found, which, node)
            weight = self.readings / len(path)
            value = weight * float(found.values[which][node])
            self.planes[cell].append(plane_through(path, weight, centre, value))

    def fewest(self, most: int) -> Array:
        """Of the centres tried, some that bound the cells about as well together, (k, 2)."""
        own = self._own
        each = np.array([one[own] for one in self.each])
        lowest, slack = each.min(axis=0), ENOUGH
        while True:
            allowed = np.maximum(lowest, lowest.max() * (1 - slack)) * (1 + slack)
            chosen = _cover(each <= allowed)
            if len(chosen) <= most:
                return np.array([self.centres[one] for one in chosen])
            slack *= 1.5


def _cover(good: Bools) -> list[int]:
    # Rows of which each column has a true one, the most useful first.
    chosen: list[int] = []
    left = np.ones(good.shape[1], dtype=bool)
    while left.any():
        chosen.append(int(good[:, left].sum(axis=1).argmax()))
        left &= ~good[chosen[-1]]
    return chosen
