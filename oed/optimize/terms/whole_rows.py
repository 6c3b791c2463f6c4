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

from oed.foundation.arrays import Bools, Places
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.rollout import roll_out
from oed.kernel.dynamics.system import stepper
from oed.optimize.terms.base import Terms
from oed.optimize.terms.begun import Weighted
from oed.optimize.terms.passes import BegunInPieces, Sweep
from oed.optimize.terms.row_bounds import RowBounds
from oed.optimize.terms.small_drives import splines_of


class Formulas:
    """The limits' rows as expressions of states, inputs and unknowns that stand for themselves.

    Attributes:
        rows: of every limit (SX).
        states: how many there are at all samples' begins.
        samples: at whose begins they look at states, counted through all runs, (K,).
        needed: what they look at, as places in (states at all samples' begins, inputs held, z).
        linear: whether each limit's rows are linear in the unknowns.
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
            own = begun[run * space.samples : (run + 1) * space.samples, :]
            # The first is where the run begins; behind the last one there is no sample.
            known = ca.vertcat(terms.starts[run, :], own[1:, :])
            last = held[(run + 1) * space.samples - 1, :]
            end = stepper(robot)(known[-1, :].T, last.T, parameters, period)
            states.append(ca.horzcat(known.T, end))
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
        self.stacked = ca.vertcat(*(ca.densify(one.expression) for one in self.rows))
        given = ca.veccat(begun, held, terms.unknowns)
        self.needed: list[int] = np.flatnonzero(ca.which_depends(self.stacked, given, 1, False)).tolist()
        self.given = picked(given, self.needed)
        self.states, self._samples = int(begun.numel()), space.all_samples
        self.samples: Places = np.unique(self._of_begins % space.all_samples)
        by_unknowns = ca.veccat(terms.held, terms.unknowns)
        self.affine = ca.evalf(ca.jacobian(by_unknowns, terms.unknowns))
        self.linear = [self._linear(one.expression, begun) for one in self.rows]

    @cached_property
    def of_states(self) -> tuple[Places, Places]:
        """Which states they need, and at which of the samples, (n,) each."""
        places, count = self._of_begins, self._samples
        return places // count, np.searchsorted(self.samples, places % count)

    @property
    def _of_begins(self) -> Places:
        return np.array([one for one in self.needed if one < self.states], dtype=np.int64)

    def _linear(self, rows: Expression, begun: Expression) -> bool:
        rows = ca.densify(rows)
        return not (ca.depends_on(rows, ca.vec(begun)) or any(ca.which_depends(rows, self.given, 2, True)))

    @cached_property
    def pattern(self) -> ca.Sparsity:
        """Which of what is given moves which row."""
        return ca.jacobian_sparsity(self.stacked, self.given)

    @cached_property
    def values(self) -> ca.Function:
        """Given -> rows."""
        return ca.Function("whole", [self.given], [self.stacked])

    def slopes(self, given: Expression, slopes: Expression) -> Expression:
        """Derivatives (rows, size) of the rows by z, of what they need and the derivatives of that."""
        found, size = [ca.MX(0, slopes.shape[1])], slopes.shape[1]
        # Limit by limit: a slope that is infinite in one is not to spread to the others.
        for rows in (ca.densify(one.expression) for one in self.rows):
            count = rows.shape[0]
            if count >= size:
                direction = ca.SX.sym("direction", len(self.needed))
                slope = ca.densify(ca.jtimes(rows, self.given, direction))
                along = ca.Function("whole_along", [self.given, direction], [slope])
                found.append(along.map("along", "serial", size, [0], [])(given, ca.densify(slopes)))
            elif count:
                back = ca.Function("whole_gradient", *self._gradient(rows))
                each = back.map("back", "serial", count, [0], [])(given, ca.DM.eye(count))
                found.append(each.T @ slopes)
        return ca.vertcat(*found)

    def _gradient(self, rows: Expression) -> tuple[list[Expression], list[Expression]]:
        # (given, weights of the rows) -> weights of what is given.
        weights = ca.SX.sym("weights", rows.shape[0])
        return [self.given, weights], [ca.densify(ca.jtimes(rows, self.given, weights, True))]

    @cached_property
    def gradient(self) -> ca.Function:
        """(given, weights of the rows) -> weights of what is given."""
        return ca.Function("whole_gradient", *self._gradient(self.stacked))

    @cached_property
    def bent(self) -> ca.Function:
        """(given, weights of the rows, a direction) -> derivatives of the gradient along it."""
        (_, weights), (gradient,) = self._gradient(self.stacked)
        direction = ca.SX.sym("direction", len(self.needed))
        bent = ca.densify(ca.jtimes(gradient, self.given, direction))
        return ca.Function("whole_bent", [self.given, weights, direction], [bent])

    @cached_property
    def inner(self) -> ca.Sparsity:
        """Where second derivatives by what is given are not always 0."""
        (_, _), (gradient,) = self._gradient(self.stacked)
        return ca.jacobian_sparsity(gradient, self.given)

    @cached_property
    def colours(self) -> ca.Sparsity:
        """Columns of these that no row has two of, together, (given, colours)."""
        return self.inner.uni_coloring()


def picked(table: Expression, rows: Sequence[int]) -> Expression:
    """Some rows of a table; none of them is a table too."""
    return table[list(rows), :] if len(rows) else type(table)(0, table.shape[1])


class WholeRows:
    """Which of the rows there are, and their bounds.

    Attributes:
        formulas: the rows.
        pattern: which unknowns move which row.
        kept: rows that some unknown moves.
        bounds: of every limit's rows.
    """

    def __init__(self, formulas: Formulas, moved: Bools) -> None:
        """Leave out rows that nothing moves.

        Args:
            formulas: the rows.
            moved: which unknowns move the states at all samples' begins, (samples, states, size).
        """
        self.formulas = formulas
        affine = ca.DM(formulas.affine.sparsity(), 1.0)
        by_states = moved.transpose(1, 0, 2).reshape(-1, moved.shape[2])
        given = ca.vertcat(ca.sparsify(ca.DM(by_states.astype(float))), affine)
        self.pattern = (ca.DM(formulas.pattern, 1.0) @ picked(given, formulas.needed)).sparsity()
        self.kept: list[int] = sorted(set(self.pattern.row()))
        kept = np.zeros(self.pattern.size1(), dtype=bool)
        kept[self.kept] = True
        edges = np.cumsum([len(rows.lower) for rows in formulas.rows[:-1]], dtype=int)
        self.bounds = [
            RowBounds(rows.lower[own], rows.upper[own], rows.size, rows.unit)
            for rows, own in zip(formulas.rows, np.split(kept, edges), strict=True)
        ]


class WholeSweep:
    """Those rows at the z of a sweep through the pieces, which knows the states."""

    def __init__(self, sweep: Sweep, whole: WholeRows) -> None:
        """Take both."""
        self._sweep, self._whole, self._formulas = sweep, whole, whole.formulas

    @cached_property
    def _begun(self) -> BegunInPieces | None:
        samples = self._formulas.samples
        return self._sweep.begun(ca.DM(samples.astype(float)).T) if len(samples) else None

    @property
    def _others(self) -> list[int]:
        # Of what is needed, places in (inputs held, z).
        return [one - self._formulas.states for one in self._formulas.needed if one >= self._formulas.states]

    @cached_property
    def _given(self) -> Expression:
        # What the formulas need.
        others = picked(self._formulas.affine @ self._sweep.z, self._others)
        if self._begun is None:
            return others
        state, place = self._formulas.of_states
        count = self._begun.states.shape[0]
        return ca.vertcat(ca.vec(self._begun.states)[(place * count + state).tolist()], others)

    @cached_property
    def _given_slopes(self) -> Expression:
        # Its derivatives by z; those of inputs are sparse.
        others = ca.MX(picked(self._formulas.affine, self._others))
        if self._begun is None:
            return others
        state, place = self._formulas.of_states
        each = self._begun.states.shape[0] + self._begun.held.shape[0]
        return ca.vertcat(self._begun.slopes[:, (place * each + state).tolist()].T, others)

    @property
    def rows(self) -> Expression:
        """The limits' rows."""
        return picked(self._formulas.values(self._given), self._whole.kept)

    @property
    def row_slopes(self) -> Expression:
        """Derivatives of the rows by z, sparse."""
        found = self._formulas.slopes(self._given, self._given_slopes)
        return picked(ca.project(found, self._whole.pattern), self._whole.kept)

    def curvature(self, weights: Expression) -> tuple[Expression, list[Weighted]]:
        """Second derivatives by z of the weighted sum, but for those of states; what these weigh."""
        # Rows that no unknown moves have weights as well.
        weights = _spread(weights, self._whole.kept, self._whole.pattern.size1())
        around = self._given_slopes.T @ self._bent(weights)
        if self._begun is None:
            return around, []
        state, place = self._formulas.of_states
        gradient = picked(self._formulas.gradient(self._given, weights), range(len(state)))
        count = self._begun.states.shape[0]
        own = _spread(gradient, (place * count + state).tolist(), self._begun.states.numel())
        return around, [Weighted(self._begun, ca.reshape(own, *self._begun.states.shape))]

    def _bent(self, weights: Expression) -> Expression:
        # How the gradient of the rows' weighted sum by what is given moves with z.
        formulas, across = self._formulas, self._given_slopes
        inner, size = formulas.inner, across.shape[1]
        if not inner.nnz():
            return ca.MX(*across.shape)
        # Colours are as many as a row has entries, at least, and take long to find where these are many.
        fewer = np.bincount(inner.row()).max() < size and formulas.colours.size2() < size
        directions = ca.MX(ca.DM(formulas.colours, 1.0)) if fewer else across
        bent = formulas.bent.map("bent", "serial", directions.shape[1], [0, 1], [])
        found = bent(self._given, weights, ca.densify(directions))
        if not fewer:
            return found
        colours = formulas.colours
        colour = np.empty(inner.size2(), dtype=np.int64)
        colour[colours.row()] = colours.get_col()
        rows, columns = map(np.array, inner.get_triplet())
        entries = ca.vec(ca.densify(found))[(rows + inner.size1() * colour[columns]).tolist()]
        return ca.sparsity_cast(entries, inner) @ across


def _spread(entries: Expression, places: Sequence[int], count: int) -> Expression:
    # A column of so many entries, those at other places 0.
    place = np.full(count, len(places))
    place[list(places)] = np.arange(len(places))
    return picked(ca.densify(ca.vertcat(entries, ca.MX(1, 1))), place.tolist())
