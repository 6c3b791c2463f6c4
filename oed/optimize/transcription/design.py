"""What a search works on: a problem's terms, its unknowns, the matrices judged, and what it maximises."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.kernel.criteria.criterion import lifted
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.measurement.square_root import SquareRoot
from oed.kernel.problem import Problem
from oed.optimize.terms import terms_of
from oed.optimize.terms.base import Terms
from oed.optimize.terms.matrices import stacks, symmetric_all
from oed.optimize.terms.unrolled import OtherRobots, Unrolled

UNSOUND = 1e3
"""Share of its size by which a drive that is not finite exceeds every limit."""


class DesignExpressions:
    """A problem's information and limits as functions of the unknowns z, and z of its drives.

    Attributes:
        terms: what is written out and differentiated.
        robots: for every robot judged its matrices, of symbols that stand for their numbers (SX).
        entries: those symbols, stacked.
    """

    def __init__(self, problem: Problem, refine: int = 1) -> None:
        """Write the expressions; positions are limited at `refine` points per sample."""
        self.problem = problem
        self.terms: Terms = terms_of(problem, refine)
        self.sizes = self.terms.sizes
        count = self.terms.entry_count
        symbols = [ca.SX.sym("entries", count) for _ in problem.judged_systems]
        self.entries = ca.vertcat(*symbols)
        self.robots = [symmetric_all(own, self.sizes) for own in symbols]

    @cached_property
    def coefficient_bounds(self) -> Array:
        """Bounds (k, 2) of those unknowns that are of the inputs."""
        return self.terms.embedding.bounds(self.ranges)

    @property
    def ranges(self) -> Array:
        """Bounds (inputs, 2) of the inputs, in units of each input's largest."""
        return np.asarray(self.problem.input_bounds / self.terms.input_scale[:, None])

    @cached_property
    def others(self) -> list[tuple[int, Array, Array]]:
        """Robots judged that are not the nominal one: place, parameters (p,), shift of the start states."""
        nominal = np.array(self.problem.system.nominal)
        return [
            (place, parameters, shift)
            for place, (parameters, shift) in enumerate(self.problem.judged_systems)
            if shift.any() or not np.array_equal(parameters, nominal)
        ]

    @cached_property
    def other_robots(self) -> OtherRobots:
        """The information of other robots than the nominal one."""
        assert isinstance(self.terms, Unrolled)
        return OtherRobots(self.problem, self.terms)

    def trajectory(self, unknowns: Array) -> Trajectory:
        """The drive that z stands for."""
        own, chosen = unknowns[: self.terms.coefficient_count], self.problem.chosen_starts
        table = self.terms.embedding.table(own * self._scales)
        if chosen is None:
            assert self.problem.fixed_starts is not None
            return self.problem.design.trajectory(table, self.problem.fixed_starts)
        return self.problem.design.trajectory(table, chosen.states(unknowns[len(own) :]))

    @property
    def _scales(self) -> Array:
        # Of those unknowns that are of the inputs.
        return self.terms.embedding.spread(self.terms.input_scale)

    def unknowns_of(self, trajectory: Trajectory) -> Array:
        """Z of a drive of this design space, be it of fewer knots.

        Raises:
            ValueError: the drive's splines, signals or starts are not this space's.
        """
        space, chosen = self.problem.design, self.problem.chosen_starts
        if trajectory.degree != space.own_spline.degree or trajectory.runs != space.runs:
            raise ValueError("the trajectory's splines are not those of the design space")
        if trajectory.knots.shape != space.knots.shape or not np.allclose(trajectory.knots, space.knots):
            trajectory = trajectory.on_knots(space.own_knots)
        free = self.terms.embedding.unknowns(trajectory.coefficients) / self._scales
        start = np.zeros(0) if chosen is None else chosen.unknowns(trajectory.starts)
        return np.concatenate([free, start])

    def matrices_of(self, unknowns: Array) -> list[list[Array]]:
        """The information matrices of every robot judged, for one z."""
        return [[stack[0] for stack in own] for own in self._judged(unknowns[None, :])[0]]

    def objective(self, matrices: Sequence[Sequence[Array]]) -> Array:
        """The objective (...,) of the matrices (..., p, p) of every robot judged."""
        return self.problem.together([self.problem.objective.value(own) for own in matrices])

    @cached_property
    def scale(self) -> float:
        """A typical lambda_min of the information: divides it in the program, so that it is of order 1."""
        rng = np.random.default_rng(0)
        low, high = np.full((2, self.terms.size), [[-1.0], [1.0]])
        low[: self.terms.coefficient_count], high[: self.terms.coefficient_count] = self.coefficient_bounds.T
        drawn = rng.uniform(low, high, (200, self.terms.size))
        own = drawn[:, : self.terms.coefficient_count]
        own[:] = self.terms.embedding.within(own, self.ranges)
        (first, *_), _ = self._judged(drawn)
        smallest = np.min([SquareRoot.of_matrix(stack).smallest for stack in first], axis=0)
        means = [np.trace(stack, axis1=1, axis2=2) / stack.shape[1] for stack in first]
        typical = float(smallest.max())
        return typical if typical > 0 else float(np.max(means)) or 1.0

    def score_many(self, candidates: Array) -> tuple[Array, Array]:
        """Criterion (K,) and relative violation of each limit (K, limits) of candidates (K, size).

        For ranking candidates only: it looks at limits at the samples, `evaluate` between them too.
        """
        values, excess = self.measure_many(candidates)
        return values, np.maximum(0.0, excess)

    def measure_many(self, candidates: Array, threads: int = 1) -> tuple[Array, Array]:
        """Criterion (K,) of candidates (K, size), and by how much they exceed each limit at the points
        looked at, in shares of its size, below 0 within it (K, limits).

        Args:
            candidates: (K, size).
            threads: that share the nominal robot's scores; their number changes none of them.
        """
        matrices, excess = self._judged(candidates, threads)
        return self.objective(matrices), excess

    def _judged(self, candidates: Array, threads: int = 1) -> tuple[list[list[Array]], Array]:
        # For every robot its matrices (K, p, p); by how much limits are exceeded, in shares of their size.
        count = len(candidates)
        nominal, excess = self.terms.scored(candidates, threads)
        found = [stacks(nominal.T, self.sizes)] * len(self.robots)
        for place, parameters, shift in self.others:
            other = self.other_robots.values.map("robots", "serial", count, [1, 2], [])
            found[place] = stacks(np.array(other(candidates.T, parameters, shift)), self.sizes)
        return _finite(found, excess)


