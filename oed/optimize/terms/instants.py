"""Limits on instants as rows of one instant, at any time of a period: for those that a search chooses.

Few of all instants are near a limit. A program holds rows of those alone, given with each call: which
sample, how long after its begin, which row.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array, Bools, Places
from oed.kernel.dynamics.direct_call import mapped
from oed.kernel.dynamics.expression import Expression
from oed.kernel.problem import Problem
from oed.optimize.terms.differentiated import Differentiated
from oed.optimize.terms.motion_cell import MotionCell
from oed.optimize.terms.row_bounds import RowBounds
from oed.optimize.terms.watched import Watched, watched_systems

TOGETHER = 50_000
"""Instants whose rows are computed at once: a call of a million takes gigabytes."""
LINEAR_WEIGHT = 20.0
"""Factor on rows that are linear in z (speeds, accelerations), against 1 for the others (positions).

Ipopt gives every row the same first multiplier, so a row's weight is how strongly it repels early on.
Searches held away from saturated accelerations first end in better optima: on the per-sample form the
mean over starts rises from 67 to 76 (of at most 85.8).
"""


class InstantRows:
    """The rows that limits have of one instant: of x where its sample begins, of what is held, of what the
    splines ask for.

    Rows are in shares of their limit's size, times `LINEAR_WEIGHT` where they are linear in the inputs.

    Attributes:
        limits: places of these limits among the problem's.
        owner: place of each row's limit, (R,).
        lower: lower bounds of the rows, (R,).
        upper: upper bounds of the rows, (R,).
        weight: what 1 is in a limit's size, (R,).
        scenarios: the K systems that are watched.
        systems: True for each of these that keeps a row, (R, K).
        without: sizes and units of these limits, by their places.
        asking: whether rows look at what the splines ask for at the instant.
        cell: sample of the watched systems' motion; None where that of the information serves.
        begun: number of entries of x that rows look at, from the first on.
    """

    def __init__(self, problem: Problem, limits: Sequence[int], scale: Array) -> None:
        """Write them; functions are made when first used.

        Args:
            problem: problem with the limits.
            limits: places of the limits that have rows of instants.
            scale: what an input of 1 stands for, (inputs,).
        """
        self.limits, self.scenarios = tuple(limits), watched_systems(problem)
        system, space = self.scenarios.system, problem.design
        held, by_splines = (ca.SX.sym(name, len(system.inputs)) for name in ("held", "asked"))
        # Steps ask for what they hold.
        splines = space.stored_spline.degree > 0
        asked = ca.DM(scale) * (by_splines if splines else held)
        watched = Watched.of(self.scenarios, ca.DM(scale) * held, asked)
        self._parts = watched.rows(problem, limits)
        shares = [ca.densify(ca.vec(part.rows.expression)) / part.rows.size for part in self._parts]
        rows = ca.vertcat(ca.SX(0, 1), *shares)
        x = watched.state
        self.cell: MotionCell | None = None
        if problem.robust is not None:
            looked_at = np.array(ca.which_depends(rows, watched.sensitivities, 1, False), dtype=bool)
            columns = np.flatnonzero(looked_at.reshape(watched.columns, len(system.states)).any(axis=1))
            self.cell = MotionCell(
                system, space.period, scale, columns=columns.tolist(), varied=self.scenarios.varied.size > 0
            )
            carried = ca.SX.sym("carried", len(self.cell.entries))
            rows = ca.substitute(rows, watched.sensitivities, self.cell.sensitivities(carried))
            x = ca.vertcat(x, carried)
        self.begun = int(x.shape[0])
        self.asking = splines and bool(ca.depends_on(rows, by_splines))
        self._unknowns = ca.vertcat(x, held, *([by_splines] if self.asking else []))
        self.weight = np.array([self._weight(row, x) for row in ca.vertsplit(rows)])
        self._rows = ca.cse(ca.DM(self.weight) * rows) if len(self.weight) else rows
        self._constants = ca.vertcat(watched.elapsed, watched.parameters)
        self._bounded()

    def _bounded(self) -> None:
        # What the rows may be.
        parts, nothing = self._parts, np.zeros(0)
        counts = [len(part.rows.lower) for part in parts]
        self.owner = np.repeat(np.array([part.limit for part in parts], dtype=int), counts)
        self._group = np.repeat(np.arange(len(parts)), counts)
        self._kept_by = np.array([part.systems for part in parts], dtype=bool).reshape(
            len(parts), len(self.scenarios.parameters)
        )
        self.systems = self._kept_by[self._group]
        self.without = {
            part.limit: RowBounds(nothing, nothing, part.rows.size, part.rows.unit) for part in parts
        }
        scale = self.weight / np.repeat([part.rows.size for part in parts], counts)
        self.lower = scale * np.concatenate([nothing, *(part.rows.lower for part in parts)])
        self.upper = scale * np.concatenate([nothing, *(part.rows.upper for part in parts)])

    def _weight(self, row: ca.SX, x: ca.SX) -> float:
        held = self._unknowns[x.shape[0] :]
        bent = ca.depends_on(row, x) or any(ca.which_depends(row, held, 2, True))
        return 1.0 if bent else LINEAR_WEIGHT

    @property
    def count(self) -> int:
        """Number of rows, R."""
        return len(self.weight)

    @property
    def size(self) -> int:
        """Number of variables: x as far as rows look at it, inputs held, inputs asked for if they do."""
        return int(self._unknowns.shape[0])

    @property
    def groups(self) -> Bools:
        """True for each row of a group of one limit's rows that the same systems keep, (groups, R)."""
        return np.asarray(self._group == np.arange(len(self._parts))[:, None])

    def by_limit(self, excess: Array) -> Array:
        """Return the largest excess over each limit (..., limits) that the systems are to keep.

        Args:
            excess: excess of each system over each group of rows, (..., K, groups).
        """
        kept = np.where(self._kept_by.T, excess, -np.inf).max(axis=-2)
        limits = np.array([part.limit for part in self._parts])
        return np.stack([kept[..., limits == place].max(axis=-1) for place in self.limits], axis=-1)

    @cached_property
    def weighted(self) -> Differentiated:
        """Sum of weighted rows, of the variables and of (constants of the instant, weight of each row)."""
        chosen = ca.SX.sym("chosen", self.count)
        row = ca.dot(chosen, self._rows)
        return Differentiated(self._unknowns, row, ca.vertcat(self._constants, chosen))

    @cached_property
    def all_rows(self) -> ca.Function:
        """(variables, constants of the instant) -> every row, (R,)."""
        return ca.Function("instant_rows", [self._unknowns, self._constants], [ca.densify(self._rows)])

    def constants(self, systems: Places, elapsed: Array) -> Array:
        """Return the constants (n, c) of instants: time since the sample's begin, parameters if they differ.

        Args:
            systems: place of each instant's system among the watched ones, (n,).
            elapsed: time since its sample's begin [s], (n,).
        """
        return np.column_stack([elapsed, self.scenarios.varied[systems]])

    def table(self, variables: Array, constants: Array) -> Array:
        """Return every row of instants, (n, R).

        Args:
            variables: variables of each instant, (n, size).
            constants: constants of each instant, (n, c).
        """
        table = np.empty((len(constants), self.count))
        for first in range(0, len(constants), TOGETHER):
            portion = slice(first, first + TOGETHER)
            (flat,) = mapped(self.all_rows, len(constants[portion]))(variables[portion], constants[portion])
            table[portion] = flat.reshape(len(constants[portion]), self.count)
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
