"""Where a path from a known start can be, and how much turning out of its heading takes from its length."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from oed.bounds.value_grid import ValueGrid
from oed.foundation.arrays import Array, Bools

TOUCH = 1e-9
"""Share of lengths by which reach is enlarged for rounding."""


@dataclass(frozen=True)
class Start:
    """Where a path begins.

    Going a distance d in a direction that differs by phi from the line along the heading, forwards or
    backwards, takes at least d + b phi of what top speed allows, where forward speed and b times the yaw rate
    share it: the heading turns to that direction at some time. A robot that turns by w < phi alone gets there
    by shunting, over a length d sin(phi - w / 2) / sin(w / 2) or more: with b w no less unless d < b.

    Attributes:
        place: of the first sample, (2,).
        spare: how far from there it may be.
        heading: at the first sample [rad]; None where that says nothing.
        heading_spare: how far from it the heading may be [rad].
        turning: b, length of path that turning by 1 rad takes.
    """

    place: tuple[float, float]
    spare: float = 0.0
    heading: float | None = None
    heading_spare: float = 0.0
    turning: float = 0.0

    def reached(self, grid: ValueGrid, length: float) -> Bools:
        """Nodes within a cell of where a path of that length can end, (nx, ny)."""
        # Asked for again with every centre.
        return np.asarray(_needed(self, grid) <= length * (1 + TOUCH) + TOUCH * float(grid.sizes.max()))

    def needed(self, grid: ValueGrid) -> Array:
        """Length of the shortest path to within a cell of every node, (nx, ny)."""
        x, y = grid.axes
        offsets = list(np.meshgrid(x - self.place[0], y - self.place[1], indexing="ij"))
        width = grid.sizes + self.spare
        nearest = np.hypot(*(np.maximum(np.abs(one) - w, 0) for one, w in zip(offsets, width, strict=True)))
        turned = np.where(nearest >= self.turning, self._turned(offsets, float(np.hypot(*width))), 0.0)
        return np.asarray(nearest + self.turning * turned)

    def _turned(self, offsets: list[Array], radius: float) -> Array:
        # The least angle to the line along the heading of what is within a radius of each place.
        if self.heading is None or not self.turning:
            return np.zeros(offsets[0].shape)
        distance = np.hypot(*offsets)
        double = 2 * (np.arctan2(offsets[1], offsets[0]) - self.heading)
        angle = np.abs(np.arctan2(np.sin(double), np.cos(double))) / 2
        seen = np.arcsin(np.minimum(radius / np.maximum(distance, radius), 1.0))
        return np.asarray(np.maximum(angle - seen - self.heading_spare, 0.0))


_needed = lru_cache(maxsize=8)(Start.needed)
