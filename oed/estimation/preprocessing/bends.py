"""Bends of a path, measured and predicted: positions alone show to which side a robot turns.

A path is that of a robot with its wheels exchanged, and the same in a mirror, but for where they turn to.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from oed.estimation.preprocessing.moves import AS_READ, FEWEST, Axes, Moves
from oed.foundation.arrays import Array

Plane = npt.NDArray[np.complex128]
"""Moves in the plane."""

SPANS = (1, 2, 4, 8)
"""Moves that a chord is made of: the noise of positions matters the less the longer it is, and robots drive
all round in the longest."""
TURNING = (1.0, 0.75, 0.5, 0.35, 1.5)
"""Times its nominal parameters' that a robot may turn: one that skids does half as much."""


@dataclass(frozen=True)
class Bends:
    """Changes of direction from one chord of a path to the next.

    Attributes:
        moves: of logs with positions.
    """

    moves: Moves

    def unexplained(self, inputs: Array, axes: Axes = AS_READ) -> Array:
        """Share of the measured bends that predicted ones leave, for chords of each of `SPANS`, (spans,), of
        the amount of turning that suits best; infinite where there are too few.

        Args:
            inputs: logged ones, or others.
            axes: of positions that may have been read along other axes.
        """
        x, y = self.moves.changes("x"), self.moves.changes("y")
        assert x is not None
        assert y is not None
        measured, rolled = axes[0] * x + axes[1] * y, self.moves.rolled(inputs)
        each = [self._left(measured, rolled, factor) for factor in TURNING]
        return np.asarray(np.min(each, axis=0))

    def _left(self, measured: Plane, rolled: dict[str, Array], factor: float) -> list[float]:
        turns = factor * rolled["turn"]
        before = np.concatenate([[0.0], np.cumsum(turns)[:-1]])
        # A move of another length is bent alike: the mean direction is half its turn from its start's.
        own = (rolled["forward"] + 1j * rolled["left"]) * np.exp(1j * (turns - rolled["turn"]) / 2)
        predicted = own * np.exp(1j * before)
        return [_share(self._chords(measured, span), self._chords(predicted, span)) for span in SPANS]

    def _chords(self, path: Plane, span: int) -> list[Plane]:
        running = np.concatenate([[0.0], np.cumsum(path)])
        found = []
        for first, last in self._stretches:
            edges = np.arange(first, last + 1, span)
            found.append(np.diff(running[edges]))
        return found

    @cached_property
    def _stretches(self) -> list[tuple[int, int]]:
        # Ranges of moves that follow each other.
        layout = self.moves.layout
        ends = layout.times[:, -1]
        apart = (layout.owner[1:] != layout.owner[:-1]) | (layout.times[1:, 0] != ends[:-1])
        return list(pairwise([0, *(np.flatnonzero(apart) + 1).tolist(), layout.count]))


def _share(measured: list[Plane], predicted: list[Plane]) -> float:
    # Bends count by the lengths of their chords, so that standing about is none. Where a robot reverses,
    # chords do alike, whatever it turns.
    left, whole, count = 0.0, 0.0, 0
    for own, other in zip(_bends(measured), _bends(predicted), strict=True):
        reverses = np.where(other.real < 0, -1.0, 1.0)
        size = np.abs(own)
        unit = np.divide(other, np.abs(other), out=np.ones_like(other), where=np.abs(other) > 0)
        left += float((np.abs(own - size * unit) ** 2).sum())
        whole += float((np.abs(own * reverses - size) ** 2).sum())
        count += len(own)
    return left / whole if whole > 0 and count >= FEWEST else np.inf


def _bends(chords: list[Plane]) -> Iterator[Plane]:
    # In the direction of each bend, as long as both chords together.
    for own in chords:
        bend = own[1:] * own[:-1].conj()
        yield bend / np.sqrt(np.maximum(np.abs(bend), np.finfo(float).tiny))
