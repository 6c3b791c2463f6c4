"""What a search asks of a drive again and again: its information, its limits, and their derivatives.

They are written out and differentiated once. Every program over the same drives shares them, whatever it
maximises: the criterion, a second stage, another criterion, the search for limits that conflict.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt
from scipy import sparse

from oed.expression import Expression
from oed.limits.limit import Rows
from oed.problem import Problem
from oed.rollout import Drive, roll_out

Array = npt.NDArray[np.float64]
Places = npt.NDArray[np.int64]


class Terms:
    """Information and limit rows of a problem's drives as functions of the unknowns z.

    The unknowns are the free spline coefficients, in units of each input's largest speed, and the start
    poses where they are free. Positions are limited at `refine` points per sample.

    Attributes:
        size: of z; the first `coefficient_count` are spline coefficients.
        unknowns: z (SX).
        drive: of the nominal robot (SX).
        matrices: its information, block by block (SX).
        rows: every limit, without rows that no unknown moves (SX).
    """

    def __init__(self, problem: Problem, refine: int = 1) -> None:
        """Write the expressions; functions are compiled when first used."""
        space, model = problem.design, problem.robot
        self.problem = problem
        self.input_scale = np.abs(problem.input_bounds).max(axis=1)
        self.free = space.free_rows
        self.coefficient_count = len(self.free) * len(model.inputs)
        self.size = self.coefficient_count + (3 * space.runs if space.start_is_free else 0)
        self.unknowns = ca.SX.sym("z", self.size)
        coefficients = self._coefficients()
        self.drive: Drive = roll_out(
            model,
            space.integration,
            inputs=without_zeros(space.sampling_matrix) @ coefficients,
            start=self._start(),
            parameters=ca.SX(ca.DM(model.nominal)),
            period=ca.SX(space.period),
            input_values=coefficients,
            input_rates=without_zeros(space.rate_matrix) @ coefficients,
            input_jerks=without_zeros(space.jerk_matrix) @ coefficients,
            refine=refine,
            runs=space.runs,
        )
        matrices = [one.matrix for one in problem.estimations(self.drive)]
        rows = [_dependent(rows, self.unknowns) for rows in problem.limit_rows(self.drive)]
        # Step and measurement repeat each other's sines; shared, a quarter of the operations goes away.
        shared = ca.cse([*matrices, *(one.expression for one in rows)])
        self.matrices: list[Expression] = shared[: len(matrices)]
        self.rows = [
            Rows(expression, one.lower, one.upper, one.size, one.unit)
            for expression, one in zip(shared[len(matrices) :], rows, strict=True)
        ]

    def _coefficients(self) -> Expression:
        inputs = len(self.problem.model.inputs)
        free = ca.reshape(self.unknowns[: self.coefficient_count], len(self.free), inputs)
        table = ca.SX.zeros(self.problem.design.all_coefficients, inputs)
        table[self.free.tolist(), :] = free @ ca.diag(ca.DM(self.input_scale))
        return table

    def _start(self) -> Expression:
        problem = self.problem
        if problem.fixed_starts is not None:
            return ca.SX(ca.DM(problem.fixed_starts))
        poses = ca.reshape(self.unknowns[self.coefficient_count :], 3, problem.design.runs).T
        return ca.horzcat(poses, ca.SX(problem.design.runs, len(problem.model.states) - 3))

    @cached_property
    def entries(self) -> Expression:
        """The upper halves of all matrices, stacked."""
        return ca.vertcat(*(upper_half(matrix) for matrix in self.matrices))

    @cached_property
    def stacked_rows(self) -> Expression:
        """The rows of all limits, stacked."""
        return ca.vertcat(*(rows.expression for rows in self.rows))

    @cached_property
    def values(self) -> ca.Function:
        """Z -> entries of the matrices, rows."""
        return ca.Function("terms", [self.unknowns], [self.entries, self.stacked_rows])

    @cached_property
    def jacobian(self) -> ca.Function:
        """Z -> derivatives of the entries, and of the rows."""
        both = ca.vertcat(self.entries, self.stacked_rows)
        slope = ca.jacobian(both, self.unknowns)
        count = self.entries.shape[0]
        return ca.Function("slopes", [self.unknowns], [ca.densify(slope[:count, :]), slope[count:, :]])

    @cached_property
    def hessian(self) -> ca.Function:
        """(z, weights of the entries, weights of the rows) -> second derivatives of the weighted sum."""
        entries = ca.SX.sym("entries", self.entries.shape[0])
        rows = ca.SX.sym("rows", self.stacked_rows.shape[0])
        weighted = ca.dot(entries, self.entries) + ca.dot(rows, self.stacked_rows)
        gradient = ca.gradient(weighted, self.unknowns)
        # Every unknown meets every other somewhere: finding that out would take longer than using it.
        curvature = ca.jtimes(gradient, self.unknowns, ca.SX.eye(self.size))
        return ca.Function("curvature", [self.unknowns, entries, rows], [ca.triu(curvature)])

    @cached_property
    def scores(self) -> ca.Function:
        """Z -> entries of the matrices, and for every limit its largest violation over its size."""
        worst = [
            ca.fmax(0, ca.mmax(ca.vertcat(rows.expression - rows.upper, rows.lower - rows.expression)))
            / rows.size
            for rows in map(_finite, self.rows)
        ]
        return ca.Function("scores", [self.unknowns], [self.entries, ca.vertcat(*worst)])

    @cached_property
    def linear(self) -> list[bool]:
        """Whether each limit's rows are linear in z."""
        return [not any(ca.which_depends(rows.expression, self.unknowns, 2, True)) for rows in self.rows]

    @cached_property
    def bounded_unknowns(self) -> tuple[Places, Places, Array, Array]:
        """Rows that are a constant plus a multiple of a single unknown: those rows, the unknowns, the
        multiples, the constants.
        """
        slope, nothing = self.jacobian.sparsity_out(1), np.zeros(self.size)
        rows, columns = (np.array(part, dtype=int) for part in slope.get_triplet())
        linear = np.repeat(self.linear, [len(one.lower) for one in self.rows])
        single = np.flatnonzero(linear & (np.bincount(rows, minlength=len(linear)) == 1))
        inverse = np.full(len(linear), -1)
        inverse[rows] = columns
        multiples = sparse.csc_matrix(self.jacobian(nothing)[1])[single, inverse[single]]
        constants = np.array(self.values(nothing)[1]).ravel()[single]
        return single, inverse[single], np.asarray(multiples).ravel(), constants


