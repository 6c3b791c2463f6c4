"""How far apart positions can lie that keep to a room and to a top speed along the path: a bound.

The sum of |p_k - mean|^2 is the least over centres c of the sum of |p_k - c|^2, so any c bounds it for all
paths that are in one cell of a grid at a moment in the middle. Dynamic programming over positions has that
bound for all cells at once; of every cell the lowest over all c tried counts, and of these the largest.
Without such a moment little is gained: a path that stays where it came to first is far from c, and so is its
mirror image, and both share one c. Centres are found by cutting planes on a coarse grid, each the best path
that a bound of the worst cell comes from.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from oed.bounds.blocks import Blocks, blocks
from oed.bounds.centre_search import TOGETHER, Search
from oed.bounds.effort import STAGE, Effort
from oed.bounds.path_room import SIDE, Room
from oed.bounds.starts import Start
from oed.bounds.value_grid import ValueGrid, rounded_up
from oed.foundation.arrays import Array, Bools

COARSE, FINE = 56, 112
"""Cells along the longest side where centres are sought, and where the bound is proved."""
FIRST = (0.0, 0.3, 0.6)
"""First centres along each axis, as shares of the way from the middle to a wall."""
MIDDLE = {False: 0.5, True: 0.55}
"""Moment that is taken for the middle, as a share of the readings, by whether the start is known."""
CENTRES = 240
"""Centres that are tried on the coarse grid, at most."""
PROVED = 72
"""Centres with which the bound is proved, at most."""


def largest_planar_spread(
    room: tuple[float, float, float, float], steps: Array, read: Bools, start: Start | None, effort: Effort
) -> float:
    """At least the largest sum of |p_k - mean|^2 over the samples read; infinity where the time is up before.

    Args:
        room: x_min, x_max, y_min, y_max that all positions keep to.
        steps: largest distance between samples, (N,).
        read: which of the N + 1 samples are read.
        start: where paths begin; None for anywhere.
        effort: that may be spent.
    """
    distances = np.concatenate([[0.0], np.cumsum(steps)])[read]
    if len(distances) < 2:
        return 0.0
    own, scale = _scaled(room, distances, start)
    if own is None:
        return np.inf
    centres = effort.known_centres(own.key)
    if centres is None:
        centres = _centres(own, effort)
        effort.remember(own.key, centres)
    return scale**2 * _proved(own, centres, effort)


def _scaled(
    room: tuple[float, float, float, float], distances: Array, start: Start | None
) -> tuple[Room | None, float]:
    # About the middle of what paths can come to, its longest side `SIDE`; None where it has no area.
    low, high = np.array(room[::2]), np.array(room[1::2])
    longest = float(distances[-1])
    if start is None:
        # A path can be anywhere that it fits.
        high = np.minimum(high, low + longest)
    else:
        place, most = np.array(start.place), longest + start.spare
        low, high = np.maximum(low, place - most), np.minimum(high, place + most)
    sides = high - low
    if not (sides > 1e-6 * sides.max()).all():
        return None, 0.0
    middle, scale = (low + high) / 2, float(sides.max()) / SIDE
    half = sides / scale / 2
    own = None
    if start is not None:
        place = (np.array(start.place) - middle) / scale
        own = replace(
            start,
            place=(float(place[0]), float(place[1])),
            spare=start.spare / scale,
            turning=start.turning / scale,
        )
    ends = (float(-half[0]), float(-half[1])), (float(half[0]), float(half[1]))
    return Room(*ends, distances / scale, own), scale


def _search(room: Room, cells: int, whole: bool) -> Search:
    # Of all readings, or of every m-th of them for all.
    grid, count = room.grid(cells), len(room.distances)
    size = room.size(grid)
    first = int(np.clip(round(MIDDLE[room.start is not None] * count / size), 1, count // size))
    courses = blocks(room.distances, size, first)
    return Search(room, grid, courses) if whole else Search(room, grid, courses[:1], count)


def _centres(room: Room, effort: Effort) -> Array:
    # That bound all cells about as well together as all that were tried.
    search = _search(room, COARSE, whole=False)
    half = np.array(room.high)
    first = np.array([(x, y) for x in FIRST for y in FIRST]) * half
    # Images of a centre's bounds are bounds, too.
    signs = ((1, 1),) if len(room.images) >= 4 else ((1, 1), (-1, 1), (1, -1), (-1, -1))
    first = np.unique(np.concatenate([first * sign for sign in signs]), axis=0)
    search.tried(first)
    most = effort.most(CENTRES)
    effort.progress.begin(STAGE, (most - len(first)) // TOGETHER + 1)
    while len(search.centres) < most and not effort.spent and search.improve():
        effort.progress.advance()
    return search.fewest(effort.most(PROVED))


def _proved(room: Room, centres: Array, effort: Effort) -> float:
    search = _search(room, COARSE if effort.spent else FINE, whole=True)
    parts = np.array_split(centres, -(-len(centres) // TOGETHER))
    effort.progress.begin(STAGE, len(parts))
    tasks = [_Part(search.room, search.grid, search.courses, part) for part in parts]
    effort.shared(_bounded, tasks, search.lower)
    return rounded_up(float(search.bounds.max()), sum(course.count + 2 for course in search.courses))


@dataclass(frozen=True)
class _Part:
    # Of the centres with which a bound is proved.
    room: Room
    grid: ValueGrid
    courses: tuple[Blocks, ...]
    centres: Array


def _bounded(part: _Part) -> Array:
    # What they bound each cell by.
    search = Search(part.room, part.grid, part.courses)
    search.tried(part.centres)
    return search.bounds
