"""Nonlinear programs by the chain rule: outer functions of the terms, differentiated apart from them."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.kernel.dynamics.expression import Expression
from oed.optimize.terms.instants import LINEAR_WEIGHT
from oed.optimize.terms.slots import Chosen
from oed.optimize.terms.terms import Terms
from oed.optimize.transcription.design import DesignExpressions

Interval = tuple[Array, Array]

NARROWED = 0.9
"""Share of the way between two bounds that tightening may take away at most."""
SLIGHT = 1e-4
"""Share of its size by which a limit is made wider to see what that moves."""


class Frame:
    """Limits as a program states them: single unknowns have bounds, all other limits are weighted rows.

    Bounds of single unknowns that contradict each other stay rows, because Ipopt reports these as infeasible.
    A relaxing frame keeps every row, twice: lowered, and raised, by the relaxation of its limit. The rows of
    the slots follow the permanent rows.

    Args:
        terms: terms whose limits are framed.
        relaxing: True where the auxiliary unknowns relax the limits.
        slots: number of slots for rows of instants.
    """

    def __init__(self, terms: Terms, *, relaxing: bool, slots: int = 0) -> None:
        """Sort the rows into bounds of single unknowns and all others."""
        self.size, self.relaxing, self._unknown_bounds = terms.size, relaxing, terms.own_bounds
        self.slots, self._instants = terms.slots(slots), terms.instants
        self._sizes = np.array([rows.size for rows in terms.rows])
        counts = np.array([len(rows.lower) for rows in terms.rows], dtype=int)
        self._owner = np.repeat(np.arange(len(terms.rows)), counts)
        self._lower = np.concatenate([np.zeros(0), *(rows.lower for rows in terms.rows)])
        self._upper = np.concatenate([np.zeros(0), *(rows.upper for rows in terms.rows)])
        self._simple, self._unknown, self._slope, self._constant = terms.bounded_unknowns
        least, most = self._ranges(self._lower, self._upper)
        consistent = (least <= most)[self._unknown] & (not relaxing)
        self._simple, self._unknown = self._simple[consistent], self._unknown[consistent]
        self._slope, self._constant = self._slope[consistent], self._constant[consistent]
        self._rest = np.delete(np.arange(len(self._owner)), self._simple)
        weights = (
            np.where(np.array(terms.linear, dtype=bool) & (not relaxing), LINEAR_WEIGHT, 1.0) / self._sizes
        )
        self._weights = weights[self._owner[self._rest]]

    @property
    def choice(self) -> ca.DM:
        """Matrix (r + s, rows + s) that picks and weights the r rows of the program and its s slots."""
        count, slots = len(self._rest), np.arange(self.slots.count)
        rows = np.append(np.arange(count), count + slots)
        columns = np.append(self._rest, len(self._owner) + slots)
        weights = np.append(self._weights, np.ones(len(slots)))
        shape = count + len(slots), len(self._owner) + len(slots)
        return ca.DM.triplet(rows.tolist(), columns.tolist(), weights, *shape)

    def relaxations(self, numbers: Expression) -> Expression:
        """Return the matrix (rows + slots, limits) that assigns each row to its limit.

        Args:
            numbers: numbers of the rows that the slots hold, as `Chosen.numbers` gives them.
        """
        count, limits = len(self._owner), len(self._sizes)
        fixed = ca.DM.triplet(range(count), self._owner.tolist(), np.ones(count), count, limits)
        if not self.slots.count:
            return ca.MX(fixed)
        # The limit of every row of an instant, and the row's weight by the size of that limit.
        owners = np.zeros((limits, self._instants.count))
        owners[self._instants.owner, np.arange(self._instants.count)] = self._instants.weight
        return ca.vertcat(fixed, (ca.DM(owners) @ self.slots.split(numbers)[-1]).T)

    def bounds(self, backoff: Array, chosen: Chosen | None = None) -> tuple[Interval, Interval]:
        """Return the bounds of z and of the rows where each limit is tightened by a share of its size.

        Args:
            backoff: shares of the limits' sizes, (limits,); 0 for limits on instants.
            chosen: rows of instants.
        """
        shift = (backoff * self._sizes)[self._owner]
        # Tightening never closes the gap between two bounds: a robot may all but fill its workspace.
        shift = np.minimum(shift, NARROWED * (self._upper - self._lower) / 2)
        lower, upper = self._lower + shift, self._upper - shift
        low, high = self._unknowns_within(lower, upper)
        least, most = lower[self._rest] * self._weights, upper[self._rest] * self._weights
        if chosen is not None:
            slot_least, slot_most = chosen.bounds(self.slots.count)
            least, most = np.concatenate([least, slot_least]), np.concatenate([most, slot_most])
        if self.relaxing:
            unbounded = np.full(len(least), np.inf)
            least, most = np.concatenate([-unbounded, least]), np.concatenate([most, unbounded])
        return (low, high), (least, most)

    def gains(self, backoff: Array, multipliers: Array, chosen: Chosen | None = None) -> Array:
        """Return the first-order gains (limits,) of the maximum if each limit alone is widened.

        They are per share of the limit's size.

        Args:
            backoff: share of its size by which each limit was tightened.
            multipliers: Lagrange multipliers of the bounds of z and of the rows, positive at upper bounds.
            chosen: rows of instants.
        """
        gains, rest = np.zeros(len(self._sizes)), multipliers
        if chosen is not None:
            count = self.slots.count
            rest, slots = multipliers[:-count], np.abs(multipliers[-count:][: len(chosen)])
            np.add.at(gains, self._instants.owner[chosen.row], slots * self._instants.weight[chosen.row])
        steps = SLIGHT * np.eye(len(self._sizes))
        now = self._ends(backoff, rest)
        slopes = [rest @ (self._ends(backoff - step, rest) - now) for step in steps]
        return gains + np.array(slopes) / SLIGHT

    def _ends(self, backoff: Array, multipliers: Array) -> Array:
        # The bound of z and of every row on the side that its multiplier holds; 0 where there is none.
        (low, high), (row_low, row_high) = self.bounds(backoff)
        lower, upper = np.concatenate([low, row_low]), np.concatenate([high, row_high])
        ends = np.where(multipliers > 0, upper, lower)
        return np.where(np.isfinite(ends), ends, 0.0)

    def _unknowns_within(self, lower: Array, upper: Array) -> Interval:
        # Bounds that tightened rows of single unknowns leave to these unknowns.
        low, high = self._ranges(lower, upper)
        least, most = self._ranges(self._lower, self._upper)
        # Several limits on the same unknown together leave the same share of the gap.
        spare = np.zeros(self.size)
        bounded = np.isfinite(most - least)
        spare[bounded] = (1 - NARROWED) * (most - least)[bounded] / 2
        return np.minimum(low, most - spare), np.maximum(high, least + spare)

    def _ranges(self, lower: Array, upper: Array) -> Interval:
        # Interval of every unknown within which all rows of that unknown alone lie between these bounds.
        low, high = self._unknown_bounds.T.copy()
        ends = np.array([lower[self._simple], upper[self._simple]])
        ends = np.sort((ends - self._constant) / self._slope, axis=0)
        np.maximum.at(low, self._unknown, ends[0])
        np.minimum.at(high, self._unknown, ends[1])
        return low, high


class ChainRule:
    """Nonlinear program around the terms, with its derivatives (MX).

    Attributes:
        functions: compiled functions of the terms.

    Args:
        design: expressions of the problem.
        frame: limits as the program states them.
        objective: scalar to maximise, SX of z, the entries and the auxiliary unknowns.
        auxiliary: further unknowns, (k,).
        conditions: further rows before those of the limits, SX of the same symbols.
    """

    def __init__(
        self,
        design: DesignExpressions,
        frame: Frame,
        objective: Expression,
        auxiliary: Expression,
        conditions: Expression,
    ) -> None:
        """Write the program; the terms are differentiated where no program did so before."""
        self._design, self._frame = design, frame
        arguments = [design.terms.unknowns, design.entries, auxiliary]
        self._outer = _OuterFunctions(arguments, -objective, conditions)
        self.functions = design.terms.functions(frame.slots.count)
        self._x = ca.MX.sym("x", design.terms.size + auxiliary.shape[0])
        self._p = ca.MX.sym("p", frame.slots.width)
        self._z, self._auxiliary = self._x[: design.terms.size], self._x[design.terms.size :]
        self._entries, rows = self.functions.values(*self._arguments)
        self._f = self._call(self._outer.target)
        self._g = ca.vertcat(self._call(self._outer.conditions), self._frame_rows(rows))
        self.program = {"x": self._x, "p": self._p, "f": self._f, "g": self._g}

    @property
    def _arguments(self) -> list[Expression]:
        # Arguments of the terms' functions: z, and the numbers of the rows that the slots hold.
        return [self._z, *([self._p] if self._frame.slots.count else [])]

    def _call(self, function: ca.Function, *further: Expression) -> Any:
        # Most criteria depend on the auxiliary unknowns alone: then the drive need not be simulated.
        needed = any(function.jac_sparsity(place, 1).nnz() for place in range(function.n_out()))
        entries = self._entries if needed else ca.DM.zeros(*self._entries.shape)
        return function(self._z, entries, self._auxiliary, *further)

    @property
    def derivatives(self) -> dict[str, ca.Function]:
        """The program's derivatives, as options of a solver."""
        return {"grad_f": self._gradient(), "jac_g": self._jacobian(), "hess_lag": self._hessian()}

    def _frame_rows(self, rows: Expression) -> Expression:
        framed = self._frame.choice @ rows
        if not self._frame.relaxing:
            return framed
        relaxed = self._frame.relaxations(self._p) @ self._auxiliary
        return ca.vertcat(framed - relaxed, framed + relaxed)

    def _gradient(self) -> ca.Function:
        by_z, by_entries, by_auxiliary = self._call(self._outer.gradient)
        if self._outer.gradient.nnz_out(1):
            by_z += self.functions.jacobian(*self._arguments)[0].T @ by_entries
        gradient = ca.densify(ca.vertcat(by_z, by_auxiliary))
        return ca.Function("grad_f", [self._x, self._p], [self._f, gradient])

    def _jacobian(self) -> ca.Function:
        slopes, rows = self.functions.jacobian(*self._arguments)
        by_z, by_entries, by_auxiliary = self._call(self._outer.jacobian)
        framed, count = self._frame.choice @ rows, self._auxiliary.shape[0]
        relaxed = ca.MX(framed.shape[0], count)
        if self._frame.relaxing:
            relaxed = self._frame.relaxations(self._p)
            framed, relaxed = ca.vertcat(framed, framed), ca.vertcat(-relaxed, relaxed)
        conditions = ca.horzcat(by_z + by_entries @ slopes, by_auxiliary)
        jacobian = ca.vertcat(conditions, ca.horzcat(framed, relaxed))
        return ca.Function("jac_g", [self._x, self._p], [self._g, jacobian])

    def _hessian(self) -> ca.Function:
        outer = self._outer
        factor, multipliers = ca.MX.sym("factor"), ca.MX.sym("multipliers", self._g.shape[0])
        on_conditions, rest = ca.vertsplit(multipliers, [0, outer.count, self._g.shape[0]])
        if self._frame.relaxing:
            lowered, raised = ca.vertsplit(rest, rest.shape[0] // 2)
            rest = lowered + raised
        weights, zz, ze, za, ee, ea, aa = self._call(outer.hessian, factor, on_conditions)
        upper = self.functions.hessian(*self._arguments, weights, self._frame.choice.T @ rest)
        corner = ca.triu2symm(upper) + zz
        if outer.nonlinear:
            slope, _ = self.functions.jacobian(*self._arguments)
            mixed = ze @ slope
            corner += slope.T @ ee @ slope + mixed + mixed.T
            za += slope.T @ ea
        hessian = ca.triu(ca.blockcat([[corner, za], [za.T, aa]]))
        return ca.Function("hess_lag", [self._x, self._p, factor, multipliers], [hessian])


class _OuterFunctions:
    """Objective and conditions as functions of z, entries and auxiliary unknowns, with their derivatives."""

    def __init__(self, arguments: list[Expression], target: Expression, conditions: Expression) -> None:
        conditions = ca.densify(conditions)
        self.count = conditions.shape[0]
        factor, multipliers = ca.SX.sym("factor"), ca.SX.sym("multipliers", self.count)
        weighted = factor * target + ca.dot(multipliers, conditions)
        slopes = [ca.gradient(weighted, argument) for argument in arguments]
        blocks = [ca.jacobian(slopes[row], arguments[column]) for row in range(3) for column in range(row, 3)]
        self.target = ca.Function("target", arguments, [ca.densify(target)])
        self.conditions = ca.Function("conditions", arguments, [conditions])
        gradients = [ca.jacobian(target, argument).T for argument in arguments]
        self.gradient = ca.Function("gradient", arguments, gradients)
        jacobians = [ca.jacobian(conditions, argument) for argument in arguments]
        self.jacobian = ca.Function("jacobian", arguments, jacobians)
        self.hessian = ca.Function(
            "hessian", [*arguments, factor, multipliers], [ca.densify(slopes[1]), *blocks]
        )
        # Most criteria are linear in the information: then the Hessian needs no slopes of it.
        self.nonlinear = any(blocks[place].nnz() for place in (1, 3, 4))
