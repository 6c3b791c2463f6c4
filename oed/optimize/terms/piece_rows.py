"""The limits' rows of a drive in pieces: their bounds, their order, and which unknowns move which."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np
import numpy.typing as npt

from oed.kernel.dynamics.expression import Expression
from oed.kernel.limit import InputLimit, Limit, PathLimit, Rows
from oed.kernel.problem import Problem
from oed.optimize.terms.base import RowBounds
from oed.optimize.terms.cell import Cell, small_drive
from oed.optimize.terms.layout import Layout

Array = npt.NDArray[np.float64]
Places = npt.NDArray[np.int64]
Moved = npt.NDArray[np.bool_]


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
    moved: Moved
    of_first: int
    of_piece: int


class PieceRows:
    """Every limit's rows, as they are put together from a pool."""

    def __init__(
        self, problem: Problem, layout: Layout, cell: Cell, unknowns: Expression, coefficients: Expression
    ) -> None:
        """Find the order.

        Args:
            problem: whose limits.
            layout: the pieces.
            cell: a sample.
            unknowns: z (SX).
            coefficients: of all splines, in terms of it.
        """
        self._problem, self._layout, self._cell = problem, layout, cell
        self._size, self._free = unknowns.shape[0], problem.design.start_is_free
        inputs = [limit for limit in problem.limits if isinstance(limit, InputLimit)]
        tables = self._tables(unknowns, coefficients, inputs)
        self._pool = self._pooled(unknowns, tables)
        self._sort(inputs, tables)

    def _tables(self, unknowns: Expression, coefficients: Expression, limits: Sequence[Limit]) -> list[Rows]:
        space, inputs = self._problem.design, len(self._problem.robot.inputs)
        start = ca.SX.sym("start", len(self._problem.robot.states))
        drive = small_drive(self._problem, ca.SX.sym("held", 1, inputs), start)
        drive = replace(
            drive,
            input_values=coefficients,
            input_rates=ca.sparsify(ca.DM(space.rate_matrix)) @ coefficients,
            input_jerks=ca.sparsify(ca.DM(space.jerk_matrix)) @ coefficients,
        )
        return [limit.rows(drive) for limit in limits]

    @cached_property
    def first(self) -> Expression:
        """Rows of a run's first instant, of the start state `start_symbol` (none where starts are fixed)."""
        drive = small_drive(self._problem, ca.SX(1, len(self._problem.robot.inputs)), self.start_symbol)
        begin = replace(drive, path=drive.path[0, :])
        limits = [limit for limit in self._cell.limits if isinstance(limit, PathLimit)] if self._free else []
        return ca.vertcat(ca.SX(0, 1), *(ca.densify(limit.rows(begin).expression) for limit in limits))

    @cached_property
    def start_symbol(self) -> Expression:
        """A start state (SX)."""
        return ca.SX.sym("start", len(self._problem.robot.states))

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

    def _moved_by_samples(self, of_first: int) -> tuple[Moved, Moved]:
        # Which unknowns move the first instants' rows, and all samples': passed on by the states.
        layout, states = self._layout, self._cell.states
        by_state, by_inputs = (np.array(ca.DM(part, 1.0)) != 0 for part in self._cell.depends)
        rows = np.zeros((layout.count, layout.samples, self._of_sample, self._size), dtype=bool)
        first = np.zeros((layout.space.runs, of_first, self._size), dtype=bool)
        acting = layout.basis != 0
        for piece in range(layout.count):
            run, place = divmod(piece, layout.each)
            if place == 0:
                moved = self._moved_starts(run)
                if of_first:
                    start = np.array(ca.DM(ca.jacobian_sparsity(self.first, self.start_symbol), 1.0)) != 0
                    first[run] = start @ moved
            for sample in range(layout.samples):
                found = by_state @ moved
                own = by_inputs[:, :, None] & acting[place, sample]
                found[:, layout.places[piece]] |= own.reshape(len(found), -1)
                moved, rows[piece, sample] = found[:states], found[states:]
        return first.reshape(-1, self._size), rows.reshape(-1, self._size)

    def _moved_starts(self, run: int) -> Moved:
        moved = np.zeros((self._cell.states, self._size), dtype=bool)
        if self._free:
            first = self._size - 3 * (self._layout.space.runs - run)
            moved[[0, 1, 2], [first, first + 1, first + 2]] = True
        return moved

    def _sort(self, inputs: Sequence[Limit], tables: Sequence[Rows]) -> None:
        self.bounds: list[RowBounds] = []
        self.linear: list[bool] = []
        source: list[Places] = []
        known, found = dict(zip(map(id, inputs), tables, strict=True)), 0
        for limit in self._problem.limits:
            if id(limit) in known:
                rows = known[id(limit)]
                places = np.arange(found, found + len(rows.lower))
                found += len(places)
            else:
                rows, places = self._per_sample(limit)
            kept = self._pool.moved[places].any(axis=1)
            source.append(places[kept])
            self.bounds.append(RowBounds(rows.lower[kept], rows.upper[kept], rows.size, rows.unit))
            self.linear.append(id(limit) in known or self._cell.linear[self._index(limit)])
        self._source = np.concatenate([np.zeros(0, dtype=np.int64), *source])

    def _per_sample(self, limit: Limit) -> tuple[Rows, Places]:
        # Bounds of all its rows, and their places in the pool: one thing asked of all samples after another.
        cell, layout, pool = self._cell, self._layout, self._pool
        index, rows = self._index(limit), self._cell.rows[self._index(limit)]
        points, runs = cell.points(limit), layout.space.runs
        things = rows.expression.shape[0] // points
        before = len(pool.constant) + runs * pool.of_first
        own = sum(one.expression.shape[0] for one in cell.rows[:index]) + np.arange(things * points)
        samples = layout.space.samples * runs
        places = before + own[:, None] + self._of_sample * np.arange(samples)
        # Of every thing, the points of a sample one after the other.
        places = places.reshape(things, points, runs, -1).transpose(0, 2, 3, 1).reshape(things, runs, -1)
        if self._free and isinstance(limit, PathLimit):
            own = self._first_of(index) + np.arange(things)
            firsts = len(pool.constant) + own[:, None] + pool.of_first * np.arange(runs)
            places = np.concatenate([firsts[:, :, None], places], axis=2)
        lower, upper = (np.repeat(side[::points], places[0].size) for side in (rows.lower, rows.upper))
        return replace(rows, lower=lower, upper=upper), places.ravel()

    def _index(self, limit: Limit) -> int:
        return next(place for place, one in enumerate(self._cell.limits) if one is limit)

    def _first_of(self, index: int) -> int:
        # Where a limit on the path begins among the rows of a first instant.
        before = zip(self._cell.limits[:index], self._cell.rows, strict=False)
        return sum(
            rows.expression.shape[0] // self._cell.points(limit)
            for limit, rows in before
            if isinstance(limit, PathLimit)
        )

    def values(self, z: Expression, first: Expression, rows: Expression) -> Expression:
        """All rows, from those of the first instants (first, runs) and of the pieces (rows, pieces)."""
        own = ca.DM(self._pool.slope) @ z + ca.DM(self._pool.constant)
        return ca.vertcat(own, ca.vec(first), ca.vec(rows))[self._source.tolist()]

    def slopes(self, first: Expression, rows: Expression) -> Expression:
        """Their derivatives (sparse), from those (size, rows * number) of first instants and of pieces."""
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
