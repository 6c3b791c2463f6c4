"""States and inputs held where some samples of a drive that is written out begin, with derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from oed.kernel.dynamics.expression import Expression


class Begun:
    """States and inputs held where some samples begin, and their derivatives, as expressions (MX).

    Attributes:
        states: states, (states, K).
        held: inputs held in the samples, in units of their scale, (inputs, K).
    """

    def __init__(
        self, begins: Expression, states: int, unknowns: Expression, z: Expression, samples: Expression
    ) -> None:
        """Pick the samples.

        Args:
            begins: states and inputs of all samples (SX of `unknowns`), (N, states + inputs).
            states: number of states.
            unknowns: z as symbols (SX).
            z: z (MX).
            samples: samples, counted through all runs, (1, K).
        """
        self._begins, self._unknowns, self._z, self._samples = begins, unknowns, z, samples
        table = ca.Function("begins", [unknowns], [ca.densify(begins.T)])(z)
        both = gathered(table, first_entries(samples, begins.shape[1], begins.shape[1]))
        self.states, self.held = both[:states, :], both[states:, :]

    @cached_property
    def slopes(self) -> Expression:
        """Derivatives by z of the states, then the inputs held, (size, (states + inputs) K)."""
        size = self._unknowns.shape[0]
        slope = ca.densify(ca.jacobian(ca.vec(self._begins.T), self._unknowns).T)
        table = ca.Function("begins_slopes", [self._unknowns], [slope])(self._z)
        width = size * self.each
        return ca.reshape(gathered(table, first_entries(self._samples, width, width)), size, -1)

    def weighted(self, weights: Expression) -> Expression:
        """Weights (states, K) of the states as those of all samples' states, (states * samples,)."""
        states = self.states.shape[0]
        places = first_entries(self._samples, states, states)
        return scattered(ca.vec(weights), ca.vec(places), states * self._begins.shape[0])

    @property
    def each(self) -> int:
        """States and inputs."""
        return int(self.states.shape[0] + self.held.shape[0])

    def of(self, which: Sequence[int]) -> list[int]:
        """Columns of some of each one's states and inputs among those of all."""
        first = self.each * np.arange(self.states.shape[1])
        columns: list[int] = (first[:, None] + np.array(which, dtype=int)).ravel().tolist()
        return columns

    def pulled(self, gradients: Expression) -> Expression:
        """Derivatives (size, K) by z of rows, given those (each, K) by states and inputs."""
        size = self.slopes.shape[0]
        slope, gradient = ca.MX.sym("slope", size, self.each), ca.MX.sym("gradient", self.each)
        through = ca.Function("through", [slope, gradient], [slope @ gradient])
        return through.map(gradients.shape[1])(self.slopes, gradients)


@dataclass(frozen=True)
class Weighted:
    """What weighted rows weigh of what has begun.

    Attributes:
        begun: the samples' begins.
        states: weights of the states, (states, K).
        bent: which of each one's states and inputs enter anything but linearly.
        inner: second derivatives by those, (bent, bent K).
    """

    begun: Begun
    states: Expression
    bent: Sequence[int] = ()
    inner: Expression | None = None


def first_entries(blocks: Expression, width: int, rows: int) -> Expression:
    """Places (rows, K) of the first entries of blocks.

    Args:
        blocks: which of them, (1, K).
        width: entries of each.
        rows: how many.
    """
    entries = ca.repmat(ca.DM(np.arange(rows)[:, None]), 1, blocks.shape[1])
    return ca.repmat(width * blocks, rows, 1) + entries


def gathered(table: Expression, places: Expression) -> Expression:
    """The entries of a table at places in it, counted column by column, in the shape of these."""
    return ca.reshape(ca.MX(ca.densify(ca.vec(table)))[ca.vec(places)], *places.shape)


def scattered(entries: Expression, places: Expression, size: int) -> Expression:
    """A column (size,) with the sums of the entries that belong to each place.

    Args:
        entries: (n,).
        places: of each, (n,).
        size: of the column.
    """
    return _scatter(size, entries.shape[0])(entries, places)


@lru_cache(maxsize=64)
def _scatter(size: int, count: int) -> ca.Function:
    # As the derivative of picking entries, which CasADi knows.
    column, places, entries = (
        ca.MX.sym("column", size),
        ca.MX.sym("places", count),
        ca.MX.sym("entries", count),
    )
    total = ca.jtimes(column[places], column, entries, True)
    return ca.Function("scatter", [entries, places], [ca.densify(total)])
