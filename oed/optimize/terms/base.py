"""What a search asks of a drive again and again, whoever computes it: information, limits, derivatives."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array, Places
from oed.kernel.dynamics.embedding import Bounding, Embedding
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.rollout import Drive, roll_out
from oed.kernel.problem import Problem
from oed.optimize.terms.instants import InstantRows
from oed.optimize.terms.row_bounds import RowBounds
from oed.optimize.terms.slots import Slots
from oed.optimize.terms.small_drives import splines_of


@dataclass(frozen=True)
class Functions:
    """A search's functions of z, and of the numbers that say which rows the slots are of, if there are any.

    Attributes:
        values: (z, numbers) -> entries of the matrices, rows, those of the slots behind all others.
        jacobian: (z, numbers) -> derivatives of the entries (dense), and of the rows.
        hessian: (z, numbers, weights of the entries, of the rows) -> second derivatives of the weighted sum,
            on and above the diagonal.
    """

    values: ca.Function
    jacobian: ca.Function
    hessian: ca.Function


class Terms(ABC):
    """Information and limit rows of a problem's drives as functions of the unknowns z.

    The unknowns are those of the inputs (free spline coefficients, or what signals have), in units of each
    input's largest speed, and the start states where they are free. Positions are limited at `refine` points
    per sample.

    Limits on instants have no rows but those of instants that are given with each call, in slots; of all
    other limits there are all rows.

    Attributes:
        size: of z; the first `coefficient_count` are of the inputs.
        embedding: how these become coefficients.
        unknowns: z (SX), for what is written around the terms.
    """

    def __init__(self, problem: Problem, refine: int) -> None:
        """Name the unknowns."""
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

    @property
    @abstractmethod
    def sizes(self) -> list[int]:
        """The size of every information matrix."""

    @property
    @abstractmethod
    def rows(self) -> list[RowBounds]:
        """Bounds of every limit's rows, without rows that no unknown moves; none of limits on instants."""

    @property
    @abstractmethod
    def linear(self) -> list[bool]:
        """Linearity in z of each limit's rows."""

    @abstractmethod
    def scored(self, candidates: Array, threads: int = 1) -> tuple[Array, Array]:
        """Return the entries (K, e) of candidates (K, size), and the most by which each limit is exceeded at
        the points looked at, in shares of its size, below 0 within it (K, limits).

        Args:
            candidates: unknowns, (K, size).
            threads: that share the work; their number changes no digit.
        """

    @property
    @abstractmethod
    def written(self) -> int:
        """Operations that generated C of the scores writes out."""

    @property
    @abstractmethod
    def instants(self) -> InstantRows:
        """The rows of an instant."""

    def slots(self, count: int) -> Slots:
        """So many slots for rows of instants."""
        return Slots(self.instants, self.embedding, count)

    @abstractmethod
    def functions(self, slots: int = 0) -> Functions:
        """The terms' functions, with so many slots for rows of instants."""

    @property
    def values(self) -> ca.Function:
        """The function `values` without slots."""
        return self.functions().values

    @property
    def jacobian(self) -> ca.Function:
        """The function `jacobian` without slots."""
        return self.functions().jacobian

    @property
    def hessian(self) -> ca.Function:
        """The function `hessian` without slots."""
        return self.functions().hessian

    @property
    def entry_count(self) -> int:
        """Entries of all matrices together."""
        return sum(size * (size + 1) // 2 for size in self.sizes)

    @cached_property
    def bounded_unknowns(self) -> tuple[Places, Places, Array, Array]:
        """Rows that are a constant plus a multiple of a single unknown: those rows, the unknowns, the
        multiples, the constants.
        """
        nothing = np.zeros(self.size)
        slope = self.jacobian(nothing)[1]
        rows, columns = (np.array(part, dtype=int) for part in slope.sparsity().get_triplet())
        counts = np.array([len(limit.lower) for limit in self.rows], dtype=int)
        linear = np.repeat(np.array(self.linear, dtype=bool), counts)
        single = np.flatnonzero(linear & (np.bincount(rows, minlength=len(linear)) == 1))
        # The place of each row's last entry, which is its only one where it is single.
        place = np.zeros(len(linear), dtype=int)
        place[rows] = np.arange(len(rows))
        entry = place[single]
        constants = np.array(self.values(nothing)[1]).ravel()[single]
        return single, columns[entry], np.array(slope.nonzeros())[entry], constants
