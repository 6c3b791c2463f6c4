"""Gaussian states one after another by the blocks of their precision, which is 0 but next to its diagonal."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from oed.foundation.arrays import Array


class Chain(NamedTuple):
    """States of segments at their times, each following from the one before; of several chains in one array.

    Attributes:
        first: precision of the first states, (..., m).
        moves: how states follow, (..., S, n, m, m).
        added: precision of what is added on the way, (..., S, n, m).
    """

    first: Array
    moves: Array
    added: Array

    @property
    def precision(self) -> tuple[Array, Array]:
        """Blocks on the diagonal of the states' precision matrix and below it, (..., S, n + 1, m, m) each."""
        *count, steps, side = self.added.shape
        own, below = np.zeros((2, *count, steps + 1, side, side))
        places = np.arange(side)
        weighted = self.added[..., None] * self.moves
        own[..., 0, places, places] = self.first[..., None, :]
        own[..., :-1, :, :] += self.moves.swapaxes(-1, -2) @ weighted
        own[..., 1:, places, places] += self.added
        below[..., :-1, :, :] = -weighted
        return own, below

    @property
    def volume(self) -> Array:
        """Logarithm of its determinant, (...)."""
        firsts = self.added.shape[-3] * np.log(self.first).sum(axis=-1)
        return np.asarray(firsts + np.log(self.added).sum(axis=(-3, -2, -1)))
