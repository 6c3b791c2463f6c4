"""The rows of a program by their entries: linear ones, those of whole runs, and slots for instants."""

from __future__ import annotations

import numpy as np

from oed.foundation.arrays import Array, Places
from oed.optimize.terms.chosen import ChosenRows
from oed.optimize.terms.fixed_rows import FixedRows
from oed.optimize.terms.point import CondensedParts, DriveAt


class RowEntries:
    """The rows of a program: those that it always has, limit by limit, and slots behind them.

    Attributes:
        count: number of rows.
        row: row of each entry of their derivatives by z that may differ from 0, (n,).
        column: unknown of each of these entries, (n,).
    """

    def __init__(self, fixed: FixedRows, parts: CondensedParts, slots: int) -> None:
        """Lay them out.

        Args:
            fixed: rows that a program always has.
            parts: parts of an evaluation.
            slots: number of slots for rows of instants.
        """
        self._on_runs, self._linear = parts.limits, len(fixed.constant)
        count = self._linear + (0 if parts.limits is None else len(parts.limits.moved))
        # Which of all rows, in the order in which they are computed.
        self._order = np.append(np.array(fixed.order, dtype=int), count + np.arange(slots))
        self.count = len(self._order)
        computed = np.zeros((count + slots, parts.size), dtype=bool)
        computed[: self._linear] = fixed.slope != 0
        if parts.limits is not None:
            row, column = (np.array(part, dtype=int) for part in parts.limits.pattern.get_triplet())
            computed[self._linear + row, column] = True
        computed[count:] = True
        self.row, self.column = (np.asarray(part) for part in np.nonzero(computed[self._order]))
        self._source: Places = self._order[self.row]
        self._entries = np.zeros(len(self.row))
        is_linear = self._source < self._linear
        self._entries[is_linear] = fixed.slope[self._source[is_linear], self.column[is_linear]]
        self._moving = np.flatnonzero(~is_linear)

    def values(self, point: DriveAt, chosen: ChosenRows | None) -> Array:
        """Return the rows, of chosen instants in the slots."""
        rows = [point.drive.linear[0]]
        if self._on_runs is not None:
            rows.append(point.run_rows)
        if chosen is not None:
            rows.append(point.instants(chosen).values)
        return np.asarray(np.concatenate(rows)[self._order])

    def slopes(self, point: DriveAt, chosen: ChosenRows | None) -> Array:
        """Return the entries (n,) of their derivatives."""
        entries, places = self._entries.copy(), self._moving
        if not len(places):
            return entries
        rows = [np.zeros((0, point.z.size))]
        if self._on_runs is not None:
            rows.append(point.run_row_slopes)
        if chosen is not None:
            rows.append(point.instants(chosen).slopes)
        entries[places] = np.concatenate(rows)[self._source[places] - self._linear, self.column[places]]
        return entries

    def curvature(self, point: DriveAt, entries: Array, rows: Array, chosen: ChosenRows | None) -> Array:
        """Return second derivatives (size, size) by z of weighted entries of the information and rows.

        Args:
            point: evaluation of the drive.
            entries: weights of the entries, (e,).
            rows: weights of the rows, (count,).
            chosen: rows of instants in the slots.
        """
        every = np.zeros(self.count)
        every[self._order] = rows
        slots = 0 if chosen is None else len(chosen)
        _, on_runs, on_instants = np.split(every, [self._linear, self.count - slots])
        return point.curvature(entries, on_runs, on_instants, chosen)
