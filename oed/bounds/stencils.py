"""Where a function that is bilinear on the cells of a grid is largest within a disc around a node."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TypeAlias

import numpy as np

from oed.foundation.arrays import Array, Places

SIDES = 16
"""Sides of the polygon around a disc; those across the axes touch it."""
SLACK = 1 + 1e-9
"""By which factor a disc is enlarged, more than rounding can have taken from it."""
ON_LINE = 1e-9
"""Cells within which a point is on a line of the grid."""


Step: TypeAlias = tuple[int, np.float32]
Move: TypeAlias = tuple[int, np.float32, tuple[Step, ...]]


@dataclass(frozen=True)
class Stencil:
    """Points at one of which any bilinear function is largest within the polygon, up to its twist on cells.

    Attributes:
        points: on the polygon's sides: its corners, and where it crosses lines of the grid, in cells from the
            node, (k, 2).
        columns: of the nodes inside: half the height of every column, by its distance, (w + 1,).
        piece: the largest product of both sides of what lies between two points of a side, in cells.
        radii: half-axes of the disc in cells.
        flat: whether the sides across the axes reach a cell to either side.
    """

    points: Array
    columns: Places
    piece: float
    radii: tuple[float, float]
    flat: bool

    @cached_property
    def slanted(self) -> tuple[Move, ...]:
        """The points beside columns of nodes, or on nodes, by their x: the node at or before it, the share of
        the way to the next as single precision has it, and the same along y of each point.
        """
        found = [(x, tuple(y for y in heights if x[1] or not y[1])) for x, heights in self._columns]
        return tuple((*x, heights) for x, heights in found if heights)

    @cached_property
    def upright(self) -> tuple[tuple[Step, tuple[int, ...]], ...]:
        """The points on columns of nodes that are between two of these, by their y, and the columns."""
        found: dict[Step, list[int]] = {}
        for x, heights in self._columns:
            for y in heights:
                if y[1] and not x[1]:
                    found.setdefault(y, []).append(x[0])
        return tuple((y, tuple(columns)) for y, columns in found.items())

    @cached_property
    def _columns(self) -> list[tuple[Step, list[Step]]]:
        # The points, column by column.
        columns = ((x, self.points[self.points[:, 0] == x, 1]) for x in np.unique(self.points[:, 0]))
        return [(_split(x), [_split(y) for y in heights]) for x, heights in columns]

    @cached_property
    def places(self) -> Array:
        """The points and the nodes inside, (k + m, 2)."""
        inside = [
            (x, y)
            for x, height in enumerate(self.columns)
            for x in {x, -x}
            for y in range(-height, height + 1)
        ]
        return np.concatenate([self.points, inside])

    @property
    def reach(self) -> int:
        """Cells by which points may be away, a margin included."""
        return int(np.ceil(np.abs(self.points).max())) + 1


def _split(place: float) -> Step:
    before = int(np.floor(place))
    return before, np.float32(place - before)


@lru_cache(maxsize=256)
def stencil(radius_x: float, radius_y: float) -> Stencil:
    """The stencil of a disc.

    Args:
        radius_x: half-axis along x, in cells.
        radius_y: half-axis along y, in cells.
    """
    radii = np.array([radius_x, radius_y]) * SLACK
    angles = (np.arange(SIDES) + 0.5) * 2 * np.pi / SIDES
    corners = radii / np.cos(np.pi / SIDES) * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    sides = [_crossed(one, other) for one, other in zip(corners, np.roll(corners, -1, axis=0), strict=True)]
    pieces = np.concatenate([np.abs(np.diff(side, axis=0)) for side in sides])
    half_side = float(radii.min()) * np.tan(np.pi / SIDES)
    return Stencil(
        _mirrored(np.concatenate(sides)),
        _columns(radii),
        float(pieces.prod(axis=1).max()),
        (float(radii[0]), float(radii[1])),
        bool(half_side >= 1),
    )


def _crossed(one: Array, other: Array) -> Array:
    # The ends of a side, and where it crosses lines of the grid, in order.
    shares = [np.array([0.0, 1.0])]
    for axis in range(2):
        low, high = sorted((one[axis], other[axis]))
        if high - low > ON_LINE:
            lines = np.arange(np.ceil(low), np.floor(high) + 1)
            shares.append((lines - one[axis]) / (other[axis] - one[axis]))
    share = np.unique(np.clip(np.concatenate(shares), 0.0, 1.0))
    points = np.where(share[:, None] < 1, one + np.outer(share, other - one), other)
    near = np.rint(points)
    # What is on a line must not ask for the cell beyond it.
    return np.asarray(np.where(np.abs(points - near) < ON_LINE, near, points))


def _mirrored(points: Array) -> Array:
    # Those of one quarter on all sides: of points in one column, or on one row, rounding makes no two.
    own = points[(points >= 0).all(axis=1)]
    signs = np.array([(1, 1), (1, -1), (-1, 1), (-1, -1)])
    return np.unique((own * signs[:, None]).reshape(-1, 2) + 0.0, axis=0)


def _columns(radii: Array) -> Places:
    angles = np.arange(SIDES) * 2 * np.pi / SIDES
    normals = np.stack([np.cos(angles), np.sin(angles)], axis=1) / radii
    heights = []
    for x in range(int(np.floor(radii[0])) + 1):
        own = normals[normals[:, 1] > ON_LINE]
        height = ((1 - own[:, 0] * x) / own[:, 1]).min()
        heights.append(int(np.floor(height + ON_LINE)))
    return np.array(heights)
