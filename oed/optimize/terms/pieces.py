"""Terms from pieces: one short piece of the drive is written and differentiated, and serves for all of them.

Building them takes as long for many samples as for few, and a piece has few unknowns of its own, so its
derivatives are short.
"""

from __future__ import annotations

from functools import cached_property
from math import lcm

import casadi as ca

from oed.kernel.limit import InputLimit, Limit, PathLimit
from oed.kernel.measurement.sensor import start_nuisances
from oed.kernel.problem import Problem
from oed.optimize.terms.base import RowBounds, Terms
from oed.optimize.terms.carry import Carry
from oed.optimize.terms.cell import Cell, estimated, segment_length
from oed.optimize.terms.kernel import Kernel
from oed.optimize.terms.layout import Layout, best_layout
from oed.optimize.terms.link import Link
from oed.optimize.terms.passes import Plan, Sweep
from oed.optimize.terms.piece_rows import PieceRows
from oed.optimize.terms.totals import Sum, Totals
from oed.robots.limits.body_motion import BodySpeed, LateralAcceleration, TurningRadius, YawRate
from oed.robots.sensors.displacements import Displacements
from oed.robots.sensors.several import sensors_of

PER_SAMPLE: tuple[type[Limit], ...] = (PathLimit, BodySpeed, YawRate, LateralAcceleration, TurningRadius)
"""Limits that hold for every sample by itself."""


def divisible(problem: Problem) -> Layout | None:
    """How the problem's drives are cut into pieces; None where they have to be written out as a whole.

    That is so for robust limits and other robots, limits that look at a whole run (its length, its end),
    noise that readings share over time, segments of unequal length, and samples without a suitable divisor.
    """
    if problem.robust is not None:
        return None
    if not all(isinstance(limit, (InputLimit, *PER_SAMPLE)) for limit in problem.limits):
        return None
    space, measurement, inputs = problem.design, problem.measurement, len(problem.robot.inputs)
    if isinstance(measurement, Displacements):
        segments = measurement.segment_count(space.samples)
        if measurement.noise_model != "increments" or space.samples % segments:
            return None
        length = segment_length(problem)
        return best_layout(space, inputs, divisor=None if length == 1 else length)
    sensors = sensors_of(measurement)
    if not sensors or any(one.joint_whitening is not None for one in sensors):
        return None
    return best_layout(space, inputs, multiple=lcm(*(one.every for one in sensors)))


class Pieces(Terms):
    """Information and limit rows put together from pieces of the drive."""

    def __init__(self, problem: Problem, layout: Layout, refine: int = 1) -> None:
        """Write a piece and what joins the pieces; functions are compiled when first used."""
        super().__init__(problem, refine)
        limits = [limit for limit in problem.limits if not isinstance(limit, InputLimit)]
        cell, totals = Cell(problem, limits, self.input_scale.tolist(), refine), Totals(problem, layout)
        every = [sensor.every for sensor in totals.sensors]
        kernel = Kernel(cell, layout, every)
        link = Link(kernel, _carry(problem, kernel, totals))
        rows = PieceRows(problem, layout, cell, self.unknowns, self._coefficients())
        total = Sum(totals, link.added)
        self._plan = Plan(problem, layout, kernel, link, total, rows, self.size, self.coefficient_count)

    @cached_property
    def _sweep(self) -> Sweep:
        return Sweep(self._plan)

    @property
    def sizes(self) -> list[int]:
        """The size of every matrix."""
        return self._plan.total.sizes

    @property
    def rows(self) -> list[RowBounds]:
        """Bounds of every limit's rows."""
        return self._plan.rows.bounds

    @property
    def linear(self) -> list[bool]:
        """Whether each limit's rows are linear in z."""
        return self._plan.rows.linear

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
        kernel.told,
        states=kernel.states,
        parameters=len(estimated(problem)) if sensors else 0,
        nuisances=sum(len(sensor.nuisances) for sensor in sensors),
        started=bool(start_nuisances(sensors, problem.robot)),
    )
