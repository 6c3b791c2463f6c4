"""What a path keeps to: a room, a start, and how far it gets."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from oed.bounds.blocks import block_size
from oed.bounds.starts import Start
from oed.bounds.value_grid import ValueGrid
from oed.foundation.arrays import Array

SIDE = 2.0
"""Longest side of a room in the units in which bounds are sought."""
FEWEST = 12
"""Cells along a side, at least."""
WANTED = 5.1
"""Cells that a step is to be long, for a stencil's sides across the axes to reach a cell to either side."""
SAME = 1e-12
"""Lengths that are the same."""

Image: TypeAlias = Callable[[Array], Array]
"""What mirrors functions of cells (..., nx, ny)."""


@dataclass(frozen=True)
class Room:
    """What a path keeps to, in units in which its longest side is `SIDE`.

    Attributes:
        low: corner, (2,).
        high: corner opposite, (2,).
        distances: of the readings along the longest path, (n,).
        start: where paths begin; None for anywhere.
    """

    low: tuple[float, float]
    high: tuple[float, float]
    distances: Array
    start: Start | None

    def grid(self, cells: int) -> ValueGrid:
        """One with so many cells along the longest side."""
        sides = np.array(self.high) - np.array(self.low)
        x, y = (max(FEWEST, round(cells * side / SIDE)) for side in sides)
        return ValueGrid(self.low, self.high, (x, y))

    def size(self, grid: ValueGrid) -> int:
        """Readings of a block."""
        return block_size(np.diff(self.distances), WANTED * float(grid.sizes.max()))

    @property
    def key(self) -> tuple[float, ...]:
        """What rooms have in common that centres of one are of use to the other."""
        place = () if self.start is None else self.start.place
        return tuple(round(float(one), 1) for one in (*self.high, *place, len(self.distances)))

    @property
    def images(self) -> tuple[Image, ...]:
        """Of functions of cells (..., nx, ny): what is as true of every path mirrored."""
        found: list[Image] = [lambda values: values]
        for axis in range(2):
            if self._mirrored(axis):
                found += [_flipped(one, axis - 2) for one in list(found)]
        width, height = np.array(self.high) - np.array(self.low)
        even = self.start is None or (self.start.heading is None and _even(self.start.place, self))
        if even and abs(width - height) < SAME:
            found += [_swapped(one) for one in list(found)]
        return tuple(found)

    def _mirrored(self, axis: int) -> bool:
        if self.start is None:
            return True
        middle = (self.low[axis] + self.high[axis]) / 2
        along = self.start.heading is None or abs(np.sin(2 * self.start.heading)) < SAME
        return bool(along and abs(self.start.place[axis] - middle) < SAME)


def _even(place: tuple[float, float], room: Room) -> bool:
    # Whether a place is as far from the lower wall along both axes.
    return bool(abs((place[0] - room.low[0]) - (place[1] - room.low[1])) < SAME)


def _flipped(one: Image, axis: int) -> Image:
    return lambda values: np.flip(one(values), axis)


def _swapped(one: Image) -> Image:
    return lambda values: np.swapaxes(one(values), -1, -2)
