"""Expressions that a search works on: terms, unknowns, judged matrices and the maximised objective."""

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
from oed.optimize.terms.matrices import stacks, symmetric_all
from oed.optimize.terms.terms import Terms

UNSOUND = 1e3
"""Share of its size by which a drive that is not finite exceeds every limit."""


class DesignExpressions:
    """Information and limits of a problem as functions of the unknowns z, and z of its drives.

    Attributes:
        problem: problem to be solved.
        terms: terms that are written out and differentiated.
        sizes: size of every information matrix.
        robots: information matrices of every robot judged, made of the symbols in `entries` (SX).
        entries: symbols for the entries of these matrices, stacked.

    Args:
        problem: problem to be solved.
        refine: points per sample at which positions are limited.
    """

    def __init__(self, problem: Problem, refine: int = 1) -> None:
        """Write the expressions."""
        self.problem = problem
        self.terms: Terms = terms_of(problem, refine)
        self.sizes = self.terms.sizes
        self.entries = ca.SX.sym("entries", self.terms.entry_count)
        count = self.terms.entry_count // len(problem.judged_systems)
        self.robots = [symmetric_all(part, self.sizes) for part in ca.vertsplit(self.entries, count)]

    @cached_property
    def coefficient_bounds(self) -> Array:
        """Bounds (k, 2) of the unknowns that are spline coefficients of the inputs."""
        return self.terms.embedding.bounds(self.ranges)

    @property
    def ranges(self) -> Array:
        """Bounds (inputs, 2) of the inputs, in units of each input's largest."""
        return np.asarray(self.problem.input_bounds / self.terms.input_scale[:, None])

    def trajectory(self, unknowns: Array) -> Trajectory:
        """Return the drive of z."""
        coefficients, starts = np.split(unknowns, [self.terms.coefficient_count])
        table = self.terms.embedding.table(coefficients * self._scales)
        return self.problem.design.trajectory(table, self.problem.starts.states(starts))

    @property
    def _scales(self) -> Array:
        # Scales (k,) of the unknowns that are spline coefficients of the inputs.
        return self.terms.embedding.spread(self.terms.input_scale)

    def unknowns_of(self, trajectory: Trajectory) -> Array:
        """Return z of a drive of this design space; the drive may have fewer knots.

        Raises:
            ValueError: the drive's splines, signals or starts are not this space's.
        """
        space = self.problem.design
        if trajectory.degree != space.stored_spline.degree or trajectory.runs != space.runs:
            raise ValueError("the trajectory's splines are not those of the design space")
        if trajectory.knots.shape != space.knots.shape or not np.allclose(trajectory.knots, space.knots):
            trajectory = trajectory.on_knots(space.run_knots)
        free = self.terms.embedding.unknowns(trajectory.coefficients) / self._scales
        return np.concatenate([free, self.problem.starts.unknowns(trajectory.starts)])

    def matrices_of(self, unknowns: Array) -> list[list[Array]]:
        """Return the information matrices of every robot judged at z."""
        return [[stack[0] for stack in matrices] for matrices in self._judge(unknowns[None, :])[0]]

    def objective(self, matrices: Sequence[Sequence[Array]]) -> Array:
        """Return the objective (...,) of the matrices (..., p, p) of every robot judged."""
        return self.problem.together([self.problem.objective.value(robot) for robot in matrices])

    @cached_property
    def scale(self) -> float:
        """Typical smallest eigenvalue of the information; the program divides by it to be of order 1."""
        rng = np.random.default_rng(0)
        low, high = np.full((2, self.terms.size), [[-1.0], [1.0]])
        low[: self.terms.coefficient_count], high[: self.terms.coefficient_count] = self.coefficient_bounds.T
        drawn = rng.uniform(low, high, (200, self.terms.size))
        coefficients = drawn[:, : self.terms.coefficient_count]
        coefficients[:] = self.terms.embedding.within(coefficients, self.ranges)
        (first, *_), _ = self._judge(drawn)
        smallest = np.min([SquareRoot.of_matrix(stack).smallest for stack in first], axis=0)
        means = [np.trace(stack, axis1=1, axis2=2) / stack.shape[1] for stack in first]
        typical = float(smallest.max())
        return typical if typical > 0 else float(np.max(means)) or 1.0

    def score_many(self, candidates: Array, threads: int = 1) -> tuple[Array, Array]:
        """Return the criterion (K,) of candidates, and their excess over each limit (K, limits).

        The excess is a share of the limit's size at the checked points, negative within the limit. It serves
        to rank candidates only: `evaluate` checks limits between the points, too.

        Args:
            candidates: unknowns, (K, size).
            threads: threads that share the work on the nominal robot; they do not change the scores.
        """
        matrices, excess = self._judge(candidates, threads)
        return self.objective(matrices), excess

    def _judge(self, candidates: Array, threads: int = 1) -> tuple[list[list[Array]], Array]:
        # Matrices (K, p, p) of every robot, and the excess over limits in shares of their size.
        entries, excess = self.terms.scored(candidates, threads)
        robots = [stacks(part.T, self.sizes) for part in np.split(entries, len(self.robots), axis=1)]
        return _finite(robots, excess)


