"""Programs by the chain rule: what is cheap to write around the terms, differentiated apart from them."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.kernel.dynamics.expression import Expression
from oed.optimize.terms.base import Terms
from oed.optimize.terms.instants import LINEAR_WEIGHT
from oed.optimize.terms.slots import Chosen
from oed.optimize.terms.unrolled import OtherRobots
from oed.optimize.transcription.design import DesignExpressions

Interval = tuple[Array, Array]

NARROWED = 0.9
"""Share of the way between two bounds that tightening may take away at most."""
SLIGHT = 1e-4
"""Share of its size by which a limit is made wider to see what that moves."""


class Frame:
    """How a program sees the limits: bounds of single unknowns as bounds, all others as weighted rows.

    Bounds of single unknowns that contradict each other stay rows, for those Ipopt calls infeasible. With
    `relaxing` every row stays a row, twice: lowered, and raised, by its limit's relaxation. Behind the rows
    that there always are stand those of so many slots.
    """

    def __init__(self, terms: Terms, *, relaxing: bool, slots: int = 0) -> None:
        """Sort the rows."""
        self.size, self.relaxing, self._own = terms.size, relaxing, terms.own_bounds
        self.slots, self._instants = terms.slots(slots), terms.instants
        self._sizes = np.array([rows.size for rows in terms.rows])
        counts = np.array([len(rows.lower) for rows in terms.rows], dtype=int)
        self._owner = np.repeat(np.arange(len(terms.rows)), counts)
        self._lower = np.concatenate([np.zeros(0), *(rows.lower for rows in terms.rows)])
        self._upper = np.concatenate([np.zeros(0), *(rows.upper for rows in terms.rows)])
        self._simple, self._unknown, self._slope, self._constant = terms.bounded_unknowns
        least, most = self._ranges(self._lower, self._upper)
        kept = (least <= most)[self._unknown] & (not relaxing)
        self._simple, self._unknown = self._simple[kept], self._unknown[kept]
        self._slope, self._constant = self._slope[kept], self._constant[kept]
        self._rest = np.delete(np.arange(len(self._owner)), self._simple)
        weights = (
            np.where(np.array(terms.linear, dtype=bool) & (not relaxing), LINEAR_WEIGHT, 1.0) / self._sizes
        )
        self._weights = weights[self._owner[self._rest]]

    @property
    def choice(self) -> ca.DM:
        """The matrix (kept and slots, rows and slots) that picks and weights rows."""
        kept, slots = len(self._rest), np.arange(self.slots.count)
        rows, columns = (
            np.append(np.arange(kept), kept + slots),
            np.append(self._rest, len(self._owner) + slots),
        )
        weights = np.append(self._weights, np.ones(len(slots)))
        shape = kept + len(slots), len(self._owner) + len(slots)
        return ca.DM.triplet(rows.tolist(), columns.tolist(), weights, *shape)

    def relaxations(self, numbers: Expression) -> Expression:
        """The matrix (kept and slots, limits) that says which limit each row belongs to.

        Args:
            numbers: which rows the slots are of.
        """
        count, limits = len(self._owner), len(self._sizes)
        fixed = ca.DM.triplet(range(count), self._owner.tolist(), np.ones(count), count, limits)
        if not self.slots.count:
            return ca.MX(fixed)
        # Of every row of an instant its limit, and what that's size is there.
        owners = np.zeros((limits, self._instants.count))
        owners[self._instants.owner, np.arange(self._instants.count)] = self._instants.weight
        return ca.vertcat(fixed, (ca.DM(owners) @ self.slots.split(numbers)[-1]).T)

    def bounds(self, backoff: Array, chosen: Chosen | None = None) -> tuple[Interval, Interval]:
        """Bounds of z and of the rows, with each limit tightened by that share of its size.

        Args:
            backoff: the shares; of limits on instants none.
            chosen: rows of instants.
        """
        shift = (backoff * self._sizes)[self._owner]
        # Something is left between two bounds, however narrow: a robot may all but fill its room.
        shift = np.minimum(shift, NARROWED * (self._upper - self._lower) / 2)
        lower, upper = self._lower + shift, self._upper - shift
        low, high = self._unknowns_within(lower, upper)
        least, most = lower[self._rest] * self._weights, upper[self._rest] * self._weights
        if chosen is not None:
            own = chosen.bounds(self.slots.count)
            least, most = np.concatenate([least, own[0]]), np.concatenate([most, own[1]])
        if self.relaxing:
            unbounded = np.full(len(least), np.inf)
            least, most = np.concatenate([-unbounded, least]), np.concatenate([most, unbounded])
        return (low, high), (least, most)

    def gains(self, backoff: Array, multipliers: Array, chosen: Chosen | None = None) -> Array:
        """What the maximum gains, to first order, where each limit alone is wider: per share of its size.

        Args:
            backoff: share of its size by which each limit was tightened.
            multipliers: Lagrange's, of the bounds of z and of the rows, above 0 where an upper one holds.
            chosen: rows of instants.
        """
        own, rest = np.zeros(len(self._sizes)), multipliers
        if chosen is not None:
            count = self.slots.count
            rest, slots = multipliers[:-count], np.abs(multipliers[-count:][: len(chosen)])
            np.add.at(own, self._instants.owner[chosen.row], slots * self._instants.weight[chosen.row])
        steps = SLIGHT * np.eye(len(self._sizes))
        now = self._ends(backoff, rest)
        wider = [self._ends(backoff - step, rest) - now for step in steps]
        return own + np.array([rest @ one for one in wider]) / SLIGHT

    def _ends(self, backoff: Array, multipliers: Array) -> Array:
        # Of z and of every row the bound on the side that holds it; 0 where there is none.
        (low, high), (row_low, row_high) = self.bounds(backoff)
        lower, upper = np.concatenate([low, row_low]), np.concatenate([high, row_high])
        ends = np.where(multipliers > 0, upper, lower)
        return np.where(np.isfinite(ends), ends, 0.0)

    def _unknowns_within(self, lower: Array, upper: Array) -> Interval:
        # What tightened rows of single unknowns allow of these.
        low, high = self._ranges(lower, upper)
        least, most = self._ranges(self._lower, self._upper)
        # So it is of what several limits together allow of one unknown.
        spare = np.zeros(self.size)
        bounded = np.isfinite(most - least)
        spare[bounded] = (1 - NARROWED) * (most - least)[bounded] / 2
        return np.minimum(low, most - spare), np.maximum(high, least + spare)

    def _ranges(self, lower: Array, upper: Array) -> Interval:
        # Of every unknown, where all its own rows lie between such bounds.
        low, high = self._own.T.copy()
        ends = np.array([lower[self._simple], upper[self._simple]])
        ends = np.sort((ends - self._constant) / self._slope, axis=0)
        np.maximum.at(low, self._unknown, ends[0])
        np.minimum.at(high, self._unknown, ends[1])
        return low, high


class ChainRule:
    """A program around the terms, with its derivatives (MX).

    Attributes:
        functions: of the terms.

    Args:
        design: what it is about.
        frame: how it sees the limits.
        objective: scalar to maximise, SX of z, the entries and the auxiliary unknowns, as the next ones.
        auxiliary: further unknowns, (k,).
        conditions: further rows, before those of the limits.
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
        self._around = _Around([design.terms.unknowns, design.entries, auxiliary], -objective, conditions)
        self.functions = design.terms.functions(frame.slots.count)
        self._x = ca.MX.sym("x", design.terms.size + auxiliary.shape[0])
        self._p = ca.MX.sym("p", frame.slots.width)
        self._z, self._auxiliary = self._x[: design.terms.size], self._x[design.terms.size :]
        self._entries, rows = self._values()
        self._f = self._of(self._around.target)
        self._g = ca.vertcat(self._of(self._around.conditions), self._framed(rows))
        self.program = {"x": self._x, "p": self._p, "f": self._f, "g": self._g}

    @property
    def _given(self) -> list[Expression]:
        # z, and which rows the slots are of.
        return [self._z, *([self._p] if self._frame.slots.count else [])]

    def _of(self, function: ca.Function, *further: Expression) -> Any:
        # Of z, entries and auxiliary unknowns. Most criteria are asked for by these last alone: then nothing
        # has to be known of the drive.
        needed = any(function.jac_sparsity(place, 1).nnz() for place in range(function.n_out()))
        entries = self._entries if needed else ca.DM.zeros(*self._entries.shape)
        return function(self._z, entries, self._auxiliary, *further)

    @property
    def derivatives(self) -> dict[str, ca.Function]:
        """The program's derivatives, as options of a solver."""
        return {"grad_f": self._gradient(), "jac_g": self._jacobian(), "hess_lag": self._hessian()}

    def _values(self) -> tuple[Expression, Expression]:
        nominal, rows = self.functions.values(*self._given)
        others = [(place, robots.values(*given)) for place, robots, given in self._others()]
        return self._stacked(nominal, others), rows

    def _entry_slopes(self, nominal: Expression) -> Expression:
        others = [(place, robots.jacobian(*given)) for place, robots, given in self._others()]
        return self._stacked(nominal, others)

    def _stacked(self, nominal: Expression, others: list[tuple[int, Expression]]) -> Expression:
        each = [nominal] * len(self._design.robots)
        for place, own in others:
            each[place] = own
        return ca.vertcat(*each)

    def _others(self) -> list[tuple[int, OtherRobots, list[Any]]]:
        # Robots judged besides the nominal one: place, functions, what those take.
        return [
            (place, self._design.other_robots, [self._z, ca.DM(parameters), ca.DM(shift)])
            for place, parameters, shift in self._design.others
        ]

    def _framed(self, rows: Expression) -> Expression:
        kept = self._frame.choice @ rows
        if not self._frame.relaxing:
            return kept
        relaxed = self._frame.relaxations(self._p) @ self._auxiliary
        return ca.vertcat(kept - relaxed, kept + relaxed)

    def _gradient(self) -> ca.Function:
        by_z, by_entries, by_auxiliary = self._of(self._around.gradient)
        if self._around.gradient.nnz_out(1):
            nominal, _ = self.functions.jacobian(*self._given)
            by_z += self._entry_slopes(nominal).T @ by_entries
        gradient = ca.densify(ca.vertcat(by_z, by_auxiliary))
        return ca.Function("grad_f", [self._x, self._p], [self._f, gradient])

    def _jacobian(self) -> ca.Function:
        nominal, rows = self.functions.jacobian(*self._given)
        by_z, by_entries, by_auxiliary = self._of(self._around.jacobian)
        framed, count = self._frame.choice @ rows, self._auxiliary.shape[0]
        relaxed = ca.MX(framed.shape[0], count)
        if self._frame.relaxing:
            relaxed = self._frame.relaxations(self._p)
            framed, relaxed = ca.vertcat(framed, framed), ca.vertcat(-relaxed, relaxed)
        own = ca.horzcat(by_z + by_entries @ self._entry_slopes(nominal), by_auxiliary)
        whole = ca.vertcat(own, ca.horzcat(framed, relaxed))
        return ca.Function("jac_g", [self._x, self._p], [self._g, whole])

    def _hessian(self) -> ca.Function:
        terms, around = self._design.terms, self._around
        factor, multipliers = ca.MX.sym("factor"), ca.MX.sym("multipliers", self._g.shape[0])
        own, rest = ca.vertsplit(multipliers, [0, around.count, self._g.shape[0]])
        if self._frame.relaxing:
            lowered, raised = ca.vertsplit(rest, rest.shape[0] // 2)
            rest = lowered + raised
        weights, zz, ze, za, ee, ea, aa = self._of(around.hessian, factor, own)
        each = ca.vertsplit(weights, terms.entry_count)
        on_nominal = ca.MX(terms.entry_count, 1)
        places = {place for place, *_ in self._design.others}
        for place, weight in enumerate(each):
            on_nominal = on_nominal if place in places else on_nominal + weight
        upper = self.functions.hessian(*self._given, ca.densify(on_nominal), self._frame.choice.T @ rest)
        for place, robots, given in self._others():
            upper += robots.hessian(*given, each[place])
        corner = ca.triu2symm(upper) + zz
        if around.bent:
            nominal, _ = self.functions.jacobian(*self._given)
            slope = self._entry_slopes(nominal)
            mixed = ze @ slope
            corner += slope.T @ ee @ slope + mixed + mixed.T
            za += slope.T @ ea
        whole = ca.triu(ca.blockcat([[corner, za], [za.T, aa]]))
        return ca.Function("hess_lag", [self._x, self._p, factor, multipliers], [whole])


class _Around:
    """What is written around the terms, and its derivatives by z, entries and auxiliary unknowns."""

    def __init__(self, arguments: list[Expression], target: Expression, conditions: Expression) -> None:
        conditions = ca.densify(conditions)
        self.count = conditions.shape[0]
        factor, multipliers = ca.SX.sym("factor"), ca.SX.sym("multipliers", self.count)
        weighted = factor * target + ca.dot(multipliers, conditions)
        slopes = [ca.gradient(weighted, each) for each in arguments]
        blocks = [ca.jacobian(slopes[row], arguments[column]) for row in range(3) for column in range(row, 3)]
        self.target = ca.Function("target", arguments, [ca.densify(target)])
        self.conditions = ca.Function("conditions", arguments, [conditions])
        self.gradient = ca.Function(
            "gradient", arguments, [ca.jacobian(target, each).T for each in arguments]
        )
        self.jacobian = ca.Function(
            "jacobian", arguments, [ca.jacobian(conditions, each) for each in arguments]
        )
        self.hessian = ca.Function(
            "hessian", [*arguments, factor, multipliers], [ca.densify(slopes[1]), *blocks]
        )
        # Most criteria are linear in the information: then its slope need not be known here.
        self.bent = any(blocks[place].nnz() for place in (1, 3, 4))