def _finite(robots: list[list[Array]], excess: Array) -> tuple[list[list[Array]], Array]:
    # A drive that is not finite is not informative and exceeds all limits, whatever robot it is of.
    parts = [excess, *(stack.reshape(len(stack), -1) for own in robots for stack in own)]
    sound = np.asarray(np.isfinite(np.concatenate(parts, axis=1)).all(axis=1, keepdims=True))
    if sound.all():
        return robots, excess
    kept = [[np.where(sound[:, :, None], stack, 0.0) for stack in own] for own in robots]
    return kept, np.where(sound, excess, UNSOUND)


@dataclass(frozen=True)
class Objective:
    """What a search maximises, as smooth optimisation.

    Attributes:
        maximised: scalar expression.
        variables: auxiliary unknowns, (k,).
        equalities: expressions that must vanish, (e,).
        floors: expressions that must not be negative, (f,).
        initial: values (k,) of the auxiliary unknowns for the numeric matrices of every robot judged.
    """

    maximised: Expression
    variables: Expression
    equalities: Expression
    floors: Expression
    initial: Callable[[Sequence[Sequence[Array]]], Array]


def objective_of(problem: Problem, robots: Sequence[Sequence[Expression]]) -> Objective:
    """A problem's objective, of the matrices of each robot judged."""
    each = [problem.objective.epigraph(matrices) for matrices in robots]
    alone = len(each) == 1
    mean = alone or (problem.robust is not None and problem.robust.objective == "mean")
    objectives = ca.vertcat(*(one.objective for one in each))
    level = ca.SX(0, 1) if mean else ca.SX.sym("level")

    def initial(numeric: Sequence[Sequence[Array]]) -> Array:
        begun = [one.initial(matrices) for one, matrices in zip(each, numeric, strict=True)]
        # A level from which to begin is finite, also where a drive has next to no information.
        positive = [] if mean else [[lifted(matrix) for matrix in matrices] for matrices in numeric]
        worst = [min(float(problem.objective.value(matrices)) for matrices in positive)] if positive else []
        return np.concatenate([worst, *begun])

    return Objective(
        maximised=ca.sum1(objectives) / len(each) if mean else level,
        variables=ca.vertcat(level, *(one.variables for one in each)),
        equalities=ca.vertcat(*(one.equalities for one in each)),
        floors=ca.vertcat(*(one.floors for one in each), ca.SX(0, 1) if mean else objectives - level),
        initial=initial,
    )
