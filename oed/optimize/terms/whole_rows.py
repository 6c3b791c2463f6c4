"""Rows of limits that need whole runs, around the states and inputs of all samples.

The states are known, with their derivatives, where samples begin; the limits' own formulas are differentiated
by all of them at once: backwards from each row, and the gradient once more along as many directions as the
pattern of second derivatives has colours [Gebremedhin, Manne and Pothen, "What color is your Jacobian?", SIAM
Review 47, 2005]. Where there are fewer unknowns than rows, or than colours, both are along the derivatives of
the states by them. So writing them takes as long for many unknowns as for few.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import casadi as ca
import numpy as np

from oed.foundation.arrays import Places
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.rollout import roll_out
from oed.kernel.dynamics.system import stepper
from oed.optimize.terms.base import Terms
from oed.optimize.terms.small_drives import splines_of


class Formulas:
    """The limits' rows as expressions of states, inputs and unknowns that stand for themselves.

    Attributes:
        rows: rows of every limit (SX).
        states: number of states at all samples' begins.
        samples: samples at whose begins they look at states, counted through all runs, (K,).
        needed: places of their variables in (states at all samples' begins, inputs held, z).
        linear: linearity of each limit's rows in the unknowns.
    """

    def __init__(self, terms: Terms, limits: Sequence[int]) -> None:
        """Write them, of the limits at these places among the problem's."""
        problem = terms.problem
        space, robot = problem.design, problem.system
        begun = ca.SX.sym("begun", space.all_samples, len(robot.states))
        held = ca.SX.sym("held", space.all_samples, len(robot.inputs))
        parameters, period = ca.SX(ca.DM(robot.nominal)), ca.SX(space.period)
        states = []
        for run in range(space.runs):
            begins = begun[run * space.samples : (run + 1) * space.samples, :]
            # The first is where the run begins; behind the last one there is no sample.
            states_at_samples = ca.vertcat(terms.starts[run, :], begins[1:, :])
            last = held[(run + 1) * space.samples - 1, :]
            end = stepper(robot)(states_at_samples[-1, :].T, last.T, parameters, period)
            states.append(ca.horzcat(states_at_samples.T, end))
        drive = roll_out(
            robot,
            inputs=held,
            runs=space.runs,
            states=states,
            parameters=parameters,
            period=period,
            refine=terms.refine,
        )
        drive = splines_of(drive, terms.bounding)
        self.rows = [problem.limits[place].rows(drive) for place in limits]
        self.stacked = ca.vertcat(*(ca.densify(limit.expression) for limit in self.rows))
        variables = ca.veccat(begun, held, terms.unknowns)
        self.needed: list[int] = np.flatnonzero(ca.which_depends(self.stacked, variables, 1, False)).tolist()
        self.variables = picked(variables, self.needed)
        self.states, self._samples = int(begun.numel()), space.all_samples
        self.samples: Places = np.unique(self._of_begins % space.all_samples)
        by_unknowns = ca.veccat(terms.held, terms.unknowns)
        self.affine = ca.evalf(ca.jacobian(by_unknowns, terms.unknowns))
        self.linear = [self._linear(limit.expression, begun) for limit in self.rows]

    @cached_property
    def of_states(self) -> tuple[Places, Places]:
        """States that the rows need, and places of their samples in `samples`, (n,) each."""
        places, count = self._of_begins, self._samples
        return places // count, np.searchsorted(self.samples, places % count)

    @property
    def _of_begins(self) -> Places:
        return np.array([place for place in self.needed if place < self.states], dtype=np.int64)

    def _linear(self, rows: Expression, begun: Expression) -> bool:
        rows = ca.densify(rows)
        return not (
            ca.depends_on(rows, ca.vec(begun)) or any(ca.which_depends(rows, self.variables, 2, True))
        )

    @cached_property
    def pattern(self) -> ca.Sparsity:
        """Pattern of the rows by the variables."""
        return ca.jacobian_sparsity(self.stacked, self.variables)

    @cached_property
    def values(self) -> ca.Function:
        """Variables -> rows."""
        return ca.Function("whole", [self.variables], [self.stacked])

    def _gradient(self, rows: Expression) -> tuple[list[Expression], list[Expression]]:
        # (variables, weights of the rows) -> weights of the variables.
        weights = ca.SX.sym("weights", rows.shape[0])
        return [self.variables, weights], [ca.densify(ca.jtimes(rows, self.variables, weights, True))]

    @cached_property
    def gradient(self) -> ca.Function:
        """(variables, weights of the rows) -> weights of the variables."""
        return ca.Function("whole_gradient", *self._gradient(self.stacked))

    @cached_property
    def bent(self) -> ca.Function:
        """(variables, weights of the rows, a direction) -> derivatives of the gradient along it."""
        (_, weights), (gradient,) = self._gradient(self.stacked)
        direction = ca.SX.sym("direction", len(self.needed))
        bent = ca.densify(ca.jtimes(gradient, self.variables, direction))
        return ca.Function("whole_bent", [self.variables, weights, direction], [bent])

    @cached_property
    def inner(self) -> ca.Sparsity:
        """Pattern of the second derivatives by the variables."""
        (_, _), (gradient,) = self._gradient(self.stacked)
        return ca.jacobian_sparsity(gradient, self.variables)

    @cached_property
    def colours(self) -> ca.Sparsity:
        """Colours of its columns, of which no row has two, (variables, colours)."""
        return self.inner.uni_coloring()


def picked(table: Expression, rows: Sequence[int]) -> Expression:
    """Return some rows of a table, which may be none."""
    return table[list(rows), :] if len(rows) else type(table)(0, table.shape[1])
