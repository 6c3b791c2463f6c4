"""Rows of readings and constraints on their weights, for an interior-point method."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from oed.foundation.arrays import Array, Places


@dataclass(frozen=True)
class WeightProgram:
    """Rows of readings and linear constraints, in units in which all first weights are 1.

    Attributes:
        rows: whitened rows of the readings, judged combinations first, (k, q).
        places: reading of each row, (k,).
        known_rows: rows of the prior information, (m, q).
        judged: number of the judged combinations.
        upper: largest weights, (n,); infinite where no bound is needed.
        equalities: rows whose product with the weights stays constant, (e, n).
        inequalities: rows whose product with the weights stays below a limit, (i, n).
        most: these limits, (i,).
    """

    rows: Array
    places: Places
    known_rows: Array
    judged: int
    upper: Array
    equalities: Array
    inequalities: Array
    most: Array

    @cached_property
    def _sums(self) -> Any:
        # Matrix (n, k) that sums the rows of each reading; None where each reading has one row.
        count = len(self.places)
        if np.array_equal(self.places, np.arange(len(self.upper))):
            return None
        from scipy.sparse import csr_array

        entries = np.ones(count), (self.places, np.arange(count))
        return csr_array(entries, shape=(len(self.upper), count))

    def by_reading(self, values: Array) -> Array:
        """Return sums over the rows of each reading, (n, ...), of values (k, ...)."""
        return values if self._sums is None else np.asarray(self._sums @ values)

    @cached_property
    def _bounded(self) -> Places:
        return np.flatnonzero(np.isfinite(self.upper))

    def distances(self, weights: Array) -> Array:
        """Return the distances (d,) from all bounds and inequalities.

        These are the weights, their differences to the finite largest weights, and the slacks of the
        inequalities.
        """
        above = self.upper[self._bounded] - weights[self._bounded]
        return np.concatenate([weights, above, self.most - self.inequalities @ weights])

    def moves(self, change: Array) -> Array:
        """Return the changes (d,) of the distances with a change (n,) of the weights."""
        return np.concatenate([change, -change[self._bounded], -self.inequalities @ change])

    def weighted_slope(self, prices: Array) -> Array:
        """Return the derivatives by the weights, (n,), of the distances' sum weighted by prices (d,)."""
        low, high, rest = self._apart(prices)
        derivatives = low.copy()
        derivatives[self._bounded] -= high
        return derivatives - rest @ self.inequalities

    def weighted_curvature(self, stiffness: Array) -> tuple[Array, Array]:
        """Return the second derivatives by the weights of the distances' squares, weighted by stiffness (d,).

        They are a diagonal (n,), and the square of columns (n, i).
        """
        low, high, rest = self._apart(stiffness)
        diagonal = low.copy()
        diagonal[self._bounded] += high
        return diagonal, self.inequalities.T * np.sqrt(rest)

    def _apart(self, values: Array) -> tuple[Array, Array, Array]:
        count = len(self.upper)
        limited = count + len(self._bounded)
        return values[:count], values[count:limited], values[limited:]

    def project(self, weights: Array) -> Projection:
        """Return the judged information at weights (n,), with the projected rows of the readings."""
        rows = np.vstack([self.rows, self.known_rows])
        counts = np.concatenate([weights[self.places], np.ones(len(self.known_rows))])
        judged, eliminated = rows[:, : self.judged], rows[:, self.judged :]
        if eliminated.shape[1]:
            factor = np.linalg.cholesky(eliminated.T @ (counts[:, None] * eliminated))
            eliminated = np.linalg.solve(factor, eliminated.T).T
            judged = judged - eliminated @ (eliminated.T @ (counts[:, None] * judged))
        count = len(self.rows)
        return Projection(judged.T @ (counts[:, None] * judged), judged[:count], eliminated[:count])


@dataclass(frozen=True)
class Projection:
    """Information on the judged parameters at some weights.

    Attributes:
        information: S, (p, p).
        judged: rows of the readings on the judged parameters, all other unknowns eliminated, (k, p).
        eliminated: whitened rows of the readings on the eliminated unknowns, (k, q - p).
    """

    information: Array
    judged: Array
    eliminated: Array

    def whitened(self, root: Array) -> Array:
        """Return the rows (k, q) on all unknowns, with the judged ones in units of a root (p, p)."""
        return np.hstack([self.judged @ root.T, self.eliminated])
