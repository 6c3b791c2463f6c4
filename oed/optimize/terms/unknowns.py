"""The unknowns of a search, and the inputs and starts of its drives as functions of them."""

from __future__ import annotations

from functools import cached_property

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.kernel.dynamics.embedding import Bounding, Embedding
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.rollout import Drive, roll_out
from oed.kernel.problem import Problem
from oed.optimize.terms.small_drives import splines_of


class Unknowns:
    """The unknowns z of a problem's drives.

    They are those of the inputs (free spline coefficients, or what signals have), in units of each input's
    largest speed, then the start states where they are free.

    Attributes:
        problem: problem with the drives.
        refine: points per sample at which limits on the path are checked.
        size: number of unknowns; the first `coefficient_count` are of the inputs.
        embedding: how these become coefficients.
        input_scale: what an input of 1 stands for, (inputs,).
        unknowns: z (SX), for what is written around the terms.
    """

    def __init__(self, problem: Problem, refine: int = 1) -> None:
        """Name the unknowns.

        Args:
            problem: problem with the drives.
            refine: points per sample at which limits on the path are checked.
        """
        space = problem.design
        self.problem, self.refine = problem, refine
        self.input_scale = np.abs(problem.input_bounds).max(axis=1)
        self.embedding = Embedding(space, len(problem.model.inputs))
        self.coefficient_count = self.embedding.size
        self.size = self.coefficient_count + problem.starts.size
        self.unknowns: Expression = ca.SX.sym("z", self.size)

    @cached_property
    def drive(self) -> Drive:
        """The drive of the nominal robot, written out (SX of `unknowns`)."""
        space, robot = self.problem.design, self.problem.system
        drive = roll_out(
            robot,
            inputs=self.held,
            start=self.starts,
            parameters=ca.SX(ca.DM(robot.nominal)),
            period=ca.SX(space.period),
            refine=self.refine,
            runs=space.runs,
        )
        return splines_of(drive, self.bounding)

    @property
    def _inputs_unknowns(self) -> Expression:
        # In the inputs' units.
        return self.unknowns[: self.coefficient_count, 0] * ca.DM(self.embedding.spread(self.input_scale))

    @property
    def held(self) -> Expression:
        """Inputs held in each period (SX of `unknowns`), (N, inputs)."""
        return self.embedding.held_inputs(self._inputs_unknowns)

    @cached_property
    def bounding(self) -> Bounding:
        """Expressions that bound the inputs and their derivatives at all times (SX of `unknowns`)."""
        return self.embedding.bounding(self._inputs_unknowns)

    @property
    def own_bounds(self) -> Array:
        """Bounds (size, 2) that the design space sets on z; infinite where it sets none."""
        unbounded = np.tile([-np.inf, np.inf], (self.coefficient_count, 1))
        return np.concatenate([unbounded, self.problem.starts.bounds])

    @property
    def starts(self) -> Expression:
        """Start states of the runs (SX of `unknowns`), (runs, states)."""
        return self.problem.starts.expressed(self.unknowns[self.coefficient_count :])

    @cached_property
    def start_slopes(self) -> Array:
        """Derivatives of the start states of the runs by z, (runs, states, size)."""
        slopes = ca.evalf(ca.jacobian(ca.vec(self.starts.T), self.unknowns))
        return np.array(slopes).reshape(*self.starts.shape, self.size)
