"""The limits' rows of a drive in pieces: their bounds, their order, and which unknowns move which."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array, Bools, Places
from oed.kernel.dynamics.embedding import without_zeros
from oed.kernel.dynamics.expression import Expression
from oed.kernel.limit import Rows
from oed.optimize.terms.base import RowBounds, Terms, excess, said_once, small_drive
from oed.optimize.terms.cell import Cell
from oed.optimize.terms.layout import PieceLayout
from oed.optimize.terms.needs import Needs


@dataclass(frozen=True)
class Pool:
    """Rows in the order in which they come about: of inputs, of the runs' first instants, of pieces.

    Attributes:
        slope: of the rows of inputs, linear in z, (rows, size).
        constant: of the same.
        moved: which unknowns move which row, (all rows, size).
        of_first: how many rows each run's first instant has.
        of_piece: how many a piece has.
    """

    slope: Array
    constant: Array
    moved: Bools
    of_first: int
    of_piece: int


class PieceRows:
    """The rows of limits on splines and instants, as they are put together from a pool.

    Attributes:
        bounds: of every such limit's rows.
        linear: whether they are linear in z.
        states_moved: which unknowns move which of the rows behind them, of what else the cell is asked,
            (rows, size).
    """

    def __init__(self, terms: Terms, layout: PieceLayout, cell: Cell, needs: Needs) -> None:
        """Find the order.

        Args:
            terms: what z is.
            layout: the pieces.
            cell: a sample; limits on instants in their order, and what else is asked of it.
            needs: of the limits.
        """
        self._problem, self._layout, self._cell = terms.problem, layout, cell
        self._size, self._free = terms.size, terms.problem.design.start_is_free
        self._repeats = terms.embedding.repeats
        self._moved_starts: Bools = terms.start_slopes != 0
        self._pool = self._pooled(terms.unknowns, list(needs.tables.values()))
        self._sort(needs)

    @cached_property
    def first(self) -> Expression:
        """Rows of a run's first instant, of the start state `start_symbol` (none where starts are fixed)."""
        drive = small_drive(self._problem, ca.SX(1, len(self._problem.system.inputs)), self.start_symbol)
        begin = replace(drive, path=drive.path[0, :])
        both = zip(self._cell.limits, self._cell.asked, strict=True)
        rows = [limit.rows(begin) for limit, asked in both if asked.first and self._free]
        return ca.vertcat(ca.SX(0, 1), *(ca.densify(one.expression) for one in rows))

    @cached_property
    def start_symbol(self) -> Expression:
        """A start state (SX)."""
        return ca.SX.sym("start", len(self._problem.system.states))

    def _pooled(self, unknowns: Expression, tables: Sequence[Rows]) -> Pool:
        stacked = ca.densify(ca.vertcat(ca.SX(0, 1), *(rows.expression for rows in tables)))
        slope = ca.jacobian(stacked, unknowns)
        both = ca.Function("rows", [unknowns], [ca.densify(slope), stacked])
        steep, constant = map(np.array, both(np.zeros(self._size)))
        moved = np.array(ca.DM(slope.sparsity(), 1.0)) != 0
        of_first, of_piece = self.first.shape[0], self._layout.samples * self._of_sample
        parts = [moved.reshape(-1, self._size), *self._moved_by_samples(of_first)]
        return Pool(
            steep.reshape(-1, self._size), constant.ravel(), np.concatenate(parts), of_first, of_piece
        )

    @property
    def _of_sample(self) -> int:
        return sum(rows.expression.shape[0] for rows in self._cell.rows)

    def _moved_by_samples(self, of_first: int) -> tuple[Bools, Bools]:
        # Which unknowns move the first instants' rows, and all samples': passed on by the states.
        layout, states = self._layout, self._cell.states
        by_state, by_inputs = (np.array(ca.DM(part, 1.0)) != 0 for part in self._cell.depends)
        rows = np.zeros((layout.count, layout.samples, self._of_sample, self._size), dtype=bool)
        first = np.zeros((layout.space.runs, of_first, self._size), dtype=bool)
        acting = layout.basis != 0
        for piece in range(layout.count):
            run, place = divmod(piece, layout.each)
            if place == 0:
                moved = self._moved_starts[run]
                if of_first:
                    start = np.array(ca.DM(ca.jacobian_sparsity(self.first, self.start_symbol), 1.0)) != 0
                    first[run] = start @ moved
            for sample in range(layout.samples):
                found = by_state @ moved
                found[:, layout.places[piece]] |= by_inputs @ acting[place, sample]
                moved, rows[piece, sample] = found[:states], found[states:]
        return first.reshape(-1, self._size), rows.reshape(-1, self._size)

    def _sort(self, needs: Needs) -> None:
        self.bounds: list[RowBounds] = []
        self.linear: list[bool] = []
        self._sources: list[Places] = []
        for rows, places, linear in self._served(needs):
            kept = self._pool.moved[places].any(axis=1)
            if self._repeats and len(places) and places[-1] < len(self._pool.constant):
                kept &= said_once(self._pool.slope[places], self._pool.constant[places], rows)
            self._sources.append(places[kept])
            self.bounds.append(RowBounds(rows.lower[kept], rows.upper[kept], rows.size, rows.unit))
            self.linear.append(linear)
        more = [self._per_sample(index)[1] for index in range(len(needs.asked), len(self._cell.limits))]
        self._source = np.concatenate([np.zeros(0, dtype=np.int64), *self._sources, *more])
        count = sum(map(len, self._sources))
        self._cell_limits = [sorted([*needs.tables, *needs.asked]).index(limit) for limit in needs.asked]
        self.states_moved = self._pool.moved[self._source[count:]]

    def _served(self, needs: Needs) -> Iterator[tuple[Rows, Places, bool]]:
        # Of every limit: bounds of all its rows, their places in the pool, whether they are linear.
        found, of_cell = 0, iter(range(len(needs.asked)))
        for limit in sorted([*needs.tables, *needs.asked]):
            if limit in needs.tables:
                rows = needs.tables[limit]
                yield rows, np.arange(found, found + len(rows.lower)), True
                found += len(rows.lower)
            else:
                index = next(of_cell)
                yield *self._per_sample(index), self._cell.linear[index]

    def _per_sample(self, index: int) -> tuple[Rows, Places]:
        # Bounds of all rows of one of the cell's limits, and their places in the pool: one thing asked of all
        # samples after another.
        cell, layout, pool = self._cell, self._layout, self._pool
        rows, asked = cell.rows[index], cell.asked[index]
        things, points, runs = asked.things, asked.points, layout.space.runs
        before = len(pool.constant) + runs * pool.of_first
        own = sum(one.expression.shape[0] for one in cell.rows[:index]) + np.arange(things * points)
        samples = layout.space.samples * runs
        places = before + own[:, None] + self._of_sample * np.arange(samples)
        # Of every thing, the points of a sample one after the other.
        places = places.reshape(things, points, runs, -1).transpose(0, 2, 3, 1).reshape(things, runs, -1)
        if self._free and asked.first:
            own = sum(one.things for one in cell.asked[:index] if one.first) + np.arange(things)
            firsts = len(pool.constant) + own[:, None] + pool.of_first * np.arange(runs)
            places = np.concatenate([firsts[:, :, None], places], axis=2)
        lower, upper = (np.repeat(side[::points], places[0].size) for side in (rows.lower, rows.upper))
        return replace(rows, lower=lower, upper=upper), places.ravel()

    def values(self, z: Expression, first: Expression, rows: Expression) -> Expression:
        """All rows, from those of the first instants (first, runs) and of the pieces (rows, pieces).

        Args:
            z: the unknowns.
            first: rows of the first instants (first, runs).
            rows: of the pieces (rows, pieces).
        """
        return ca.vertcat(self._tables(z), ca.vec(first), ca.vec(rows))[self._source.tolist()]

    @property
    def _before(self) -> int:
        # Rows of the pool before those of samples.
        return len(self._pool.constant) + self._layout.space.runs * self._pool.of_first

    @cached_property
    def whole_samples(self) -> list[Places] | None:
        """Samples whose rows of each of the cell's limits count; None where of some of them only a part does.

        A sample's rows of one limit may then be looked at together, as `Cell.scored` does.
        """
        found = []
        for rows, limit in zip(self._cell.rows, self._cell_limits, strict=True):
            places = self._sources[limit]
            samples = (places[places >= self._before] - self._before) // self._of_sample
            kept, counts = np.unique(samples, return_counts=True)
            if (counts != rows.expression.shape[0]).any():
                return None
            found.append(kept)
        return found

    def excesses(self, z: Expression, first: Expression, each: Expression) -> list[Expression]:
        """Of every limit the most by which its rows are beyond their bounds.

        Args:
            z: the unknowns.
            first: rows of the first instants (first, runs).
            each: of the samples' rows of each of the cell's limits the same (limits, samples).
        """
        assert self.whole_samples is not None
        pool = ca.vertcat(self._tables(z), ca.vec(first))
        found = []
        for places, bounds in zip(self._sources, self.bounds, strict=True):
            alone = places < self._before
            sides = replace(bounds, lower=bounds.lower[alone], upper=bounds.upper[alone])
            found.append(excess(pool[places[alone].tolist()], sides))
        for index, (limit, samples) in enumerate(zip(self._cell_limits, self.whole_samples, strict=True)):
            found[limit] = ca.fmax(found[limit], ca.mmax(each[index, samples.tolist()]))
        return found

    def _tables(self, z: Expression) -> Expression:
        return without_zeros(self._pool.slope) @ z + ca.DM(self._pool.constant)

    def slopes(self, first: Expression, rows: Expression) -> Expression:
        """Derivatives of all rows (sparse), from those (size, rows * number) of instants and of pieces."""
        columns, chosen = np.nonzero(self._pool.moved[self._source].T)
        source = self._source[chosen]
        own = len(self._pool.constant)
        linear = source < own
        steep = self._pool.slope[source[linear], columns[linear]]
        dense = ca.vertcat(ca.vec(first), ca.vec(rows))
        where = np.where(linear, 0, (source - own) * self._size + columns)
        where[linear] = dense.shape[0] + np.arange(len(steep))
        starts = np.searchsorted(columns, np.arange(self._size + 1))
        pattern = ca.Sparsity(len(self._source), self._size, starts.tolist(), chosen.tolist())
        entries = ca.vertcat(dense, ca.MX(ca.DM(steep)))[where.tolist()]
        return ca.sparsity_cast(entries, pattern)

    def weights(self, weights: Expression) -> tuple[Expression, Expression]:
        """Weights of the first instants' rows (first, runs) and of the pieces' (rows, pieces)."""
        pool, runs = self._pool, self._layout.space.runs
        place = np.full(len(pool.moved), len(self._source))
        place[self._source] = np.arange(len(self._source))
        pooled = ca.vertcat(weights, ca.MX(1, 1))[place[len(pool.constant) :].tolist()]
        first, rest = ca.vertsplit(pooled, [0, runs * pool.of_first, pooled.shape[0]])
        return ca.reshape(first, pool.of_first, runs), ca.reshape(rest, pool.of_piece, self._layout.count)
