"""Rows of limits that need whole runs, around the states and inputs of all samples.

The states are known, with their derivatives, as rows of the pieces; the limits' own formulas are
differentiated along the columns of these, so that writing them takes as long for many unknowns as for few.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import casadi as ca
import numpy as np

from oed.foundation.arrays import Bools
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.rollout import Drive, roll_out
from oed.kernel.limit import Limit, Rows
from oed.optimize.terms.base import RowBounds, Terms, without_zeros
from oed.optimize.terms.needs import Asked, splines_of


class SampleStates(Limit):
    """The states at the samples' ends, as rows without bounds: what limits on whole runs are written in.

    Attributes:
        columns: which of the states.
    """

    name: ClassVar[str] = "states"
    looks_at: ClassVar = "state"
    columns: tuple[int, ...]

    def rows(self, drive: Drive) -> Rows:
        """Every state at the end."""
        states = drive.states[-1, list(self.columns)].T
        unbounded = np.full(len(self.columns), np.inf)
        return Rows(states, -unbounded, unbounded, 1.0, "")

    @property
    def asked(self) -> Asked:
        """Once a sample."""
        return Asked(len(self.columns), 1, first=False)


class Formulas:
    """The limits' rows as expressions of states, inputs and unknowns that stand for themselves.

    Attributes:
        rows: of every limit (SX).
        states: those that they look at, at the samples' ends; None where they look at none.
        linear: whether each limit's rows are linear in the unknowns.
    """

    def __init__(self, terms: Terms, limits: Sequence[int]) -> None:
        """Write them, of the limits at these places among the problem's."""
        problem = terms.problem
        space, robot = problem.design, problem.system
        after = ca.SX.sym("after", space.all_samples, len(robot.states))
        held = ca.SX.sym("held", space.all_samples, len(robot.inputs))
        ends = ca.vertsplit(after, space.samples)
        drive = roll_out(
            robot,
            inputs=held,
            runs=space.runs,
            states=[ca.horzcat(terms.starts[run, :].T, end.T) for run, end in enumerate(ends)],
            parameters=ca.SX(ca.DM(robot.nominal)),
            period=ca.SX(space.period),
            refine=terms.refine,
        )
        drive = splines_of(problem, drive, terms.coefficients)
        self.rows = [problem.limits[place].rows(drive) for place in limits]
        self.stacked = ca.vertcat(*(ca.densify(one.expression) for one in self.rows))
        self.states = _looked_at(self.stacked, after)
        columns = list(self.states.columns) if self.states is not None else []
        given = ca.veccat(after[:, columns], held, terms.unknowns)
        self.needed = np.flatnonzero(ca.which_depends(self.stacked, given, 1, False)).tolist()
        self.given = picked(given, self.needed)
        by_unknowns = ca.veccat(without_zeros(space.sampling_matrix) @ terms.coefficients, terms.unknowns)
        self.affine = ca.evalf(ca.jacobian(by_unknowns, terms.unknowns))
        self.linear = [self._linear(one.expression, after) for one in self.rows]

    def _linear(self, rows: Expression, after: Expression) -> bool:
        rows = ca.densify(rows)
        return not (ca.depends_on(rows, ca.vec(after)) or any(ca.which_depends(rows, self.given, 2, True)))

    @cached_property
    def pattern(self) -> ca.Sparsity:
        """Which of what is given moves which row."""
        return ca.jacobian_sparsity(self.stacked, self.given)

    @cached_property
    def values(self) -> ca.Function:
        """Given -> rows."""
        return ca.Function("whole", [self.given], [self.stacked])

    @cached_property
    def along(self) -> ca.Function:
        """(given, a direction) -> derivatives of the rows along it."""
        direction = ca.SX.sym("direction", len(self.needed))
        slope = ca.jtimes(self.stacked, self.given, direction)
        return ca.Function("whole_along", [self.given, direction], [ca.densify(slope)])

    @cached_property
    def _gradient(self) -> tuple[Expression, Expression]:
        weights = ca.SX.sym("weights", self.stacked.shape[0])
        return weights, ca.densify(ca.jtimes(self.stacked, self.given, weights, True))

    @cached_property
    def gradient(self) -> ca.Function:
        """(given, weights of the rows) -> weights of what is given."""
        weights, gradient = self._gradient
        return ca.Function("whole_gradient", [self.given, weights], [gradient])

    @cached_property
    def bent(self) -> ca.Function:
        """(given, weights of the rows, a direction) -> derivatives of the gradient along it."""
        weights, gradient = self._gradient
        direction = ca.SX.sym("direction", len(self.needed))
        bent = ca.densify(ca.jtimes(gradient, self.given, direction))
        return ca.Function("whole_bent", [self.given, weights, direction], [bent])


