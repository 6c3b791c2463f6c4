"""Readings in blocks: every m-th of them is a path of its own, with longer steps for a coarser grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from oed.foundation.arrays import Array, Places

WAYS = 4
"""Paths of every m-th reading that are kept apart, about; of others the longest steps of several count."""


@dataclass(frozen=True)
class Blocks:
    """Every m-th reading, before and after a moment in the middle: no such path has longer steps.

    Attributes:
        before: largest distances to each reading before the middle, from the one before or the start, (b,).
        reached: largest distances of these from the start along the path, (b,).
        to_middle: largest distance from the last of them to the middle.
        middle: largest distance of the middle from the start along the path.
        from_middle: largest distance from the middle to the next reading.
        after: largest distances between the readings that follow, (a - 1,).
        ends: whether there are any of these.
        weight: how many paths this stands for.
    """

    before: Array
    reached: Array
    to_middle: float
    middle: float
    from_middle: float
    after: Array
    ends: bool
    weight: int

    @property
    def count(self) -> int:
        """Readings of each path."""
        return len(self.before) + (len(self.after) + 1 if self.ends else 0)


def block_size(gaps: Array, wanted: float) -> int:
    """How many readings a block has for steps of the wanted length, and at least eight blocks.

    Args:
        gaps: largest distances between readings, (n - 1,).
        wanted: length.
    """
    longest = float(gaps.max())
    most = max(1, (len(gaps) + 1) // 8)
    return int(np.clip(np.ceil(wanted / longest) if longest else most, 1, most))


def blocks(distances: Array, size: int, first: int) -> tuple[Blocks, ...]:
    """Readings taken apart into every `size`-th of them; all count once.

    Args:
        distances: of the readings along the longest path, ascending from the start, (n,).
        size: of a block, m.
        first: blocks before the middle, at least 1; the middle is at the last reading of these.
    """
    rest = (len(distances) - first * size) % size
    return tuple(_blocks(distances, size, first, way) for way in ways_of(size, rest))


def ways_of(size: int, rest: int) -> list[Places]:
    """Offsets within a block whose paths are taken together.

    Args:
        size: of a block.
        rest: offsets, the first ones, whose paths have one reading more than the others.
    """
    order: Places = np.arange(size)
    parts = [part for part in (order[:rest], order[rest:]) if len(part)]
    return [
        way
        for part in parts
        for way in np.array_split(part, min(len(part), max(1, round(WAYS * len(part) / size))))
    ]


def _blocks(distances: Array, size: int, first: int, offsets: Places) -> Blocks:
    own = [distances[offset::size] for offset in offsets]
    early, late = own[0], own[-1]
    middle = float(distances[first * size - 1])
    steps = np.max([np.diff(one) for one in own], axis=0)
    ends = len(early) > first
    return Blocks(
        np.concatenate([late[:1], steps[: first - 1]]),
        late[:first],
        middle - float(early[first - 1]),
        middle,
        float(late[first]) - middle if ends else 0.0,
        steps[first:],
        ends,
        len(offsets),
    )
