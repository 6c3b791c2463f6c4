"""Drives of many samples, searched on fewer: much faster, and corrected to agree with all of them.

The splines have far fewer coefficients than the drive has samples, so a coarser grid is nearly as informative
about them. A correction is added to its information: the difference to the fine grid and the slope of that
difference, updated at every design on which a search ends, until both grids agree there. Such a design is
optimal on the fine grid as well, for values and slopes are equal [first-order model management; Alexandrov et
al., "Approximation and model management in aerodynamic optimization with variable-fidelity models", Journal
of Aircraft 38, 2001].
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.kernel.coarser import coarse_samples, coarsened
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.problem import Problem
from oed.optimize.terms import terms_of
from oed.optimize.terms.matrices import stacks, symmetric_all
from oed.optimize.terms.terms import Terms
from oed.optimize.transcription.design import DesignExpressions
from oed.optimize.transcription.starting_points import random_drives


class SearchGrid:
    """Samples that a search uses; their information is corrected to agree with that of all samples.

    Attributes:
        problem: problem to be solved.
        design: expressions of the problem on the grid.
        coarse: True where the grid has fewer samples than the problem.
        corrections: symbols of the constants and slopes that are added to the information, (e + e n,) for e
            entries and n unknowns; (0,) for a grid of all samples.

    Args:
        problem: problem to be solved.
        samples: samples per run; by default the grid is chosen.
        refine: points per sample at which positions are limited.
    """

    def __init__(self, problem: Problem, samples: int | None = None, refine: int = 1) -> None:
        """Choose the grid and write the expressions."""
        self.problem = problem
        # Corrections are made for a single robot.
        alone = len(problem.judged_systems) == 1
        searched = coarsened(problem, coarse_samples(problem, samples)) if alone else problem
        self.coarse = searched is not problem
        self.design = DesignExpressions(searched, refine)
        self._entries = sum(size * (size + 1) // 2 for size in self.design.sizes)
        self.corrections = ca.SX.sym("corrections", self.no_correction.size)

    @property
    def no_correction(self) -> Array:
        """Corrections that change nothing."""
        return np.zeros(self._entries * (1 + self.design.terms.size) if self.coarse else 0)

    @cached_property
    def _shares(self) -> Array:
        # Ratio of the information of all samples to that of the grid, for every entry, on a typical drive.
        (drive,) = random_drives(self.design, np.array([0.5]), np.random.default_rng(0))
        fine = stacks(self._fine.at(drive).entries[:, None], self.design.sizes)
        coarse = self.design.matrices_of(drive)[0]
        ratios = [np.trace(stack[0]) / np.trace(matrix) for stack, matrix in zip(fine, coarse, strict=True)]
        return np.repeat(ratios, [len(matrix) * (len(matrix) + 1) // 2 for matrix in coarse])

    @property
    def robots(self) -> list[list[Expression]]:
        """Information matrices of every robot judged (SX), scaled to all samples and corrected."""
        if not self.coarse:
            return self.design.robots
        added = self._added(self.corrections, self.design.terms.unknowns)
        return [symmetric_all(ca.DM(self._shares) * self.design.entries + added, self.design.sizes)]

    def matrices_of(self, unknowns: Array, corrections: Array) -> list[list[Array]]:
        """Return the information matrices of every robot judged at z, with corrections."""
        if not self.coarse:
            return self.design.matrices_of(unknowns)
        added = np.array(self._added(corrections, unknowns)).ravel()
        entries = self._shares * self.design.terms.at(unknowns).entries + added
        if not np.isfinite(entries).all():
            # Every drive that is not finite counts as uninformative.
            entries = np.zeros_like(entries)
        return [[stack[0] for stack in stacks(entries[:, None], self.design.sizes)]]

    def _added(self, corrections: Any, unknowns: Any) -> Expression:
        # Every entry is corrected by a constant and by a slope for each unknown.
        slopes = ca.reshape(corrections[self._entries :], self._entries, self.design.terms.size)
        return corrections[: self._entries] + slopes @ unknowns

    def correction(self, unknowns: Array) -> Array:
        """Return corrections that give the grid, at z and to first order, the information of all samples."""
        if not self.coarse:
            return self.no_correction
        coarse, fine, shares = self.design.terms.at(unknowns), self._fine.at(unknowns), self._shares
        gaps = fine.entries - shares * coarse.entries
        slopes = fine.entry_slopes - shares[:, None] * coarse.entry_slopes
        return np.concatenate([gaps - slopes @ unknowns, slopes.ravel(order="F")])

    @cached_property
    def _fine(self) -> Terms:
        # All samples, of the same unknowns.
        return terms_of(self.problem)

    def trajectory(self, unknowns: Array) -> Trajectory:
        """Return the drive of z, with all samples."""
        return replace(self.design.trajectory(unknowns), samples=self.problem.design.all_samples)
