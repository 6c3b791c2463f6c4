"""The rows of a program by their entries: linear ones, those of whole runs, and slots for instants."""

from __future__ import annotations

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.optimize.terms.fixed_rows import FixedRows
from oed.optimize.terms.point import ChosenRows, CondensedParts, DriveAt


class RowEntries:
    """The rows of a program as entries: linear ones, those of whole runs, and slots behind them.

    Attributes:
        count: number of rows.
        pattern: places of their derivatives by z.
    """

    def __init__(self, fixed: FixedRows, parts: CondensedParts, slots: int) -> None:
        """Lay them out, with so many slots."""
        self._fixed, self._on_runs = fixed, parts.limits
        self._linear, self._order = len(fixed.constant), np.array(fixed.order, dtype=int)
        self.count, size = len(self._order) + slots, parts.size
        linear = ca.sparsify(ca.DM(fixed.slope)) if self._linear else ca.DM(0, size)
        patterns = [ca.DM(linear.sparsity(), 1.0)]
        if parts.limits is not None:
            patterns.append(ca.DM(parts.limits.pattern, 1.0))
        all_rows = ca.vertcat(*patterns)[fixed.order, :] if self._order.size else ca.DM(0, size)
        pattern = ca.vertcat(all_rows, ca.DM.ones(slots, size))
        self.pattern: ca.Sparsity = pattern.sparsity()
        row, self._column = (np.array(part, dtype=int) for part in self.pattern.get_triplet())
        # Which of all rows, in the order in which they are computed.
        source = np.append(self._order, self._linear + self._count_on_runs + np.arange(slots))
        self._row = source[row] if len(row) else row
        self._fixed_entries = np.zeros(len(self._row))
        constant = self._row < self._linear
        self._fixed_entries[constant] = fixed.slope[self._row[constant], self._column[constant]]
        self._moving = np.flatnonzero(~constant)

    @property
    def _count_on_runs(self) -> int:
        return 0 if self._on_runs is None else len(self._on_runs.moved)

    def values(self, point: DriveAt, chosen: ChosenRows | None) -> Array:
        """Return the rows."""
        rows = [point.drive.linear[0]]
        if self._on_runs is not None:
            rows.append(point.run_rows)
        values = np.concatenate(rows)[self._order]
        return values if chosen is None else np.concatenate([values, point.instants(chosen).values])

    def slopes(self, point: DriveAt, chosen: ChosenRows | None) -> Array:
        """Return the entries of their derivatives, in the order of the pattern."""
        entries = self._fixed_entries.copy()
        if not len(self._moving):
            return entries
        rows = [np.zeros((0, point.z.size))]
        if self._on_runs is not None:
            rows.append(point.run_row_slopes)
        if chosen is not None:
            rows.append(point.instants(chosen).slopes)
        table = np.concatenate(rows)
        entries[self._moving] = table[self._row[self._moving] - self._linear, self._column[self._moving]]
        return entries

    def weights(self, weights: Array) -> tuple[Array, Array]:
        """Return the weights of the rows of whole runs, and of the slots, among weights of all rows."""
        every = np.zeros(self._linear + self._count_on_runs)
        every[self._order] = weights[: len(self._order)]
        return every[self._linear :], weights[len(self._order) :]
