"""Terms from pieces: one short piece of the drive is written and differentiated, and serves for all of them.

Building them takes as long for many samples as for few, and a piece has few unknowns of its own, so its
derivatives are short.
"""

from __future__ import annotations

from functools import cached_property

import casadi as ca

from oed.kernel.measurement.filter_rows import reads_of
from oed.kernel.measurement.sensor import start_nuisances
from oed.kernel.problem import Problem
from oed.optimize.terms.base import RowBounds, Terms, scores_of
from oed.optimize.terms.cell import Cell, carry_of
from oed.optimize.terms.kernel import Kernel
from oed.optimize.terms.layout import PieceLayout
from oed.optimize.terms.link import Link
from oed.optimize.terms.needs import needs_of
from oed.optimize.terms.passes import Plan, Sweep
from oed.optimize.terms.piece_rows import PieceRows
from oed.optimize.terms.totals import Totals
from oed.optimize.terms.whole_rows import Formulas, WholeRows, WholeSweep

LONG = 500_000
"""Operations of a drive from which it is not written out: some 40 MB, and 0.2 s."""
JOINING = 1000
"""Operations to which what joins samples amounts in generated C."""


class Pieces(Terms):
    """Information and limit rows put together from pieces of the drive."""

    def __init__(self, problem: Problem, layout: PieceLayout, refine: int = 1) -> None:
        """Write a piece and what joins the pieces; functions are compiled when first used."""
        super().__init__(problem, refine)
        needs = self._needs = needs_of(problem, self.bounding, refine)
        formulas = Formulas(self, needs.whole) if needs.whole else None
        asked = [(problem.limits[place], asked) for place, asked in needs.asked.items()]
        if formulas is not None and formulas.states is not None:
            asked.append((formulas.states, formulas.states.asked))
        cell = Cell(problem, asked, self.input_scale.tolist(), refine)
        sensors = problem.measurement.joint_sensors
        kernel = Kernel(cell, layout, reads_of(sensors, layout.samples)[:, : layout.samples])
        started = bool(start_nuisances(sensors, problem.system))
        link = Link(kernel, carry_of(problem, kernel.gathered, started=started))
        rows = PieceRows(self, layout, cell, needs)
        self._plan = Plan(self, layout, kernel, link, Totals(self, layout, link.added), rows)
        self._whole = None if formulas is None else WholeRows(formulas, rows.states_moved)

    @cached_property
    def _sweep(self) -> Sweep:
        return Sweep(self._plan)

    @cached_property
    def _all_rows(self) -> Sweep | WholeSweep:
        return self._sweep if self._whole is None else WholeSweep(self._sweep, self._whole, self._needs)

    @property
    def written(self) -> int:
        """Operations of a sample, and what joins the samples."""
        return JOINING + int(self._plan.kernel.cell.values.n_instructions())

    @property
    def operations(self) -> int:
        """Operations of a whole drive, one after the other."""
        return int(self._plan.kernel.cell.values.n_instructions()) * self.problem.design.all_samples

    @cached_property
    def scores(self) -> ca.Function:
        """Z -> entries of the matrices, and for every limit its largest violation over its size: of samples
        at once where that is all that is asked, for then no row need be kept.
        """
        if self._whole is not None or self._plan.rows.whole_samples is None:
            return super().scores
        sweep = Sweep(self._plan, scoring=True)
        worst = [ca.fmax(0, one) / rows.size for one, rows in zip(sweep.worst, self.rows, strict=True)]
        return scores_of(sweep.z, sweep.entries, worst)

    @cached_property
    def scores_written_out(self) -> ca.Function:
        """Z -> what `scores` gives, to the last bit, by one long list of operations: calling a sample's
        function takes as long as what it computes. Drives that are too long for that stay as they are.
        """
        if self.operations > LONG:
            return self.scores
        # Simplified, some operations would round otherwise.
        simplified = ca.GlobalOptions.getSimplificationOnTheFly()
        ca.GlobalOptions.setSimplificationOnTheFly(False)
        try:
            return self.scores.expand("scores")
        finally:
            ca.GlobalOptions.setSimplificationOnTheFly(simplified)

    @property
    def sizes(self) -> list[int]:
        """The size of every matrix."""
        return self._plan.total.sizes

    @cached_property
    def rows(self) -> list[RowBounds]:
        """Bounds of every limit's rows."""
        whole = [] if self._whole is None else self._whole.bounds
        return self._needs.in_order(self._plan.rows.bounds, whole)

    @cached_property
    def linear(self) -> list[bool]:
        """Whether each limit's rows are linear in z."""
        whole = [] if self._whole is None else self._whole.formulas.linear
        return self._needs.in_order(self._plan.rows.linear, whole)

    @cached_property
    def values(self) -> ca.Function:
        """Z -> entries of the matrices, rows."""
        return ca.Function("terms", [self._sweep.z], [self._sweep.entries, self._all_rows.rows])

    @cached_property
    def jacobian(self) -> ca.Function:
        """Z -> derivatives of the entries, and of the rows."""
        results = [self._sweep.entry_slopes, self._all_rows.row_slopes]
        return ca.Function("slopes", [self._sweep.z], results)

    @cached_property
    def hessian(self) -> ca.Function:
        """(z, weights of the entries, weights of the rows) -> second derivatives of the weighted sum."""
        weights = [
            ca.MX.sym("entries", self.entry_count),
            ca.MX.sym("rows", sum(len(one.lower) for one in self.rows)),
        ]
        curvature = ca.triu(self._all_rows.curvature(*weights))
        return ca.Function("curvature", [self._sweep.z, *weights], [curvature])
