"""Functions of a position in a rectangle by their values at the nodes of a grid, bilinear between: their
largest values within reach, rounded up.

Let u be a function on the nodes, and p a place in a cell whose corners n_i it mixes with weights w_i. What is
at p + d is at most the mixture of what is at n_i + d, plus a quarter of how much u bends downwards across the
lines of the grid there: a piecewise linear function exceeds its chord over one cell by at most a quarter of
its change of slope. So u is raised by that much before the largest value around each node is taken, and
the results, bilinear again, bound what is best within reach of every place. Beyond a wall u goes on as at the
wall. In the cells along a wall nothing is lost to the bend at the wall itself: what is between a node of such
a cell and the wall is within its reach, too, where the disc's flat sides reach a cell to either side.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt
import scipy

from oed.bounds.stencils import Stencil, stencil
from oed.foundation.arrays import Array, Bools

Singles: TypeAlias = npt.NDArray[np.float32]
"""Values at nodes (k, nx, ny) of k functions, in single precision for speed."""
NOWHERE = np.float32(-1e8)
"""The value where no path can be."""
EPSILON = float(np.finfo(np.float32).eps)
"""Share that one rounding takes at most."""
ROUNDINGS = 24
"""Roundings of one step, at most."""


@dataclass(frozen=True)
class ValueGrid:
    """A rectangle with nodes at its walls and between.

    Attributes:
        low: its corner, (2,).
        high: the corner opposite, (2,).
        cells: along each axis, at least 2.
    """

    low: tuple[float, float]
    high: tuple[float, float]
    cells: tuple[int, int]

    @property
    def sizes(self) -> Array:
        """Sides of a cell, (2,)."""
        return np.asarray((np.array(self.high) - np.array(self.low)) / self.cells)

    @property
    def axes(self) -> tuple[Array, Array]:
        """Where the nodes are along each axis."""
        both = zip(self.low, self.high, self.cells, strict=True)
        x, y = (np.linspace(low, high, cells + 1) for low, high, cells in both)
        return x, y

    def stencil(self, distance: float) -> Stencil:
        """That of a reach of so much."""
        x, y = distance / self.sizes
        return stencil(float(x), float(y))

    def squares(self, centres: Array) -> Singles:
        """Squared distances of the nodes from centres (k, 2)."""
        x, y = self.axes
        own = (x[None, :] - centres[:, :1]) ** 2
        return np.asarray(own[:, :, None] + (y - centres[:, 1:])[:, None, :] ** 2, dtype=np.float32)

    def within(self, values: Singles, distance: float, known: Bools | None = None) -> Singles:
        """At least the largest value within a distance of every place.

        Args:
            values: at the nodes.
            distance: to the farthest place in reach.
            known: nodes within a cell of where a path can be, the only ones that count; all by default. Their
                neighbours need values, too.
        """
        if distance <= 0:
            return values
        here = self.stencil(distance)
        # Functions stand side by side at every node: steps from node to node are steps along a flat array.
        beside = np.ascontiguousarray(values.transpose(1, 2, 0))
        raised, walls = _raised(beside, here, None if known is None else known[..., None])
        twisted = _twists(raised, known)
        best = _around(raised + np.float32(here.piece / 4) * twisted, here)
        np.maximum(best, _inside(raised, here), out=best)
        _raise_near_walls(best, walls, here)
        return np.ascontiguousarray(best.transpose(2, 0, 1))


def rounded_up(largest: float, steps: int) -> float:
    """At least what a value is that so many steps in single precision led to."""
    return largest + ROUNDINGS * EPSILON * (steps + 1) * abs(largest)


def dilated(values: Singles) -> Singles:
    """The largest of every node and its neighbours."""
    return _spread(_spread(values, 1, 1), 2, 1)


def over_cells(values: Singles) -> Singles:
    """The largest value of the four corners of each cell, (k, nx - 1, ny - 1)."""
    along = np.maximum(values[:, 1:], values[:, :-1])
    return np.asarray(np.maximum(along[:, :, 1:], along[:, :, :-1]))


Beside: TypeAlias = npt.NDArray[np.float32]
"""Values of k functions side by side at each node, (nx, ny, k)."""
Walls: TypeAlias = tuple[Beside, Beside] | None


def _raised(values: Beside, here: Stencil, known: Bools | None) -> tuple[Beside, Walls]:
    # The values and a quarter of their bends downwards nearby; apart from these, where they need not count
    # for all nodes, the bends at the walls across x, (2, ny, k), and across y, (nx, 2, k).
    padded = _padded(values, 1)
    twice = values + values
    across = np.maximum(twice - padded[:-2, 1:-1] - padded[2:, 1:-1], 0)
    along = np.maximum(twice - padded[1:-1, :-2] - padded[1:-1, 2:], 0)
    if known is not None:
        across, along = np.where(known, across, 0), np.where(known, along, 0)
    walls = None
    # A grid so narrow that one wall is near the other does without.
    if here.flat and all(
        size > radius + 4 for size, radius in zip(values.shape[:2], here.radii, strict=True)
    ):
        walls = across[[0, -1]].copy(), along[:, [0, -1]].copy()
        across[[0, -1]], along[:, [0, -1]] = 0, 0
    bends = _spread(_spread(across, 0, 1), 1, 2) + _spread(_spread(along, 0, 1), 1, 1)
    return np.asarray(values + bends / 4, dtype=np.float32), walls


def _raise_near_walls(best: Beside, walls: Walls, here: Stencil) -> None:
    # Bends at the walls, for all nodes within reach of them but those at that wall.
    if walls is None:
        return
    across, along = walls
    near, far = (int(np.ceil(radius)) for radius in here.radii)
    own = scipy.ndimage.maximum_filter1d(across, 2 * far + 3, axis=1, mode="nearest") / 4
    best[1 : near + 2] += own[:1]
    best[-near - 2 : -1] += own[1:]
    own = scipy.ndimage.maximum_filter1d(along, 2 * near + 3, axis=0, mode="nearest") / 4
    best[:, 1 : far + 2] += own[:, :1]
    best[:, -far - 2 : -1] += own[:, 1:]


def _twists(values: Beside, known: Bools | None) -> Beside:
    # How far each node's cells are from linear: the largest difference of differences.
    twist = np.abs(values[:-1, :-1] + values[1:, 1:] - values[1:, :-1] - values[:-1, 1:])
    if known is not None:
        # Cells with a node that has no value are none of a path's.
        valued = values[..., 0] > NOWHERE / 2
        whole = valued[:-1, :-1] & valued[1:, 1:] & valued[1:, :-1] & valued[:-1, 1:]
        twist = np.where(whole[..., None], twist, 0)
    # No cell at the walls has none of its nodes beside another.
    rows, columns, count = values.shape
    padded = np.zeros((rows + 1, columns + 1, count), dtype=np.float32)
    padded[1:-1, 1:-1] = twist
    along = np.maximum(padded[1:], padded[:-1])
    return np.asarray(np.maximum(along[:, 1:], along[:, :-1]))


def _padded(values: Beside, margin: int) -> Beside:
    # The values, and so many nodes around that go on as the nearest.
    rows, columns, count = values.shape
    found = np.empty((rows + 2 * margin, columns + 2 * margin, count), dtype=np.float32)
    own = found[margin:-margin]
    own[:, margin:-margin] = values
    own[:, :margin], own[:, -margin:] = values[:, :1], values[:, -1:]
    found[:margin], found[-margin:] = own[:1], own[-1:]
    return found


def _around(values: Beside, here: Stencil) -> Beside:
    # The largest value at the stencil's points around each node. Steps beyond a row's end run over into the
    # next one's margin, and are left out afterwards.
    margin, (rows, columns, count) = here.reach, values.shape
    padded = _padded(values, margin)
    width, flat = padded.shape[1] * count, padded.ravel()
    best = np.full(rows * width, 10 * NOWHERE, dtype=np.float32)
    mixed, taken = np.empty_like(best), np.empty_like(flat)
    for first, share, heights in here.slanted:
        begin = (margin + first) * width
        column = flat[begin : begin + len(best)]
        if share:
            column = _between(column, flat[begin + width :], share, mixed)
        for start, rest in heights:
            part = column[(margin + start) * count :]
            if rest:
                part = _between(part[:-count], part[count:], rest, taken)
            _raise_to(best, part)
    for (start, rest), firsts in here.upright:
        # Mixed once for all columns of nodes.
        height = flat[(margin + start) * count :]
        height = _between(height[:-count], height[count:], rest, taken)
        for first in firsts:
            _raise_to(best, height[(margin + first) * width :])
    return best.reshape(rows, -1, count)[:, :columns]


def _raise_to(best: Singles, part: Singles) -> None:
    own = best[: len(part)]
    np.maximum(own, part[: len(own)], out=own)


def _between(ones: Singles, others: Singles, share: np.float32, out: Singles) -> Singles:
    # What lies a share of the way from the ones to the others, written into `out`.
    found = out[: len(ones)]
    np.subtract(others[: len(ones)], ones, out=found)
    np.multiply(found, share, out=found)
    np.add(found, ones, out=found)
    return found


def _inside(values: Beside, here: Stencil) -> Beside:
    # The largest value at the nodes inside. Beyond a wall it goes on as at the wall, which is inside then.
    margin, (rows, columns, count) = here.reach, values.shape
    padded = _padded(values, margin)
    width, flat = padded.shape[1] * count, padded.ravel()
    best = np.full(rows * width, 10 * NOWHERE, dtype=np.float32)
    column, height = flat.copy(), 0
    for x in range(len(here.columns) - 1, -1, -1):
        for y in range(height + 1, int(here.columns[x]) + 1):
            np.maximum(column[y * count :], flat[: -y * count], out=column[y * count :])
            np.maximum(column[: -y * count], flat[y * count :], out=column[: -y * count])
        height = max(height, int(here.columns[x]))
        for first in {x, -x}:
            begin = (margin + first) * width
            np.maximum(best, column[begin : begin + len(best)], out=best)
    return best.reshape(rows, -1, count)[:, margin : margin + columns]


def _spread(values: Singles, axis: int, most: int) -> Singles:
    # The largest value up to so many nodes away along an axis.
    found = values.copy()
    for shift in range(1, min(most, values.shape[axis] - 1) + 1):
        ahead, behind = [slice(None)] * values.ndim, [slice(None)] * values.ndim
        ahead[axis], behind[axis] = slice(shift, None), slice(None, -shift)
        one, other = tuple(ahead), tuple(behind)
        np.maximum(found[one], values[other], out=found[one])
        np.maximum(found[other], values[one], out=found[other])
    return found
