"""Limits as a program states them: bounds of single unknowns, and weighted rows."""

from __future__ import annotations

import numpy as np

from oed.foundation.arrays import Array, Bools
from oed.optimize.terms.chosen import ChosenRows
from oed.optimize.terms.instants import LINEAR_WEIGHT
from oed.optimize.terms.point import DriveAt
from oed.optimize.terms.terms import Terms

Interval = tuple[Array, Array]

NARROWED = 0.9
"""Share of the way between two bounds that tightening may take away at most."""
SLIGHT = 1e-4
"""Share of its size by which a limit is made wider to see what that moves."""


class Frame:
    """Limits as a program states them: single unknowns have bounds, all other limits are weighted rows.

    Bounds of single unknowns that contradict each other stay rows, because Ipopt reports these as infeasible.
    A relaxing frame keeps every row, twice: lowered, and raised, by the relaxation of its limit. The rows of
    the slots follow the permanent rows.

    Attributes:
        row: row of each entry of their derivatives by z that may differ from 0, (n,).
        column: unknown of each of these entries, (n,).

    Args:
        terms: terms whose limits are framed.
        relaxing: True where the auxiliary unknowns relax the limits.
        slots: number of slots for rows of instants.
    """

    def __init__(self, terms: Terms, *, relaxing: bool, slots: int = 0) -> None:
        """Sort the rows into bounds of single unknowns and all others."""
        self.size, self.relaxing, self._unknown_bounds = terms.size, relaxing, terms.own_bounds
        self._slots, self._instants, self._entries = slots, terms.instants, terms.entries_of_rows(slots)
        self._sizes = np.array([rows.size for rows in terms.rows])
        counts = np.array([len(rows.lower) for rows in terms.rows], dtype=int)
        self._owner = np.repeat(np.arange(len(terms.rows)), counts)
        self._lower = np.concatenate([np.zeros(0), *(rows.lower for rows in terms.rows)])
        self._upper = np.concatenate([np.zeros(0), *(rows.upper for rows in terms.rows)])
        self._simple, self._unknown, self._slope, self._constant = terms.bounded_unknowns
        least, most = self._ranges(self._lower, self._upper)
        consistent = (least <= most)[self._unknown] & (not relaxing)
        self._simple, self._unknown = self._simple[consistent], self._unknown[consistent]
        self._slope, self._constant = self._slope[consistent], self._constant[consistent]
        self._rest = np.delete(np.arange(len(self._owner)), self._simple)
        weights = (
            np.where(np.array(terms.linear, dtype=bool) & (not relaxing), LINEAR_WEIGHT, 1.0) / self._sizes
        )
        self._weights = weights[self._owner[self._rest]]
        self._picked = np.append(self._rest, len(self._owner) + np.arange(slots))
        self._every_weight = np.append(self._weights, np.ones(slots))
        place = np.full(self._entries.count, -1)
        place[self._picked] = np.arange(len(self._picked))
        self._is_picked = place[self._entries.row] >= 0
        self.row = place[self._entries.row[self._is_picked]]
        self.column = self._entries.column[self._is_picked]

    @property
    def count(self) -> int:
        """Number of the program's rows, without those that a relaxing frame repeats."""
        return len(self._every_weight)

    def values(self, point: DriveAt, chosen: ChosenRows | None) -> Array:
        """Return the rows at an evaluation of the terms, of chosen instants in the slots."""
        return np.asarray(self._every_weight * self._entries.values(point, chosen)[self._picked])

    def slopes(self, point: DriveAt, chosen: ChosenRows | None) -> Array:
        """Return the entries of the derivatives of the rows by z."""
        entries = self._entries.slopes(point, chosen)[self._is_picked]
        return np.asarray(self._every_weight[self.row] * entries)

    def curvature(
        self, point: DriveAt, entries: Array, multipliers: Array, chosen: ChosenRows | None
    ) -> Array:
        """Return second derivatives (size, size) by z of weighted entries of the information and rows.

        Args:
            point: evaluation of the terms.
            entries: weights of the entries, (e,).
            multipliers: weights of the rows.
            chosen: rows of instants in the slots.
        """
        weights = np.zeros(self._entries.count)
        weights[self._picked] = self._every_weight * multipliers
        return self._entries.curvature(point, entries, weights, chosen)

    def relaxations(self, chosen: ChosenRows | None) -> Array:
        """Return the matrix (rows, limits) that assigns each row to its limit."""
        table = np.zeros((self.count, len(self._sizes)))
        table[np.arange(len(self._rest)), self._owner[self._rest]] = 1.0
        if chosen is not None:
            slots = len(self._rest) + np.arange(len(chosen))
            table[slots, self._instants.owner[chosen.row]] = self._instants.weight[chosen.row]
        return table

    @property
    def relaxed(self) -> Bools:
        """True where that matrix may differ from 0, whatever is chosen."""
        return np.concatenate(
            [
                self.relaxations(None)[: len(self._rest)] != 0,
                np.ones((self._slots, len(self._sizes)), dtype=bool),
            ]
        )

    def bounds(self, backoff: Array, chosen: ChosenRows | None = None) -> tuple[Interval, Interval]:
        """Return the bounds of z and of the rows where each limit is tightened by a share of its size.

        Args:
            backoff: shares of the limits' sizes, (limits,); 0 for limits on instants.
            chosen: rows of instants.
        """
        shift = (backoff * self._sizes)[self._owner]
        # Tightening never closes the gap between two bounds: a robot may all but fill its workspace.
        shift = np.minimum(shift, NARROWED * (self._upper - self._lower) / 2)
        lower, upper = self._lower + shift, self._upper - shift
        low, high = self._unknowns_within(lower, upper)
        least, most = lower[self._rest] * self._weights, upper[self._rest] * self._weights
        if chosen is not None:
            least, most = np.concatenate([least, chosen.lower]), np.concatenate([most, chosen.upper])
        if self.relaxing:
            unbounded = np.full(len(least), np.inf)
            least, most = np.concatenate([-unbounded, least]), np.concatenate([most, unbounded])
        return (low, high), (least, most)

    def gains(self, backoff: Array, multipliers: Array, chosen: ChosenRows | None = None) -> Array:
        """Return the first-order gains (limits,) of the maximum if each limit alone is widened.

        They are per share of the limit's size.

        Args:
            backoff: share of its size by which each limit was tightened.
            multipliers: Lagrange multipliers of the bounds of z and of the rows, positive at upper bounds.
            chosen: rows of instants.
        """
        gains, rest = np.zeros(len(self._sizes)), multipliers
        if chosen is not None:
            rest, slots = np.split(multipliers, [len(multipliers) - len(chosen)])
            weights = self._instants.weight[chosen.row]
            np.add.at(gains, self._instants.owner[chosen.row], np.abs(slots) * weights)
        steps = SLIGHT * np.eye(len(self._sizes))
        now = self._ends(backoff, rest)
        slopes = [rest @ (self._ends(backoff - step, rest) - now) for step in steps]
        return gains + np.array(slopes) / SLIGHT

    def _ends(self, backoff: Array, multipliers: Array) -> Array:
        # The bound of z and of every row on the side that its multiplier holds; 0 where there is none.
        (low, high), (row_low, row_high) = self.bounds(backoff)
        lower, upper = np.concatenate([low, row_low]), np.concatenate([high, row_high])
        ends = np.where(multipliers > 0, upper, lower)
        return np.where(np.isfinite(ends), ends, 0.0)

    def _unknowns_within(self, lower: Array, upper: Array) -> Interval:
        # Bounds that tightened rows of single unknowns leave to these unknowns.
        low, high = self._ranges(lower, upper)
        least, most = self._ranges(self._lower, self._upper)
        # Several limits on the same unknown together leave the same share of the gap.
        spare = np.zeros(self.size)
        bounded = np.isfinite(most - least)
        spare[bounded] = (1 - NARROWED) * (most - least)[bounded] / 2
        return np.minimum(low, most - spare), np.maximum(high, least + spare)

    def _ranges(self, lower: Array, upper: Array) -> Interval:
        # Interval of every unknown within which all rows of that unknown alone lie between these bounds.
        low, high = self._unknown_bounds.T.copy()
        ends = np.array([lower[self._simple], upper[self._simple]])
        ends = np.sort((ends - self._constant) / self._slope, axis=0)
        np.maximum.at(low, self._unknown, ends[0])
        np.minimum.at(high, self._unknown, ends[1])
        return low, high
