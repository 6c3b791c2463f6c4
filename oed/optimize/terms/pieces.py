"""Terms from pieces: one short piece of the drive is written and differentiated, and serves for all of them.

Building them takes as long for many samples as for few, and a piece has few unknowns of its own, so its
derivatives are short.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import casadi as ca
import numpy as np

from oed.foundation.arrays import Bools
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.system import follows_state, stepper
from oed.kernel.measurement.filter_rows import reads_of
from oed.kernel.measurement.joint import start_nuisances
from oed.kernel.problem import Problem
from oed.optimize.terms.base import Swept, Terms
from oed.optimize.terms.begun import Weighted
from oed.optimize.terms.cell import Cell, carry_of
from oed.optimize.terms.fixed_rows import FixedRows, FixedSweep
from oed.optimize.terms.instants import InstantRows
from oed.optimize.terms.kernel import Kernel
from oed.optimize.terms.layout import PieceLayout
from oed.optimize.terms.link import Link
from oed.optimize.terms.needs import needs_of
from oed.optimize.terms.passes import BegunInPieces, Sweep
from oed.optimize.terms.plan import Plan
from oed.optimize.terms.row_bounds import RowBounds, excess, scores_of
from oed.optimize.terms.totals import Totals
from oed.optimize.terms.whole_rows import Formulas, WholeRows

LONG = 500_000
"""Operations of a drive from which it is not written out: some 40 MB, and 0.2 s."""
JOINING = 1000
"""Operations to which what joins samples amounts in generated C."""


class Pieces(Terms):
    """Information and limit rows put together from pieces of the drive."""

    def __init__(self, problem: Problem, layout: PieceLayout, refine: int = 1) -> None:
        """Write a piece and what joins the pieces; functions are compiled when first used."""
        super().__init__(problem, refine)
        needs = needs_of(problem, self.bounding)
        cell = Cell(problem, self.input_scale.tolist())
        sensors = problem.measurement.joint_sensors
        kernel = Kernel(cell, layout, reads_of(sensors, layout.samples)[:, : layout.samples])
        started = bool(start_nuisances(sensors, problem.system))
        link = Link(kernel, carry_of(problem, kernel.gathered, started=started))
        self._plan = Plan(self, layout, kernel, link, Totals(self, layout, link.added))
        self._instants = InstantRows(problem, needs.instants, self.input_scale)
        whole = WholeRows(Formulas(self, needs.whole), self._moved) if needs.whole else None
        self._fixed = FixedRows(self, needs, whole, self._instants.without)

    @property
    def _moved(self) -> Bools:
        # Which unknowns move the states at all samples' begins, (samples, states, size).
        layout, robot = self._plan.layout, self.problem.system
        state, held = ca.SX.sym("state", len(robot.states)), ca.SX.sym("held", len(robot.inputs))
        after = stepper(robot)(state, held, ca.DM(robot.nominal), self.problem.design.period)
        by_state, by_held = (
            np.array(ca.DM(ca.jacobian_sparsity(after, one), 1.0)) != 0 for one in (state, held)
        )
        found = np.zeros((layout.count * layout.samples, len(robot.states), self.size), dtype=bool)
        acting = layout.basis != 0
        for place in range(len(found)):
            piece, sample = divmod(place, layout.samples)
            run, own = divmod(piece, layout.each)
            if own == sample == 0:
                moved = self.start_slopes[run] != 0
            found[place] = moved
            moved = by_state @ moved
            moved[:, layout.places[piece]] |= by_held @ acting[own, sample]
        return found

    @property
    def operations(self) -> int:
        """Operations of a whole drive, one after the other."""
        return int(self._plan.kernel.cell.values.n_instructions()) * self.problem.design.all_samples

    @property
    def sizes(self) -> list[int]:
        """The size of every matrix."""
        return self._plan.total.sizes

    @property
    def rows(self) -> list[RowBounds]:
        """Bounds of every limit's rows, without those of instants."""
        return self._fixed.bounds

    @property
    def linear(self) -> list[bool]:
        """Whether each limit's rows are linear in z."""
        return self._fixed.linear

    @property
    def instants(self) -> InstantRows:
        """The rows of an instant."""
        return self._instants

    def sweep(self) -> PiecesSweep:
        """The terms at z."""
        return PiecesSweep(Sweep(self._plan), self._fixed)

    @property
    def written(self) -> int:
        """Operations of a sample, and what joins the samples."""
        return JOINING + int(self._plan.kernel.cell.values.n_instructions())

    @cached_property
    def scores(self) -> ca.Function:
        """Z -> entries, the most that limits are exceeded by at the samples' ends and points between; of
        motions that lag at their begins, too.
        """
        instants = self._instants
        # A motion that lags jumps at a sample's begin, with the inputs.
        begin = 0 if follows_state(self.problem.system) else 1
        times = self.problem.design.period * np.arange(begin, self.refine + 1) / self.refine
        swept = Sweep(self._plan, self._plan.kernel.cell.scored(instants, times.tolist()))
        fixed, first, worst = FixedSweep(swept, self._fixed).rows, 0, []
        seen = ca.horzcat(swept.rolled[3], *self._at_starts(swept))
        for place, rows in enumerate(self.rows):
            own = fixed[first : first + len(rows.lower)]
            first += len(rows.lower)
            if place in instants.limits:
                worst.append(ca.mmax(seen[instants.limits.index(place), :]))
            else:
                worst.append(excess(own, rows))
        return scores_of(swept.z, swept.entries, worst)

    def _at_starts(self, sweep: Sweep) -> list[Expression]:
        # The same of where the runs begin (limits, runs), which may be chosen.
        rows, space = self._instants, self.problem.design
        if not space.start_is_free or not rows.count:
            return []
        held = sweep.inputs[:, list(range(0, space.all_samples, space.samples))]
        given = ca.vertcat(sweep.starts, held, *([held] if rows.asking else []))
        found = rows.exceeded(rows.all_rows.map(space.runs)(given, ca.DM.zeros(1, space.runs)))
        each = [found[np.flatnonzero(rows.owner == place).tolist(), :] for place in rows.limits]
        return [ca.vertcat(*(ca.mmax(ca.vec(one)) for one in each))]

    @cached_property
    def scores_written_out(self) -> ca.Function:
        """Z -> what `scores` gives, to the last bit, by one long list of operations: calling a sample's
        function takes as long as what it computes. Drives that are too long for that stay as they are.
        """
        if self.operations > LONG:
            return self.scores
        scores = self.scores
        # Simplified, some operations would round otherwise.
        simplified = ca.GlobalOptions.getSimplificationOnTheFly()
        ca.GlobalOptions.setSimplificationOnTheFly(False)
        try:
            return scores.expand("scores")
        finally:
            ca.GlobalOptions.setSimplificationOnTheFly(simplified)


class PiecesSweep(Swept):
    """The terms at z: what a sweep through the pieces finds, and the rows around it."""

    def __init__(self, sweep: Sweep, rows: FixedRows) -> None:
        """Take both."""
        self._sweep, self._rows, self.z = sweep, FixedSweep(sweep, rows), sweep.z

    entries = property(lambda self: self._sweep.entries)
    entry_slopes = property(lambda self: self._sweep.entry_slopes)
    rows = property(lambda self: self._rows.rows)
    row_slopes = property(lambda self: self._rows.row_slopes)

    def begun(self, samples: Expression) -> BegunInPieces:
        """What is known at some samples' begins."""
        return self._sweep.begun(samples)

    def curvature(self, entries: Expression, rows: Expression, begun: Sequence[Weighted]) -> Expression:
        """Second derivatives by z."""
        around, more = self._rows.curvature(rows)
        return self._sweep.curvature(entries, [*begun, *more]) + around