def _looked_at(rows: Expression, after: Expression) -> SampleStates | None:
    any_sample = np.reshape(ca.which_depends(rows, ca.vec(after), 1, False), after.shape, order="F")
    columns = np.flatnonzero(any_sample.any(axis=0)).tolist()
    return SampleStates(columns=tuple(columns)) if columns else None


def picked(table: Expression, rows: Sequence[int]) -> Expression:
    """Some rows of a table; none of them is a table too."""
    return table[list(rows), :] if len(rows) else type(table)(0, table.shape[1])


@dataclass(frozen=True)
class WholeRows:
    """Rows of limits on whole runs and their derivatives by z, from the states and their derivatives.

    Attributes:
        formulas: the rows.
        moved: which unknowns move which of the states, (states, size).
    """

    formulas: Formulas
    moved: Bools

    @cached_property
    def _pattern(self) -> ca.Sparsity:
        # Which unknowns move which row.
        affine = ca.DM(self.formulas.affine.sparsity(), 1.0)
        given = ca.vertcat(ca.sparsify(ca.DM(self.moved.astype(float))), affine)
        return (ca.DM(self.formulas.pattern, 1.0) @ picked(given, self.formulas.needed)).sparsity()

    @cached_property
    def _kept(self) -> list[int]:
        # Rows that some unknown moves.
        return sorted(set(self._pattern.row()))

    @cached_property
    def bounds(self) -> list[RowBounds]:
        """The bounds of every limit's rows."""
        kept = np.zeros(self._pattern.size1(), dtype=bool)
        kept[self._kept] = True
        edges = np.cumsum([len(rows.lower) for rows in self.formulas.rows[:-1]], dtype=int)
        return [
            RowBounds(rows.lower[own], rows.upper[own], rows.size, rows.unit)
            for rows, own in zip(self.formulas.rows, np.split(kept, edges), strict=True)
        ]

    def _given(self, z: Expression, states: Expression) -> Expression:
        return picked(ca.densify(ca.vertcat(states, self.formulas.affine @ z)), self.formulas.needed)

    def _given_slopes(self, slopes: Expression) -> Expression:
        return ca.densify(picked(ca.vertcat(slopes, self.formulas.affine), self.formulas.needed))

    def values(self, z: Expression, states: Expression) -> Expression:
        """The rows."""
        return picked(self.formulas.values(self._given(z, states)), self._kept)

    def slopes(self, z: Expression, states: Expression, slopes: Expression) -> Expression:
        """Derivatives (rows, size) of the rows by z, sparse, from those of the states.

        Args:
            z: the unknowns.
            states: at the samples.
            slopes: of the states by z.
        """
        along = self.formulas.along.map("along", "serial", z.shape[0], [0], [])
        dense = along(self._given(z, states), self._given_slopes(slopes))
        return picked(ca.project(dense, self._pattern), self._kept)

    def weights(self, z: Expression, states: Expression, weights: Expression) -> Expression:
        """Weights that those of the rows give the states.

        Args:
            z: the unknowns.
            states: at the samples.
            weights: of the rows.
        """
        gradient = self.formulas.gradient(self._given(z, states), self._spread(weights))
        count, needed = states.shape[0], np.array(self.formulas.needed, dtype=int)
        own = np.flatnonzero(needed < count)
        place = np.full(count, len(needed))
        place[needed[own]] = own
        return picked(ca.vertcat(gradient, ca.MX(1, 1)), place.tolist())

    def curvature(
        self, z: Expression, states: Expression, slopes: Expression, weights: Expression
    ) -> Expression:
        """Second derivatives (size, size) by z of the weighted rows, besides those of the states.

        Args:
            z: the unknowns.
            states: at the samples.
            slopes: of the states by z.
            weights: of the rows.
        """
        bent = self.formulas.bent.map("bent", "serial", z.shape[0], [0, 1], [])
        across = self._given_slopes(slopes)
        return across.T @ bent(self._given(z, states), self._spread(weights), across)

    def _spread(self, weights: Expression) -> Expression:
        # To all rows, also those that no unknown moves.
        place = np.full(self._pattern.size1(), len(self._kept))
        place[self._kept] = np.arange(len(self._kept))
        return picked(ca.densify(ca.vertcat(weights, ca.MX(1, 1))), place.tolist())
