"""Which unknowns each run has, and from derivatives by those to derivatives by all.

A run is moved by its own unknowns alone, so what is known of it is kept by few of them until runs are put
together. Matrices stand side by side, unknowns down the rows.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from oed.foundation.arrays import Places
from oed.kernel.dynamics.embedding import Embedding
from oed.kernel.dynamics.expression import Expression


@dataclass(frozen=True)
class RunUnknowns:
    """The unknowns of every run, some of which runs may share.

    Attributes:
        places: where they stand in z, (runs, per run), ascending.
        size: of z.
    """

    places: Places
    size: int

    @classmethod
    def of(cls, embedding: Embedding, size: int) -> RunUnknowns:
        """Of z with the inputs' unknowns first, and then as many of each run's start state.

        Args:
            embedding: what the inputs' unknowns are.
            size: of z.
        """
        runs = embedding.space.runs
        started = (size - embedding.size) // runs
        firsts = [own.start for own in embedding.slices]
        blocks = zip(
            [*firsts, embedding.size], [*embedding.counts, started], [*embedding.shared, False], strict=True
        )
        columns = [
            first + (0 if shared else count) * np.arange(runs)[:, None] + np.arange(count)
            for first, count, shared in blocks
        ]
        return cls(np.concatenate(columns, axis=1), size)

    @property
    def runs(self) -> int:
        """How many."""
        return len(self.places)

    @property
    def per_run(self) -> int:
        """How many unknowns a run has."""
        return int(self.places.shape[1])

    @property
    def common(self) -> bool:
        """Whether every run has all of them."""
        return self.per_run == self.size

    def wide(self, slopes: Expression) -> Expression:
        """Derivatives (size, n) by all unknowns, of those (per run, n) by the runs' own, as many of each."""
        if self.common:
            return slopes
        columns = slopes.shape[1]
        rows = np.repeat(self.places, columns // self.runs, axis=0)
        starts = np.arange(0, rows.size + 1, self.per_run)
        pattern = ca.Sparsity(self.size, columns, starts.tolist(), rows.ravel().tolist())
        return ca.densify(ca.sparsity_cast(ca.densify(slopes), pattern))

    def square(self, inner: Expression) -> Expression:
        """Second derivatives (size, size) by all, the sum of the runs' (per run, per run * runs)."""
        if self.common:
            return sum(ca.horzsplit(inner, self.size))
        return summed(self.places, self.size, inner)


def summed(places: Places, size: int, inner: Expression) -> Expression:
    """A matrix (size, size), the sum of matrices (own, own) that stand side by side.

    Args:
        places: where the rows and columns of each stand, (matrices, own).
        size: of the sum.
        inner: the matrices.
    """
    place = places[:, None, :] + size * places[:, :, None]
    pattern = ca.Sparsity(size**2, place.size, list(range(place.size + 1)), place.ravel().tolist())
    total = ca.DM(pattern, 1.0) @ ca.vec(inner)
    return ca.densify(ca.reshape(total, size, size))
