"""Dynamic programming over positions: the largest sum of squared distances from a centre, by where a path is
at a moment in the middle.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from oed.bounds.blocks import Blocks
from oed.bounds.starts import Start
from oed.bounds.value_grid import NOWHERE, Singles, ValueGrid, dilated
from oed.foundation.arrays import Array, Bools


@dataclass
class Passage:
    """Values of paths through each node in the middle, and what it takes to follow the best of them.

    Attributes:
        values: at least the largest sum, (k, nx, ny), for each of k centres.
        before: values of what went before, reading by reading towards the middle, and steps from each to
            the next, where they are kept.
        after: values of what follows, away from the middle, and steps to each.
    """

    values: Singles
    before: list[tuple[Singles, float]] = field(default_factory=list)
    after: list[tuple[Singles, float]] = field(default_factory=list)


def passage(
    grid: ValueGrid, centres: Array, course: Blocks, start: Start | None, kept: bool = False
) -> Passage:
    """The largest sums by the place in the middle.

    Args:
        grid: of the places.
        centres: from which distances are taken, (k, 2).
        course: steps of the path.
        start: where it begins; None for anywhere.
        kept: whether to keep what `followed` needs.
    """
    squares = grid.squares(centres)
    found = Passage(squares)
    past = _came(grid, squares, course, start, found.before if kept else None)
    values = np.zeros_like(squares)
    if course.ends:
        for step in (*course.after[::-1], course.from_middle):
            values = squares + values
            if kept:
                found.after.append((values, float(step)))
            values = grid.within(values, float(step))
    found.values = past + values
    found.after.reverse()
    return found


def _came(
    grid: ValueGrid,
    squares: Singles,
    course: Blocks,
    start: Start | None,
    tables: list[tuple[Singles, float]] | None,
) -> Singles:
    # What can have been gathered on the way to each node in the middle.
    values, known = _reached(grid, np.zeros_like(squares), start, 0.0)
    for step, length in zip(course.before, course.reached, strict=True):
        values = squares + grid.within(values, float(step), known)
        values, known = _reached(grid, values, start, float(length))
        if tables is not None:
            tables.append((values, 0.0))
    if tables is not None:
        steps = [*course.before[1:], course.to_middle]
        tables[:] = [(table, float(step)) for (table, _), step in zip(tables, steps, strict=True)]
    values = grid.within(values, course.to_middle, known)
    if start is None:
        return values
    return np.where(start.reached(grid, course.middle), values, NOWHERE)


def _reached(
    grid: ValueGrid, values: Singles, start: Start | None, length: float
) -> tuple[Singles, Bools | None]:
    # Nodes of cells that a path can be in keep their values, their neighbours go on like these.
    known = None if start is None else start.reached(grid, length)
    if known is None or known.all():
        return values, None
    return np.where(known, values, dilated(np.where(known, values, NOWHERE))), known


def followed(grid: ValueGrid, found: Passage, which: int, node: tuple[int, int]) -> Array:
    """About the places (count, 2) of the best path through a node, for one of the centres.

    Args:
        grid: of the places.
        found: with what is kept.
        which: of the centres.
        node: in the middle.
    """
    past = _traced(grid, [(table[which], step) for table, step in found.before[::-1]], node)
    coming = _traced(grid, [(table[which], step) for table, step in found.after], node)
    return np.concatenate([past, coming]) * grid.sizes + grid.low


def _traced(grid: ValueGrid, tables: list[tuple[Singles, float]], node: tuple[int, int]) -> Array:
    # In cells: from each place to the best within reach.
    place, places = np.array(node, dtype=float), []
    last = np.array(grid.cells)
    for table, step in tables:
        if step > 0:
            options = np.clip(place + grid.stencil(step).places, 0, last)
            corner = np.minimum(options.astype(int), last - 1)
            (fx, fy), (i, j) = (options - corner).T, corner.T
            low, high = (table[i, b] * (1 - fx) + table[i + 1, b] * fx for b in (j, j + 1))
            place = options[int(np.argmax(low * (1 - fy) + high * fy))]
        places.append(place)
    return np.array(places).reshape(-1, 2)
