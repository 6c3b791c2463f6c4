"""Limits on instants as rows of one instant, at any time of a period: for those that a search chooses.

Few of all instants are near a limit. A program holds rows of those alone, given with each call: which
sample, how long after its begin, which row.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array, Places
from oed.kernel.dynamics.direct_call import mapped
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.rollout import instant_of
from oed.kernel.limit import Rows
from oed.kernel.problem import Problem
from oed.optimize.condensed.differentiated import Differentiated
from oed.optimize.terms.row_bounds import RowBounds

TOGETHER = 50_000
"""Instants whose rows are computed at once: a call of a million takes gigabytes."""
LINEAR_WEIGHT = 20.0
"""Factor on rows that are linear in z (speeds, accelerations), against 1 for the others (positions).

Ipopt gives every row the same first multiplier, so a row's weight is how strongly it repels early on.
Searches held away from saturated accelerations first end in better optima: on the per-sample form the
mean over starts rises from 67 to 76 (of at most 85.8).
"""


class InstantRows:
    """The rows that limits have of one instant: of a state, of what is held, of what the splines ask for.

    Rows are in shares of their limit's size, times `LINEAR_WEIGHT` where they are linear in the inputs.

    Attributes:
        limits: places of these limits among the problem's.
        owner: of each row its limit's place, (R,).
        lower: bounds of the rows, (R,).
        upper: bounds of the rows, (R,).
        weight: what 1 is in a limit's size, (R,).
        without: sizes and units of these limits, by their places.
        asking: whether rows look at what the splines ask for at the instant.
        size: of (state, inputs held, inputs asked for if rows look at them).
        known: of the first two of these.
        bent: which of the first two enter anything but linearly.
        bent_asked: which of the inputs asked for do.
        crossing: whether of both some do together.
    """

    def __init__(self, problem: Problem, limits: Sequence[int], scale: Array) -> None:
        """Write them; functions are made when first used.

        Args:
            problem: whose limits they are.
            limits: their places.
            scale: what an input of 1 stands for, (inputs,).
        """
        system, space = problem.system, problem.design
        self.limits = tuple(limits)
        state, held, by_splines = (
            ca.SX.sym(name, count)
            for name, count in (
                ("state", len(system.states)),
                ("held", len(system.inputs)),
                ("asked", len(system.inputs)),
            )
        )
        self._elapsed = ca.SX.sym("elapsed")
        # Steps ask for what they hold.
        splines = space.stored_spline.degree > 0
        instant = instant_of(
            system,
            state=state,
            held=ca.DM(scale) * held,
            parameters=ca.SX(ca.DM(system.nominal)),
            period=self._elapsed,
            asked=ca.DM(scale) * (by_splines if splines else held),
            fraction=ca.SX(1),
        )
        by_limit = {place: problem.limits[place].rows(instant) for place in limits}
        shares = [
            ca.densify(ca.vec(limit_rows.expression)) / limit_rows.size for limit_rows in by_limit.values()
        ]
        rows = ca.vertcat(ca.SX(0, 1), *shares)
        self.asking = splines and bool(ca.depends_on(rows, by_splines))
        self._unknowns = ca.vertcat(state, held, *([by_splines] if self.asking else []))
        self.size = int(self._unknowns.shape[0])
        self.weight = np.array([self._weight(row, state) for row in ca.vertsplit(rows)])
        self._rows = ca.cse(ca.DM(self.weight) * rows) if len(self.weight) else rows
        self._bounded(by_limit)
        self.known = int(state.shape[0] + held.shape[0])
        self._differentiated()

    def _bounded(self, by_limit: Mapping[int, Rows]) -> None:
        # What the rows of each limit, by its place, may be.
        counts = [len(limit_rows.lower) for limit_rows in by_limit.values()]
        self.owner = np.repeat(np.array(list(by_limit), dtype=int), counts)
        nothing = np.zeros(0)
        self.without = {
            place: RowBounds(nothing, nothing, limit_rows.size, limit_rows.unit)
            for place, limit_rows in by_limit.items()
        }
        scale = self.weight / np.repeat([limit_rows.size for limit_rows in by_limit.values()], counts)
        self.lower = scale * np.concatenate(
            [nothing, *(limit_rows.lower for limit_rows in by_limit.values())]
        )
        self.upper = scale * np.concatenate(
            [nothing, *(limit_rows.upper for limit_rows in by_limit.values())]
        )

    def _differentiated(self) -> None:
        # Of the one row that is chosen: its slope, and its second derivatives where it is bent.
        self._chosen, self._factor = ca.SX.sym("chosen", len(self.weight)), ca.SX.sym("factor")
        self._row = ca.dot(self._chosen, self._rows)
        matrix, self._slope = ca.hessian(self._row, self._unknowns)
        bent = sorted(set(matrix.sparsity().row()))
        self.bent: list[int] = [place for place in bent if place < self.known]
        asked_for = [place for place in bent if place >= self.known]
        self.bent_asked = [place - self.known for place in asked_for]
        across = matrix[self.bent, asked_for]
        self.crossing = across.nnz() > 0
        parts = [matrix[self.bent, self.bent], matrix[asked_for, asked_for], across]
        self._curvature = [ca.densify(self._factor * part) for part in parts]

    def _weight(self, row: ca.SX, state: ca.SX) -> float:
        held = self._unknowns[state.shape[0] :]
        bent = ca.depends_on(row, state) or any(ca.which_depends(row, held, 2, True))
        return 1.0 if bent else LINEAR_WEIGHT

    @property
    def count(self) -> int:
        """R."""
        return len(self.weight)

    @property
    def _arguments(self) -> list[ca.SX]:
        return [self._unknowns, self._elapsed, self._chosen]

    @cached_property
    def values(self) -> ca.Function:
        """(unknowns, time since the period's begin [s], how much of each row (R,)) -> that much."""
        return ca.Function("instant", self._arguments, [ca.densify(self._row)])

    @cached_property
    def slopes(self) -> ca.Function:
        """(the same) -> derivatives (size,) by the unknowns."""
        return ca.Function("instant_slopes", self._arguments, [ca.densify(self._slope)])

    @cached_property
    def curvature(self) -> ca.Function:
        """(the same, a factor) -> the factor times second derivatives: by what is `bent`, by what is
        `bent_asked`, by both.
        """
        return ca.Function("instant_curvature", [*self._arguments, self._factor], self._curvature)

    @cached_property
    def chosen(self) -> Differentiated:
        """Chosen rows, of the unknowns and of (time since the period's begin [s], how much of each row)."""
        constants = ca.vertcat(self._elapsed, self._chosen)
        return Differentiated(self._unknowns, self._row, constants)

    @cached_property
    def all_rows(self) -> ca.Function:
        """(unknowns, time since the period's begin [s]) -> every row, (R,)."""
        return ca.Function("instant_rows", self._arguments[:2], [ca.densify(self._rows)])

    def table(self, unknowns: Array, elapsed: Array) -> Array:
        """Return every row of instants, (K, R).

        Args:
            unknowns: variables of each instant, (K, size).
            elapsed: time since its period's begin [s], (K,).
        """
        table = np.empty((len(elapsed), self.count))
        for first in range(0, len(elapsed), TOGETHER):
            portion = slice(first, first + TOGETHER)
            (flat,) = mapped(self.all_rows, len(elapsed[portion]))(unknowns[portion], elapsed[portion])
            table[portion] = flat.reshape(len(elapsed[portion]), self.count)
        return table

    def exceeded(self, rows: Expression) -> Expression:
        """Return the excess of rows (R, K), in shares of their limits' sizes."""
        upper, lower, weight = (
            ca.repmat(ca.DM(bound), 1, rows.shape[1]) for bound in (self.upper, self.lower, self.weight)
        )
        return ca.fmax(rows - upper, lower - rows) / weight

    def excess(self, rows: Array, which: Places | slice = slice(None)) -> Array:
        """Return the excess of values (..., R) of all rows, or (n,) of some, in shares of limits' sizes."""
        above = np.maximum(rows - self.upper[which], self.lower[which] - rows)
        return np.asarray(above / self.weight[which])
