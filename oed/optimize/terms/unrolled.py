"""Terms by unrolling: the whole drive written out sample by sample, and differentiated as it stands.

It serves every problem, at a cost of building that grows with the samples.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from oed.foundation.arrays import Bools
from oed.kernel.dynamics.expression import Expression
from oed.kernel.limit import Rows
from oed.kernel.problem import Problem
from oed.optimize.terms.base import RowBounds, Terms, said_once, upper_half


class Unrolled(Terms):
    """Information and limit rows of the drive written out, positions at `refine` points per sample.

    Attributes:
        matrices: its information, block by block (SX).
        limits: every limit's rows, without those that no unknown moves (SX).
    """

    def __init__(self, problem: Problem, refine: int = 1) -> None:
        """Write the expressions; functions are compiled when first used."""
        super().__init__(problem, refine)
        matrices = [one.matrix for one in problem.estimations(self.drive)]
        rows = [_dependent(rows, self.unknowns) for rows in problem.limit_rows(self.drive)]
        if self.embedding.repeats and problem.robust is None:
            both = zip(problem.limits, rows, strict=True)
            rows = [_once(one, self.unknowns) if limit.looks_at == "inputs" else one for limit, one in both]
        # Step and measurement repeat each other's sines; shared, a quarter of the operations goes away.
        shared = ca.cse([*matrices, *(one.expression for one in rows)])
        self.matrices: list[Expression] = shared[: len(matrices)]
        self.limits = [
            Rows(expression, one.lower, one.upper, one.size, one.unit)
            for expression, one in zip(shared[len(matrices) :], rows, strict=True)
        ]

    @cached_property
    def rows(self) -> list[RowBounds]:
        """Bounds of every limit's rows."""
        return [RowBounds(one.lower, one.upper, one.size, one.unit) for one in self.limits]

    @property
    def sizes(self) -> list[int]:
        """The size of every matrix."""
        return [matrix.shape[0] for matrix in self.matrices]

    @cached_property
    def entries(self) -> Expression:
        """The upper halves of all matrices, stacked."""
        return ca.vertcat(*(upper_half(matrix) for matrix in self.matrices))

    @cached_property
    def stacked_rows(self) -> Expression:
        """The rows of all limits, stacked."""
        return ca.vertcat(*(rows.expression for rows in self.limits))

    @cached_property
    def values(self) -> ca.Function:
        """Z -> entries of the matrices, rows."""
        return ca.Function("terms", [self.unknowns], [self.entries, self.stacked_rows])

    @property
    def written(self) -> int:
        """Operations of a whole drive."""
        return int(self.values.n_instructions())

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
    def linear(self) -> list[bool]:
        """Whether each limit's rows are linear in z."""
        return [not any(ca.which_depends(rows.expression, self.unknowns, 2, True)) for rows in self.limits]


class OtherRobots:
    """The information that a drive's inputs give other robots: one function of their parameters."""

    def __init__(self, problem: Problem, terms: Unrolled) -> None:
        """Write the expressions; functions are compiled when first used."""
        drive, z = terms.drive, terms.unknowns
        parameters = ca.SX.sym("p", len(problem.system.parameters))
        shift = ca.SX.sym("shift", problem.design.runs, len(problem.system.states))
        begin, _ = drive.ends_of(drive.states)
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
        """(z, parameters, shift of the start) -> derivatives of the entries by z."""
        slope = ca.jacobian(self.entries, self.arguments[0])
        return ca.Function("other_slopes", self.arguments, [ca.densify(slope)])

    @cached_property
    def hessian(self) -> ca.Function:
        """(z, parameters, shift, weights of the entries) -> second derivatives by z of the weighted sum."""
        z, weights = self.arguments[0], ca.SX.sym("entries", self.entries.shape[0])
        gradient = ca.gradient(ca.dot(weights, self.entries), z)
        curvature = ca.jtimes(gradient, z, ca.SX.eye(z.shape[0]))
        return ca.Function("other_curvature", [*self.arguments, weights], [ca.triu(curvature)])


def _dependent(rows: Rows, unknowns: Expression) -> Rows:
    # Rows that no unknown moves (coefficients that rest fixes) would only burden the solver.
    # Dense, or rows that are structurally 0 (where runs meet) would not be counted.
    expression = ca.densify(rows.expression)
    moved = np.array(ca.which_depends(expression, unknowns, 1, True), dtype=bool)
    return _chosen(replace(rows, expression=expression), moved)


def _once(rows: Rows, unknowns: Expression) -> Rows:
    # Linear rows that say what one before them does would only burden the solver, too.
    if not rows.lower.size or any(ca.which_depends(rows.expression, unknowns, 2, True)):
        return rows
    slopes = ca.densify(ca.jacobian(rows.expression, unknowns))
    both = ca.Function("rows", [unknowns], [slopes, rows.expression])
    steep, constants = map(np.array, both(np.zeros(unknowns.shape[0])))
    return _chosen(rows, said_once(steep, constants.ravel(), rows))


def _chosen(rows: Rows, kept: Bools) -> Rows:
    places = np.flatnonzero(kept).tolist()
    return replace(rows, expression=rows.expression[places], lower=rows.lower[kept], upper=rows.upper[kept])
