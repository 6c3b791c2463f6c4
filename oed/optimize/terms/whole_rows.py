"""Formulas that need whole drives, around x and the inputs of all samples.

x is known, with its derivatives, where samples begin; the formulas are differentiated by all of these at
once: backwards from each row, and the gradient once more along as many directions as the pattern of second
derivatives has colours [Gebremedhin, Manne and Pothen, "What color is your Jacobian?", SIAM Review 47, 2005].
Where there are fewer unknowns than rows, or than colours, both are along the derivatives of x by them. So
writing them takes as long for many unknowns as for few.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array, Places
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.rollout import Drive, roll_out
from oed.kernel.dynamics.system import carrier, stepper
from oed.kernel.limit import Rows
from oed.optimize.terms.matrices import upper_halves
from oed.optimize.terms.motion_cell import MotionCell
from oed.optimize.terms.small_drives import splines_of
from oed.optimize.terms.unknowns import Unknowns


class Formulas:
    """Groups of rows as expressions of x at all samples' begins, of inputs held and of unknowns.

    Attributes:
        groups: the groups' rows, (rows,) each (SX).
        variables: symbols that the rows depend on, x first (SX).
        constants: symbols by which nothing is differentiated (SX).
        x: entries of x that are variables, and their samples, counted through all runs, (n,) each.
        affine: derivatives of the other variables by all unknowns, (m, size).
        linear: linearity of each group in the unknowns.
    """

    def __init__(
        self,
        terms: Unknowns,
        begun: Expression,
        held: Expression,
        groups: Sequence[Expression],
        constants: Expression | None = None,
    ) -> None:
        """Find what the rows depend on.

        Args:
            terms: terms that say what the unknowns are.
            begun: symbols of x at all samples' begins, (samples, width).
            held: symbols of the inputs held, (samples, inputs).
            groups: rows of each group, of these symbols, of the unknowns and of constants.
            constants: symbols by which nothing is differentiated.
        """
        self.groups = [ca.densify(rows) for rows in groups]
        self.stacked = ca.vertcat(ca.SX(0, 1), *self.groups)
        self.constants = ca.SX(0, 1) if constants is None else constants
        every = ca.veccat(begun, held, terms.unknowns)
        needed = np.flatnonzero(ca.which_depends(self.stacked, every, 1, False))
        self.variables = picked(every, needed.tolist())
        of_x, others = needed[needed < begun.numel()], needed[needed >= begun.numel()] - begun.numel()
        self.x: tuple[Places, Places] = of_x // max(begun.shape[0], 1), of_x % max(begun.shape[0], 1)
        by_unknowns = ca.veccat(terms.held, terms.unknowns)
        slopes = np.array(ca.DM(ca.evalf(ca.jacobian(by_unknowns, terms.unknowns))))
        self.affine: Array = slopes.reshape(-1, terms.size)[others]
        self.linear = [
            not (ca.depends_on(rows, ca.vec(begun)) or any(ca.which_depends(rows, self.variables, 2, True)))
            for rows in self.groups
        ]

    @property
    def size(self) -> int:
        """Number of variables."""
        return int(self.variables.shape[0])

    @cached_property
    def pattern(self) -> ca.Sparsity:
        """Pattern of the rows by the variables."""
        return ca.jacobian_sparsity(self.stacked, self.variables)

    @cached_property
    def values(self) -> ca.Function:
        """(variables, constants) -> rows."""
        return ca.Function("whole", [self.variables, self.constants], [ca.densify(self.stacked)])

    def _gradient(self, rows: Expression) -> tuple[Expression, Expression]:
        # Weights of the rows, and those of the variables that they make.
        weights = ca.SX.sym("weights", rows.shape[0])
        return weights, ca.densify(ca.jtimes(rows, self.variables, weights, True))

    @cached_property
    def gradient(self) -> ca.Function:
        """(variables, constants, weights of the rows) -> weights of the variables."""
        weights, gradient = self._gradient(self.stacked)
        return ca.Function("whole_gradient", [self.variables, self.constants, weights], [gradient])

    @cached_property
    def by_group(self) -> list[tuple[ca.Function, bool]]:
        """Of every group a function of variables, constants and, if True stands with it, a direction, to the
        derivatives of its rows along that; else of weights of its rows, to those of the variables.
        """
        functions = []
        for rows in self.groups:
            is_along = rows.shape[0] >= self.affine.shape[1]
            weights, result = self._gradient(rows)
            if is_along:
                weights = ca.SX.sym("direction", self.size)
                result = ca.densify(ca.jtimes(rows, self.variables, weights))
            arguments = [self.variables, self.constants, weights]
            functions.append((ca.Function("whole_slopes", arguments, [result]), is_along))
        return functions

    @cached_property
    def bent(self) -> ca.Function:
        """(variables, constants, weights of the rows, a direction) -> change of the gradient along it."""
        weights, gradient = self._gradient(self.stacked)
        direction = ca.SX.sym("direction", self.size)
        bent = ca.densify(ca.jtimes(gradient, self.variables, direction))
        return ca.Function("whole_bent", [self.variables, self.constants, weights, direction], [bent])

    @cached_property
    def inner(self) -> ca.Sparsity:
        """Pattern of the second derivatives by the variables."""
        return ca.jacobian_sparsity(self._gradient(self.stacked)[1], self.variables)

    @cached_property
    def colours(self) -> Array | None:
        """Directions (colours, variables) that each pick columns of it of which no row has two; None if they
        are not fewer than the unknowns.
        """
        # They are as many as a row has entries, at least, and take long to find where these are many.
        if np.bincount(self.inner.row()).max() >= self.affine.shape[1]:
            return None
        found = self.inner.uni_coloring()
        return np.array(ca.DM(found, 1.0)).T if found.size2() < self.affine.shape[1] else None


def limit_formulas(terms: Unknowns, limits: Sequence[int]) -> tuple[Formulas, list[Rows]]:
    """Return the rows of limits on whole runs of the nominal system, as formulas and with their bounds.

    Args:
        terms: terms of the problem.
        limits: places of the limits among the problem's.
    """
    problem = terms.problem
    begun, held = _symbols(terms, len(problem.system.states))
    runs = []
    for run in range(problem.design.runs):
        # The first state is where the run begins, which may be fixed.
        runs.append(ca.vertcat(terms.starts[run, :], _of_run(terms, begun, run)[1:, :]))
    drive = _drive(terms, runs, held, ca.SX(ca.DM(problem.system.nominal)))
    rows = [problem.limits[place].rows(splines_of(drive, terms.bounding)) for place in limits]
    return Formulas(terms, begun, held, [limit.expression for limit in rows]), rows


def information_formulas(terms: Unknowns, cell: MotionCell) -> tuple[Formulas, list[int]]:
    """Return the entries of the judged matrices as formulas, and the sizes of these matrices.

    Args:
        terms: terms of the problem.
        cell: sample of the system's motion, with all sensitivities; parameters that differ are constants.
    """
    problem = terms.problem
    system, space = problem.system, problem.design
    begun, held = _symbols(terms, cell.width)
    parameters = cell.symbols[2] if cell.symbols[2].numel() else ca.SX(ca.DM(system.nominal))
    states = len(system.states)
    runs = [_of_run(terms, begun[:, :states], run) for run in range(space.runs)]
    drive = _drive(terms, runs, held, parameters)
    columns = [cell.sensitivities(row.T) for row in ca.vertsplit(begun[:, states:])]
    tables = [ca.reshape(column, states, -1) for column in columns]
    sensitivities = []
    for run in range(space.runs):
        last, samples = (run + 1) * space.samples - 1, slice(run * space.samples, (run + 1) * space.samples)
        end = carrier(system)(tables[last], begun[last, :states].T, held[last, :].T, parameters, drive.period)
        sensitivities += [*tables[samples], end]
    # What the drive would carry along itself, from the symbols instead.
    vars(drive)["sensitivities"] = ca.horzcat(*sensitivities)
    matrices = [estimation.matrix for estimation in problem.estimations(drive)]
    entries = upper_halves(matrices)
    sizes = [int(matrix.shape[0]) for matrix in matrices]
    return Formulas(terms, begun, held, [entries], cell.symbols[2]), sizes


def _symbols(terms: Unknowns, width: int) -> tuple[Expression, Expression]:
    # x at all samples' begins, and the inputs held.
    count = terms.problem.design.all_samples
    inputs = len(terms.problem.system.inputs)
    return ca.SX.sym("begun", count, width), ca.SX.sym("held", count, inputs)


def _of_run(terms: Unknowns, table: Expression, run: int) -> Expression:
    samples = terms.problem.design.samples
    return table[run * samples : (run + 1) * samples, :]


def _drive(terms: Unknowns, begins: Sequence[Expression], held: Expression, parameters: Expression) -> Drive:
    # The drive through states (samples, states) at the begins of every run's samples.
    problem, period = terms.problem, ca.SX(terms.problem.design.period)
    states = []
    for run, begun in enumerate(begins):
        # Behind the last sample there is no other.
        last = _of_run(terms, held, run)[-1, :].T
        end = stepper(problem.system)(begun[-1, :].T, last, parameters, period)
        states.append(ca.horzcat(begun.T, end))
    return roll_out(
        problem.system,
        inputs=held,
        runs=problem.design.runs,
        states=states,
        parameters=parameters,
        period=period,
        refine=terms.refine,
    )


def picked(table: Expression, rows: Sequence[int]) -> Expression:
    """Return some rows of a table, which may be none."""
    return table[list(rows), :] if len(rows) else type(table)(0, table.shape[1])
