"""Drives of many samples, searched on fewer: much faster, and corrected to agree with all of them.

The splines have far fewer coefficients than the drive has samples, so a coarser grid is nearly as informative
about them. What it has otherwise than the fine grid is added to its information: a difference and its slope,
found anew at every design on which a search ends, until both grids agree there. A design at which they do is
optimal on the fine grid as well, for values and slopes are then the same [first-order model management;
Alexandrov et al., "Approximation and model management in aerodynamic optimization with variable-fidelity
models", Journal of Aircraft 38, 2001].
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
from oed.kernel.dynamics.rollout import any_drive
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.problem import Problem
from oed.optimize.terms.matrices import stacks, symmetric_all, upper_half
from oed.optimize.transcription.design import DesignExpressions
from oed.optimize.transcription.starting_points import random_drives


class Grid:
    """The samples that a search looks at; their information is made to agree with that of all samples.

    Attributes:
        problem: to be solved.
        design: its expressions on the grid.
        coarse: whether that looks at fewer samples than there are.
        corrections: symbols for what is added to the information and for its slopes, (e + e n,) for e entries
            and n unknowns; none where all samples are looked at.
    """

    def __init__(self, problem: Problem, samples: int | None = None, refine: int = 1) -> None:
        """Choose the grid, or take one of so many samples per run; positions are limited at `refine` points
        per sample.
        """
        self.problem = problem
        # Corrections are of one robot.
        alone = len(problem.judged_systems) == 1
        own = coarsened(problem, coarse_samples(problem, samples)) if alone else problem
        self.coarse = own is not problem
        self.design = DesignExpressions(own, refine)
        self._entries = sum(size * (size + 1) // 2 for size in self.design.sizes)
        self.corrections = ca.SX.sym("corrections", self.no_correction.size)

    @property
    def no_correction(self) -> Array:
        """Corrections that change nothing."""
        return np.zeros(self._entries * (1 + self.design.terms.size) if self.coarse else 0)

    @cached_property
    def _shares(self) -> Array:
        # For every entry, how much more information all samples have than the grid's, of a typical drive:
        # more readings, for instance.
        (drive,) = random_drives(self.design, np.array([0.5]), np.random.default_rng(0))
        whole = stacks(self._fine.entries(self.trajectory(drive))[:, None], self.design.sizes)
        own = self.design.matrices_of(drive)[0]
        return np.concatenate(
            [
                np.full(len(one) * (len(one) + 1) // 2, np.trace(all_[0]) / np.trace(one))
                for all_, one in zip(whole, own, strict=True)
            ]
        )

    @property
    def robots(self) -> list[list[Expression]]:
        """The matrices of every robot judged (SX), in proportion to all samples and corrected."""
        if not self.coarse:
            return self.design.robots
        added = self._added(self.corrections, self.design.terms.unknowns)
        return [symmetric_all(ca.DM(self._shares) * self.design.entries + added, self.design.sizes)]

    def matrices_of(self, unknowns: Array, corrections: Array) -> list[list[Array]]:
        """The matrices of every robot judged at z, with corrections."""
        if not self.coarse:
            return self.design.matrices_of(unknowns)
        own, _ = self.design.terms.values(unknowns)
        entries = self._shares * np.array(own).ravel() + np.array(self._added(corrections, unknowns)).ravel()
        if not np.isfinite(entries).all():
            # As of any drive that is not finite.
            entries = np.zeros_like(entries)
        return [[stack[0] for stack in stacks(entries[:, None], self.design.sizes)]]

    def _added(self, corrections: Any, unknowns: Any) -> Expression:
        # To every entry: a constant, and a slope for each unknown.
        slopes = ca.reshape(corrections[self._entries :], self._entries, self.design.terms.size)
        return corrections[: self._entries] + slopes @ unknowns

    def correction(self, unknowns: Array) -> Array:
        """Corrections with which the grid has, at z and close to it, the information of all samples."""
        if not self.coarse:
            return self.no_correction
        own, _ = self.design.terms.values(unknowns)
        own_slopes, _ = self.design.terms.jacobian(unknowns)
        whole, whole_slopes = self._fine.at(self.trajectory(unknowns))
        shares = self._shares
        gaps = whole - shares * np.array(own).ravel()
        slopes = whole_slopes - shares[:, None] * np.array(own_slopes)
        return np.concatenate([gaps - slopes @ unknowns, slopes.ravel(order="F")])

    @cached_property
    def _fine(self) -> FineGrid:
        return FineGrid(self.problem, self.design)

    def trajectory(self, unknowns: Array) -> Trajectory:
        """The drive that z stands for, of all samples."""
        return replace(self.design.trajectory(unknowns), samples=self.problem.design.all_samples)


class FineGrid:
    """The information of all samples, and its slopes by the unknowns z.

    Written compactly, with one backward sweep for every entry of the information: memory is in proportion
    to the samples.
    """

    def __init__(self, problem: Problem, design: DesignExpressions) -> None:
        """Write the expressions and compile them."""
        self._design, space, robot = design, problem.design, problem.system
        self._sampled = space.sampling_matrix[:, space.free_rows]
        symbols, drive = any_drive(robot, space.all_samples, space.runs)
        inputs, start, *_ = symbols
        entries = ca.vertcat(*(upper_half(one.matrix) for one in problem.estimations(drive)))
        weights = ca.MX.sym("weights", entries.shape[0])
        slopes = ca.jtimes(entries, ca.vertcat(ca.vec(inputs), ca.vec(start)), weights, True)
        self._known = [robot.nominal, space.period]
        self._values = ca.Function("fine", symbols, [entries])
        self._slopes = ca.Function("fine_slopes", [*symbols, weights], [slopes])

    def entries(self, drive: Trajectory) -> Array:
        """Entries (e,) of the information."""
        return np.array(self._values(drive.inputs, drive.starts, *self._known)).ravel()

    def at(self, drive: Trajectory) -> tuple[Array, Array]:
        """Entries (e,) of the information, and their derivatives (e, n) by z."""
        entries = self.entries(drive)
        rows = [
            self._by_unknowns(np.array(self._slopes(drive.inputs, drive.starts, *self._known, one)).ravel())
            for one in np.eye(len(entries))
        ]
        return entries, np.array(rows)

    def _by_unknowns(self, slope: Array) -> Array:
        # By the chain rule from the held inputs and start states.
        samples, columns = len(self._sampled), len(self._design.terms.input_scale)
        by_inputs = slope[: samples * columns].reshape((samples, columns), order="F")
        by_coefficients = (self._sampled.T @ by_inputs) * self._design.terms.input_scale
        parts = [by_coefficients.ravel(order="F")]
        chosen = self._design.problem.chosen_starts
        if chosen is not None:
            runs = self._design.problem.design.runs
            by_start = slope[samples * columns :].reshape((runs, -1), order="F")
            parts.append(chosen.by_unknowns(by_start))
        return np.concatenate(parts)
