"""Drives of many samples, searched on fewer: much faster, and corrected to agree with all of them.

The splines have far fewer coefficients than the drive has samples, so a coarser grid tells nearly as much of
them. What it tells otherwise than the fine grid is added to its information as a constant, found anew at
every design on which a search ends, until both grids agree there [defect correction; Stetter, "The defect
correction principle and discretization methods", Numerische Mathematik 29, 1978].
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import casadi as ca
import numpy as np
import numpy.typing as npt

from oed.evaluation import Evaluation, evaluate
from oed.expression import Expression
from oed.problem import Problem
from oed.solvers.design import DesignExpressions
from oed.solvers.starts import random_drives
from oed.solvers.terms import symmetric
from oed.trajectory import Trajectory

Array = npt.NDArray[np.float64]

MOST = 400
"""Samples per run up to which all of them are searched on."""
PER_COEFFICIENT = 12
"""Samples that a spline coefficient needs for a coarse grid to see its shape."""


def coarse_samples(problem: Problem) -> int:
    """Samples per run of the grid to search on: a divisor of the drive's, where there is a good one."""
    space = problem.design
    most = max(MOST, PER_COEFFICIENT * space.spline.coefficients)
    if space.samples <= most:
        return space.samples
    divisors = [count for count in range(most // 2, most + 1) if space.samples % count == 0]
    return divisors[-1] if divisors else most


def coarsened(problem: Problem, samples: int) -> Problem:
    """The problem on so many samples per run; itself where its measurement or criterion needs all of them."""
    space = problem.design
    measurement = problem.measurement.coarser(space.samples / samples)
    if measurement is None or samples >= space.samples or len(problem.judged_robots) > 1:
        return problem
    return replace(problem, measurement=measurement, design=space.model_copy(update={"samples": samples}))


class Grid:
    """The samples that a search looks at, and how what they tell is made to agree with all samples.

    Attributes:
        problem: to be solved.
        design: its expressions on the grid.
        corrections: symbols for what is added to the information, (e,); none where all samples are looked at.
    """

    def __init__(self, problem: Problem, samples: int | None = None) -> None:
        """Choose the grid, or take one of so many samples per run."""
        self.problem = problem
        own = coarsened(problem, coarse_samples(problem) if samples is None else samples)
        self.coarse = own is not problem
        self.design = DesignExpressions(own)
        sizes = self.design.sizes if self.coarse else []
        self._counts = [size * (size + 1) // 2 for size in sizes]
        self.corrections = ca.SX.sym("corrections", sum(self._counts))

    @cached_property
    def _shares(self) -> list[float]:
        # How much more all samples tell than the grid's, of a typical drive: more readings, for instance.
        if not self.coarse:
            return [1.0] * len(self.design.sizes)
        (drive,) = random_drives(self.design, np.array([0.5]), np.random.default_rng(0))
        told = evaluate(self.problem, self.trajectory(drive)).information.values()
        seen = self.design.matrices_of(drive)[0]
        return [float(np.trace(one) / np.trace(other)) for one, other in zip(told, seen, strict=True)]

    def corrected(self, matrices: list[Expression]) -> list[Expression]:
        """The expressions of a robot's matrices, in proportion to all samples and corrected."""
        if not self.coarse:
            return matrices
        edges = np.cumsum([0, *self._counts]).tolist()
        return [
            share * matrix + symmetric(self.corrections[first:last], matrix.shape[0])
            for share, matrix, first, last in zip(self._shares, matrices, edges[:-1], edges[1:], strict=True)
        ]

    def matrices_of(self, unknowns: Array, corrections: Array) -> list[list[Array]]:
        """The matrices of every robot judged at z, with corrections (e,)."""
        found = self.design.matrices_of(unknowns)
        if not self.coarse:
            return found
        parts = np.split(corrections, np.cumsum(self._counts)[:-1])
        return [
            [
                share * matrix + full(part, len(matrix))
                for share, matrix, part in zip(self._shares, own, parts, strict=True)
            ]
            for own in found
        ]

    def correction(self, unknowns: Array, evaluation: Evaluation) -> Array:
        """Corrections (e,) with which the grid tells at z just what all samples tell."""
        if not self.coarse:
            return np.zeros(0)
        seen, told = self.design.matrices_of(unknowns)[0], evaluation.information.values()
        gaps = [one - share * other for one, share, other in zip(told, self._shares, seen, strict=True)]
        return np.concatenate([gap.T[np.tril_indices(len(gap))] for gap in gaps])

    def trajectory(self, unknowns: Array) -> Trajectory:
        """The drive that z stands for, of all samples."""
        return replace(self.design.trajectory(unknowns), samples=self.problem.design.all_samples)


def full(entries: Array, size: int) -> Array:
    """The symmetric matrix (p, p) with these entries on and above its diagonal, column by column."""
    matrix = np.empty((size, size))
    columns, rows = np.tril_indices(size)
    matrix[rows, columns] = matrix[columns, rows] = entries
    return matrix
