"""Terms from pieces: one short piece of the drive is written and differentiated, and serves for all of them.

Building them takes as long for many samples as for few, and a piece has few unknowns of its own, so its
derivatives are short.
"""

from __future__ import annotations

from functools import cached_property

import casadi as ca

from oed.kernel.measurement.sensor import start_nuisances
from oed.kernel.problem import Problem
from oed.optimize.terms.base import RowBounds, Terms
from oed.optimize.terms.carry import Carry
from oed.optimize.terms.cell import Cell, estimated
from oed.optimize.terms.kernel import Kernel
from oed.optimize.terms.layout import PieceLayout, best_layout
from oed.optimize.terms.link import Link
from oed.optimize.terms.needs import needs_of
from oed.optimize.terms.passes import Plan, Sweep
from oed.optimize.terms.piece_rows import PieceRows
from oed.optimize.terms.totals import Sum, Totals
from oed.optimize.terms.whole_rows import Formulas, WholeRows
from oed.optimize.terms.whole_sweep import WholeSweep


def divisible(problem: Problem) -> PieceLayout | None:
    """How the problem's drives are cut into pieces; None where they have to be written out as a whole.

    That is so for robust limits and other systems, noise that readings share over time, segments of unequal
    length, and samples without a suitable divisor.
    """
    space = problem.design
    cuts = problem.measurement.cuts(space.samples)
    if problem.robust is not None or cuts is None:
        return None
    inputs, divisor = len(problem.system.inputs), None if cuts.segment == 1 else cuts.segment
    return best_layout(space, inputs, multiple=cuts.multiple, divisor=divisor)


class Pieces(Terms):
    """Information and limit rows put together from pieces of the drive."""

    def __init__(self, problem: Problem, layout: PieceLayout, refine: int = 1) -> None:
        """Write a piece and what joins the pieces; functions are compiled when first used."""
        super().__init__(problem, refine)
        needs = self._needs = needs_of(problem, self.coefficients, refine)
        formulas = Formulas(self, needs.whole) if needs.whole else None
        asked = [(problem.limits[place], asked) for place, asked in needs.asked.items()]
        if formulas is not None and formulas.states is not None:
            asked.append((formulas.states, formulas.states.asked))
        cell, totals = Cell(problem, asked, self.input_scale.tolist(), refine), Totals(problem, layout)
        kernel = Kernel(cell, layout, [sensor.every for sensor in totals.sensors])
        link = Link(kernel, _carry(problem, kernel, totals))
        rows = PieceRows(self, layout, cell, needs)
        total = Sum(totals, link.added)
        self._plan = Plan(self, layout, kernel, link, total, rows)
        self._whole = None if formulas is None else WholeRows(formulas, rows.states_moved)

    @cached_property
    def _sweep(self) -> Sweep | WholeSweep:
        sweep = Sweep(self._plan)
        return sweep if self._whole is None else WholeSweep(sweep, self._whole, self._needs)

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
        sweep = self._sweep
        return ca.Function("terms", [sweep.z], [sweep.entries, sweep.rows])

    @cached_property
    def jacobian(self) -> ca.Function:
        """Z -> derivatives of the entries, and of the rows."""
        sweep = self._sweep
        return ca.Function("slopes", [sweep.z], [sweep.entry_slopes, sweep.row_slopes])

    @cached_property
    def hessian(self) -> ca.Function:
        """(z, weights of the entries, weights of the rows) -> second derivatives of the weighted sum."""
        sweep = self._sweep
        weights = [
            ca.MX.sym("entries", self.entry_count),
            ca.MX.sym("rows", sum(len(one.lower) for one in self.rows)),
        ]
        return ca.Function("curvature", [sweep.z, *weights], [ca.triu(sweep.curvature(*weights))])


def _carry(problem: Problem, kernel: Kernel, totals: Totals) -> Carry:
    sensors = totals.sensors
    return Carry(
        kernel.gathered,
        states=kernel.states,
        parameters=len(estimated(problem)) if sensors else 0,
        nuisances=sum(len(sensor.nuisances) for sensor in sensors),
        started=bool(start_nuisances(sensors, problem.system)),
    )