def _finite(robots: list[list[Array]], excess: Array) -> tuple[list[list[Array]], Array]:
    # A drive that is not finite for any robot is not informative and exceeds all limits.
    parts = [excess, *(stack.reshape(len(stack), -1) for matrices in robots for stack in matrices)]
    sound = np.asarray(np.isfinite(np.concatenate(parts, axis=1)).all(axis=1, keepdims=True))
    if sound.all():
        return robots, excess
    finite = [[np.where(sound[:, :, None], stack, 0.0) for stack in matrices] for matrices in robots]
    return finite, np.where(sound, excess, UNSOUND)


@dataclass(frozen=True)
class SmoothObjective:
    """Objective of a search, as a smooth program.

    Attributes:
        maximised: scalar expression to maximise.
        variables: auxiliary unknowns, (k,).
        equalities: expressions that must vanish, (e,).
        floors: expressions that must not be negative, (f,).
        initial: function from the numeric matrices of every robot judged to the first values (k,) of the
            auxiliary unknowns.
    """

    maximised: Expression
    variables: Expression
    equalities: Expression
    floors: Expression
    initial: Callable[[Sequence[Sequence[Array]]], Array]


def smooth_objective(problem: Problem, robots: Sequence[Sequence[Expression]]) -> SmoothObjective:
    """Return the objective of a problem as a function of the matrices of every robot judged."""
    epigraphs = [problem.objective.epigraph(matrices) for matrices in robots]
    alone = len(epigraphs) == 1
    mean = alone or (problem.robust is not None and problem.robust.objective == "mean")
    objectives = ca.vertcat(*(epigraph.objective for epigraph in epigraphs))
    level = ca.SX(0, 1) if mean else ca.SX.sym("level")

    def initial(numeric: Sequence[Sequence[Array]]) -> Array:
        first = [epigraph.initial(matrices) for epigraph, matrices in zip(epigraphs, numeric, strict=True)]
        # The first level has to be finite, also where a drive has next to no information.
        positive = [] if mean else [[lifted(matrix) for matrix in matrices] for matrices in numeric]
        worst = [min(float(problem.objective.value(matrices)) for matrices in positive)] if positive else []
        return np.concatenate([worst, *first])

    return SmoothObjective(
        maximised=ca.sum1(objectives) / len(epigraphs) if mean else level,
        variables=ca.vertcat(level, *(epigraph.variables for epigraph in epigraphs)),
        equalities=ca.vertcat(*(epigraph.equalities for epigraph in epigraphs)),
        floors=ca.vertcat(
            *(epigraph.floors for epigraph in epigraphs), ca.SX(0, 1) if mean else objectives - level
        ),
        initial=initial,
    )
