"""The rows of a program by their entries: linear ones, those of whole runs, and slots for instants."""

from __future__ import annotations

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.optimize.condensed.point import ChosenRows, Parts, Point
from oed.optimize.terms.fixed_rows import FixedRows


class RowEntries:
    """The rows of a program as entries: linear ones, those of whole runs, and slots behind them.

    Attributes:
        count: number of rows.
        pattern: places of their derivatives by z.
    """

    def __init__(self, fixed: FixedRows, parts: Parts, slots: int) -> None:
        """Lay them out, with so many slots."""
        self._fixed, self._whole, self._slots = fixed, parts.whole, slots
        self._linear, self._order = len(fixed.constant), np.array(fixed.order, dtype=int)
        self.count, size = len(self._order) + slots, parts.size
        linear = ca.sparsify(ca.DM(fixed.slope)) if self._linear else ca.DM(0, size)
        each = [ca.DM(linear.sparsity(), 1.0)]
        if parts.whole is not None:
            each.append(ca.DM(parts.whole.pattern, 1.0))
        all_rows = ca.vertcat(*each)[fixed.order, :] if self._order.size else ca.DM(0, size)
        whole = ca.vertcat(all_rows, ca.DM.ones(slots, size))
        self.pattern: ca.Sparsity = whole.sparsity()
        row, self._column = (np.array(part, dtype=int) for part in self.pattern.get_triplet())
        # Which of all rows, in the order in which they are computed.
        source = np.append(self._order, self._linear + self._count_whole + np.arange(slots))
        self._row = source[row] if len(row) else row
        self._fixed_entries = np.zeros(len(self._row))
        known = self._row < self._linear
        self._fixed_entries[known] = fixed.slope[self._row[known], self._column[known]]
        self._moving = np.flatnonzero(~known)

    @property
    def _count_whole(self) -> int:
        return 0 if self._whole is None else len(self._whole.kept)

    def values(self, point: Point, chosen: ChosenRows | None) -> Array:
        """Return the rows."""
        rows = [point.drive.linear[0]]
        if self._whole is not None:
            rows.append(point.whole_rows)
        found = np.concatenate(rows)[self._order]
        return found if chosen is None else np.concatenate([found, point.instants(chosen)])

    def slopes(self, point: Point, chosen: ChosenRows | None) -> Array:
        """Return the entries of their derivatives, in the order of the pattern."""
        found = self._fixed_entries.copy()
        if not len(self._moving):
            return found
        rows = [np.zeros((0, point.z.size))]
        if self._whole is not None:
            rows.append(point.whole_row_slopes)
        if chosen is not None:
            rows.append(point.instant_slopes(chosen))
        table = np.concatenate(rows)
        found[self._moving] = table[self._row[self._moving] - self._linear, self._column[self._moving]]
        return found

    def weights(self, weights: Array) -> tuple[Array, Array]:
        """Return those of the rows of whole runs, and of slots, among weights of all rows."""
        every = np.zeros(self._linear + self._count_whole)
        every[self._order] = weights[: len(self._order)]
        return every[self._linear :], weights[len(self._order) :]
