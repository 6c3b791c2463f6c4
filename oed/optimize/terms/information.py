"""Information matrices of what samples gather: sums within groups, squares of segments, entries."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array, Places
from oed.kernel.dynamics.expression import Expression
from oed.kernel.measurement.measurement import start_nuisances
from oed.kernel.measurement.readings import labelled_nuisances
from oed.kernel.problem import Problem
from oed.optimize.terms.differentiated import Differentiated
from oed.optimize.terms.matrices import symmetric, upper_halves
from oed.optimize.terms.sample_cell import cuts_of, estimated
from oed.optimize.terms.small_drives import small_drive

Reader = Callable[[Sequence[int]], Expression]


class Information:
    """The judged entries as a function of what the samples of all runs add.

    Samples add up within a group: a segment's rows of a regression, squared first, or a run's information.
    All groups' sums make up the matrices: together, or run by run where runs have start states of their own.

    Attributes:
        groups: groups of a run.
        sizes: sizes of the judged matrices.
    """

    def __init__(self, problem: Problem, added: int) -> None:
        """Write the matrices.

        Args:
            problem: whose matrices they are.
            added: number of entries that a sample adds.
        """
        self._problem, self._added = problem, added
        self._sensors, self._cuts = problem.sensors, cuts_of(problem)
        squared = self._cuts.segment > 1
        self.groups = problem.design.samples // self._cuts.segment if squared else 1
        self._square = self._squares() if squared else None
        size = added if self._square is None else self._square.count
        self._by_run = bool(self._sensors)
        sums = ca.SX.sym("sums", size * (problem.design.runs if self._by_run else 1))
        matrices = self._judged(sums)
        self.sizes = [matrix.shape[0] for matrix in matrices]
        self._finish = Differentiated(sums, ca.cse(upper_halves(matrices)))

    @cached_property
    def _blocks(self) -> dict[str, tuple[int, int]]:
        # Of a regression: rows of a segment and columns of every block, judged or not.
        robot, regression = self._problem.system, self._cuts.regression
        assert regression is not None
        held, start = ca.SX(1, len(robot.inputs)), ca.SX(len(robot.states), 1)
        blocks = regression.blocks(small_drive(self._problem, held, start))
        return {block.name: tuple(block.jacobian.shape) for block in blocks}

    def _squares(self) -> Differentiated:
        # A segment's rows of all blocks -> upper halves of their squares.
        rows = ca.SX.sym("rows", self._added)
        squares, first = [], 0
        for height, columns in self._blocks.values():
            part = ca.reshape(rows[first : first + height * columns], height, columns)
            squares.append(part.T @ part)
            first += height * columns
        return Differentiated(rows, upper_halves(squares))

    def _judged(self, sums: Expression) -> list[Expression]:
        readers = self._joint(sums) if self._sensors else self._regressions(sums)
        return [
            estimation.matrix_of(reader)
            for estimation, reader in zip(self._problem.any_estimations, readers, strict=True)
        ]

    def _regressions(self, sums: Expression) -> list[Reader]:
        readers, first = dict[str, Reader](), 0
        for name, (_, columns) in self._blocks.items():
            count = columns * (columns + 1) // 2
            matrix = symmetric(sums[first : first + count], columns)
            readers[name] = _reader(matrix, dict(enumerate(range(columns))))
            first += count
        return [readers[estimation.block.name] for estimation in self._problem.any_estimations]

    def _joint(self, sums: Expression) -> list[Reader]:
        # Parameters and nuisances are common to all runs; a start is a run's, or known and no unknown at all.
        problem, runs, system = self._problem, self._problem.design.runs, self._problem.system
        starts, places = start_nuisances(self._sensors, system, runs), estimated(problem)
        nuisances = (*starts, *labelled_nuisances(self._sensors))
        count, started, states = len(places), len(starts) // runs, len(system.states)
        constants = len(nuisances) - len(starts)
        total = ca.SX.zeros(count + len(nuisances), count + len(nuisances))
        for run, part in enumerate(ca.vertsplit(sums, sums.shape[0] // runs)):
            begin, last = count + run * started, count + len(starts)
            columns = [*range(count), *range(begin, begin + started), *range(last, last + constants)]
            first = count + states
            rows = [*range(count + started), *range(first, first + constants)]
            total[columns, columns] += symmetric(part, first + constants)[rows, rows]
        precisions = [0.0] * count + [(entry.deviation or np.inf) ** -2 for entry in nuisances]
        total = total + ca.diag(ca.DM(precisions))
        # A constant that is estimated stands among the parameters, and is a nuisance here like all others.
        (estimation,) = problem.any_estimations
        block, labels = estimation.block, [entry.name for entry in nuisances]
        wanted = [problem.constants[name].name for name in block.parameters[len(system.parameters) :]]
        later = [*wanted, *(entry.name for entry in block.nuisances)]
        index = dict(zip(places, range(count), strict=True))
        index |= {
            len(system.parameters) + place: count + labels.index(label) for place, label in enumerate(later)
        }
        return [_reader(total, index)]

    def grouped(self, added: Array, ends: Array | None) -> Array:
        """Return the sums (K, R, groups, added) of what samples (K, R, N, added) and runs' ends add."""
        *first, samples, count = added.shape
        parts = _total(added.reshape(*first, self.groups, samples // self.groups, count), -2)
        return np.asarray(parts if ends is None else parts + ends[..., None, :])

    def sums(self, groups: Array) -> Array:
        """Return the sums (K, n) that the matrices are made of."""
        count, runs = groups.shape[:2]
        if self._square is not None:
            squares = self._square.values(groups.reshape(-1, self._added))
            groups = squares.reshape(count, runs, self.groups, -1)
        if self._by_run:
            return groups.reshape(count, -1)
        return _total(_total(groups, 2), 1)

    def entries(self, sums: Array) -> Array:
        """Return the judged entries (K, e)."""
        return self._finish.values(sums)

    def sum_slopes(self, groups: Array, slopes: Array, places: Places, size: int) -> Array:
        """Return derivatives (n, size) of the sums by all unknowns.

        Args:
            groups: sums of the groups, (R, groups, added).
            slopes: their derivatives by the runs' unknowns, (R, groups, added, w).
            places: of the runs' unknowns among all, (R, w).
            size: number of all unknowns.
        """
        if self._square is not None:
            steep = self._square.slopes(groups.reshape(-1, self._added))
            slopes = np.matmul(steep.reshape(*groups.shape[:2], *steep.shape[1:]), slopes)
        parts = slopes.sum(axis=1)
        runs, count = parts.shape[:2]
        if self._by_run:
            total = np.zeros((runs, count, size))
            for run in range(runs):
                total[run][:, places[run]] = parts[run]
            return total.reshape(runs * count, size)
        total = np.zeros((count, size))
        for run in range(runs):
            total[:, places[run]] += parts[run]
        return total

    def entry_slopes(self, sums: Array) -> Array:
        """Return derivatives (e, n) of the entries by the sums (n,)."""
        return np.asarray(self._finish.slopes(sums[None])[0])

    def weighted(self, sums: Array, weights: Array) -> tuple[Array, Array | None]:
        """Return weights (n,) of the sums, and second derivatives (n, n), if any, of weighted entries.

        Args:
            sums: what the matrices are made of, (n,).
            weights: of the entries, (e,).
        """
        (slopes,) = self._finish.slopes(sums[None])
        bent = None if self._finish.is_linear else self._finish.curvature(sums[None], weights[None])[0]
        return weights @ slopes, bent

    def group_weights(self, groups: Array, weights: Array) -> tuple[Array, Array | None]:
        """Return weights (R, groups, added) of the groups' sums, and second derivatives by these, if any.

        Args:
            groups: sums of the groups, (R, groups, added).
            weights: of the sums, (n,).
        """
        runs, count = groups.shape[:2]
        if self._by_run:
            return weights.reshape(runs, 1, -1), None
        repeated = np.broadcast_to(weights, (runs * count, len(weights)))
        if self._square is None:
            return repeated.reshape(runs, count, -1), None
        rows = groups.reshape(runs * count, -1)
        on_rows = np.matmul(repeated[:, None], self._square.slopes(rows))[:, 0]
        bent = self._square.curvature(rows, np.ascontiguousarray(repeated))
        return on_rows.reshape(groups.shape), bent.reshape(runs, count, *bent.shape[1:])


def _total(parts: Array, axis: int) -> Array:
    # One after the other: other sums round by how many there are beside them.
    return np.asarray(np.cumsum(parts, axis=axis).take(-1, axis=axis))


def _reader(matrix: Expression, index: dict[int, int]) -> Reader:
    def chosen(places: Sequence[int]) -> Expression:
        columns = [index[place] for place in places]
        return matrix[columns, columns]

    return chosen
