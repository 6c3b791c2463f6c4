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
from oed.optimize.terms.base import RowBounds, Terms, splines_of
from oed.optimize.terms.needs import Asked, Needs
from oed.optimize.terms.passes import Sweep


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
        drive = splines_of(drive, terms.bounding)
        self.rows = [problem.limits[place].rows(drive) for place in limits]
        self.stacked = ca.vertcat(*(ca.densify(one.expression) for one in self.rows))
        self.states = _looked_at(self.stacked, after)
        columns = list(self.states.columns) if self.states is not None else []
        given = ca.veccat(after[:, columns], held, terms.unknowns)
        self.needed = np.flatnonzero(ca.which_depends(self.stacked, given, 1, False)).tolist()
        self.given = picked(given, self.needed)
        by_unknowns = ca.veccat(terms.held, terms.unknowns)
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
    """Which of the rows there are, and their bounds.

    Attributes:
        formulas: the rows.
        moved: which unknowns move which of the states, (states, size).
    """

    formulas: Formulas
    moved: Bools

    @cached_property
    def pattern(self) -> ca.Sparsity:
        """Which unknowns move which row."""
        affine = ca.DM(self.formulas.affine.sparsity(), 1.0)
        given = ca.vertcat(ca.sparsify(ca.DM(self.moved.astype(float))), affine)
        return (ca.DM(self.formulas.pattern, 1.0) @ picked(given, self.formulas.needed)).sparsity()

    @cached_property
    def kept(self) -> list[int]:
        """Rows that some unknown moves."""
        return sorted(set(self.pattern.row()))

    @cached_property
    def bounds(self) -> list[RowBounds]:
        """The bounds of every limit's rows."""
        kept = np.zeros(self.pattern.size1(), dtype=bool)
        kept[self.kept] = True
        edges = np.cumsum([len(rows.lower) for rows in self.formulas.rows[:-1]], dtype=int)
        return [
            RowBounds(rows.lower[own], rows.upper[own], rows.size, rows.unit)
            for rows, own in zip(self.formulas.rows, np.split(kept, edges), strict=True)
        ]


class WholeSweep:
    """A sweep through the pieces whose states go into the limits on whole runs: rows of all limits."""

    def __init__(self, sweep: Sweep, whole: WholeRows, needs: Needs) -> None:
        """Take the parts; needs are those of the limits."""
        self._sweep, self._whole, self._formulas = sweep, whole, whole.formulas
        bounds = sweep.plan.rows.bounds
        counts = [len(one.lower) for one in (*bounds, *whole.bounds)]
        self._own = sum(len(one.lower) for one in bounds)
        places = np.split(np.arange(sum(counts)), np.cumsum(counts)[:-1])
        # Where the rows of all limits, in their order, stand among those of the pieces and of whole runs.
        order = needs.in_order(places[: len(bounds)], places[len(bounds) :])
        self._order = np.concatenate(order).tolist()

    @cached_property
    def _parts(self) -> list[Expression]:
        # Rows of the pieces' limits, states.
        return self._split(self._sweep.rows)

    @cached_property
    def _slopes(self) -> list[Expression]:
        return self._split(self._sweep.row_slopes)

    def _split(self, rows: Expression) -> list[Expression]:
        return list(ca.vertsplit(rows, [0, self._own, rows.shape[0]]))

    @cached_property
    def _given(self) -> Expression:
        # What the formulas need, and its derivatives by z.
        both = ca.vertcat(self._parts[1], self._formulas.affine @ self._sweep.z)
        return picked(ca.densify(both), self._formulas.needed)

    @cached_property
    def _given_slopes(self) -> Expression:
        return ca.densify(picked(ca.vertcat(self._slopes[1], self._formulas.affine), self._formulas.needed))

    @property
    def rows(self) -> Expression:
        """The limits' rows."""
        whole = picked(self._formulas.values(self._given), self._whole.kept)
        return ca.vertcat(self._parts[0], whole)[self._order]

    @property
    def row_slopes(self) -> Expression:
        """Derivatives of the rows by z, sparse."""
        along = self._formulas.along.map("along", "serial", self._sweep.z.shape[0], [0], [])
        dense = along(self._given, self._given_slopes)
        whole = picked(ca.project(dense, self._whole.pattern), self._whole.kept)
        return ca.vertcat(self._slopes[0], whole)[self._order, :]

    def curvature(self, entries: Expression, rows: Expression) -> Expression:
        """Second derivatives by z of the weighted sum of entries and rows."""
        own, kept = self._split(rows[np.argsort(self._order).tolist()])
        # Rows that no unknown moves have weights as well.
        weights = _spread(kept, self._whole.kept, self._whole.pattern.size1())
        bent = self._formulas.bent.map("bent", "serial", self._sweep.z.shape[0], [0, 1], [])
        across = self._given_slopes
        around = across.T @ bent(self._given, weights, across)
        # What the rows' weights give the states.
        count, needed = self._parts[1].shape[0], np.array(self._formulas.needed, dtype=int)
        own_states = np.flatnonzero(needed < count)
        gradient = picked(self._formulas.gradient(self._given, weights), own_states.tolist())
        states = _spread(gradient, needed[own_states].tolist(), count)
        return self._sweep.curvature(entries, ca.vertcat(own, states)) + around


def _spread(entries: Expression, places: Sequence[int], count: int) -> Expression:
    # A column of so many entries, those at other places 0.
    place = np.full(count, len(places))
    place[list(places)] = np.arange(len(places))
    return picked(ca.densify(ca.vertcat(entries, ca.MX(1, 1))), place.tolist())