class OtherRobots:
    """The information that the same inputs give other robots: one function of their parameters."""

    def __init__(self, problem: Problem, terms: Terms) -> None:
        """Write the expressions; functions are compiled when first used."""
        drive, z = terms.drive, terms.unknowns
        parameters = ca.SX.sym("p", len(problem.robot.parameters))
        shift = ca.SX.sym("shift", problem.design.runs, len(problem.robot.states))
        begin, _ = drive.ends_of(drive.poses)
        other = drive.again(parameters, begin + shift)
        matrices = ca.cse([one.matrix for one in problem.estimations(other)])
        self.entries = ca.vertcat(*(upper_half(matrix) for matrix in matrices))
        self.arguments: list[Any] = [z, parameters, shift]

    @cached_property
    def values(self) -> ca.Function:
        """(z, parameters, shift of the start states) -> entries."""
        return ca.Function("other", self.arguments, [self.entries])

    @cached_property
    def jacobian(self) -> ca.Function:
        """The same -> derivatives of the entries by z."""
        slope = ca.jacobian(self.entries, self.arguments[0])
        return ca.Function("other_slopes", self.arguments, [ca.densify(slope)])

    @cached_property
    def hessian(self) -> ca.Function:
        """(the same, weights of the entries) -> second derivatives by z of the weighted sum."""
        z, weights = self.arguments[0], ca.SX.sym("entries", self.entries.shape[0])
        gradient = ca.gradient(ca.dot(weights, self.entries), z)
        curvature = ca.jtimes(gradient, z, ca.SX.eye(z.shape[0]))
        return ca.Function("other_curvature", [*self.arguments, weights], [ca.triu(curvature)])


def upper_half(matrix: Expression) -> Expression:
    """The entries on and above the diagonal, column by column, (p (p + 1) / 2,)."""
    size = matrix.shape[0]
    return ca.vertcat(*(matrix[row, column] for column in range(size) for row in range(column + 1)))


def symmetric(entries: Expression, size: int) -> Expression:
    """The symmetric matrix (p, p) with these entries on and above its diagonal."""
    rows: list[list[Any]] = [[None] * size for _ in range(size)]
    places = ((row, column) for column in range(size) for row in range(column + 1))
    for index, (row, column) in enumerate(places):
        rows[row][column] = rows[column][row] = entries[index]
    return ca.blockcat(rows)


def stacks(entries: Array, sizes: Sequence[int]) -> list[Array]:
    """Numeric matrices (K, p, p) of stacked entries (sum of p (p + 1) / 2, K), one for each size p."""
    found, first = [], 0
    for size in sizes:
        columns, rows = np.tril_indices(size)
        matrix = np.empty((entries.shape[1], size, size))
        own = entries[first : first + len(rows)].T
        matrix[:, rows, columns] = matrix[:, columns, rows] = own
        found.append(matrix)
        first += len(rows)
    return found


def without_zeros(matrix: Array) -> ca.DM:
    """A constant whose zeros are structural."""
    return ca.sparsify(ca.DM(matrix))


def _finite(rows: Rows) -> Rows:
    # Open sides must not enter a maximum as infinities.
    big = 1e20
    return Rows(
        rows.expression, np.maximum(rows.lower, -big), np.minimum(rows.upper, big), rows.size, rows.unit
    )


def _dependent(rows: Rows, unknowns: Expression) -> Rows:
    # Rows that no unknown moves (coefficients that rest fixes) would only burden the solver.
    # Dense, or rows that are structurally 0 (where runs meet) would not be counted.
    expression = ca.densify(rows.expression)
    moved = np.array(ca.which_depends(expression, unknowns, 1, True), dtype=bool)
    chosen = np.flatnonzero(moved)
    return Rows(expression[chosen.tolist()], rows.lower[moved], rows.upper[moved], rows.size, rows.unit)


_KEPT: list[tuple[tuple[Any, ...], Terms]] = []
_MOST = 2


def terms_of(problem: Problem, refine: int = 1) -> Terms:
    """The terms of a problem, written once in a process for all criteria of the same matrices."""
    criterion = problem.criterion
    same = (
        problem.model,
        problem.design,
        problem.measurement,
        problem.limits,
        problem.estimate,
        problem.prior,
        problem.uncertainty,
        problem.robust,
        criterion.scaling,
        criterion.subset,
        refine,
    )
    for key, terms in _KEPT:
        if key == same:
            return terms
    terms = Terms(problem, refine)
    _KEPT.insert(0, (same, terms))
    del _KEPT[_MOST:]
    return terms
