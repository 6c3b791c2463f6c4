"""Which unknowns each run has: it is moved by these alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from oed.foundation.arrays import Places
from oed.kernel.dynamics.embedding import Embedding


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
        """Return the runs' unknowns in a z with those of the inputs first, then as many of each start state.

        Args:
            embedding: what the inputs' unknowns are.
            size: of z.
        """
        runs = embedding.space.runs
        started = (size - embedding.size) // runs
        firsts = [place.start for place in embedding.slices]
        is_shared = [signal.shared for signal in embedding.signals]
        blocks = zip(
            [*firsts, embedding.size], [*embedding.counts, started], [*is_shared, False], strict=True
        )
        columns = [
            first + (0 if shared else count) * np.arange(runs)[:, None] + np.arange(count)
            for first, count, shared in blocks
        ]
        return cls(np.concatenate(columns, axis=1), size)

    @property
    def runs(self) -> int:
        """Number of runs."""
        return len(self.places)

    @property
    def per_run(self) -> int:
        """Number of unknowns of a run."""
        return int(self.places.shape[1])
