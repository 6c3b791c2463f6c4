"""What a search asks of a drive again and again, whoever computes it: information, limits, derivatives."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array, Bools, Places
from oed.kernel.dynamics.embedding import DIGITS, Bounding, embedding_of
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.rollout import Drive, roll_out
from oed.kernel.limit import Rows
from oed.kernel.problem import Problem


@dataclass(frozen=True)
class RowBounds:
    """One limit's rows without their expression: bounds (rows,), size and unit as in `Rows`."""

    lower: Array
    upper: Array
    size: float
    unit: str


class Terms(ABC):
    """Information and limit rows of a problem's drives as functions of the unknowns z.

    The unknowns are those of the inputs (free spline coefficients, or what signals have), in units of each
    input's largest speed, and the start states where they are free. Positions are limited at `refine` points
    per sample.

    Attributes:
        size: of z; the first `coefficient_count` are of the inputs.
        embedding: how these become coefficients.
        unknowns: z (SX), for what is written around the terms.
    """

    def __init__(self, problem: Problem, refine: int = 1) -> None:
        """Name the unknowns."""
        space = problem.design
        self.problem, self.refine = problem, refine
        self.input_scale = np.abs(problem.input_bounds).max(axis=1)
        self.embedding = embedding_of(space, len(problem.model.inputs))
        self.coefficient_count, chosen = self.embedding.size, problem.chosen_starts
        self.size = self.coefficient_count + (0 if chosen is None else chosen.size)
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
        return self.unknowns[: self.coefficient_count] * ca.DM(self.embedding.spread(self.input_scale))

    @property
    def coefficients(self) -> Expression:
        """Coefficients of all splines (SX of `unknowns`), (n, inputs)."""
        return self.embedding.expressed(self._inputs_unknowns)

    @property
    def held(self) -> Expression:
        """Inputs held in each period (SX of `unknowns`), (N, inputs)."""
        return self.embedding.held(self.coefficients)

    @cached_property
    def bounding(self) -> Bounding:
        """What bounds the inputs and their derivatives at all times (SX of `unknowns`)."""
        return self.embedding.bounding(self._inputs_unknowns)

    @property
    def own_bounds(self) -> Array:
        """Bounds (size, 2) that the design space sets on z; infinite where it sets none."""
        chosen = self.problem.chosen_starts
        unbounded = np.tile([-np.inf, np.inf], (self.coefficient_count, 1))
        return unbounded if chosen is None else np.concatenate([unbounded, chosen.bounds])

    @property
    def starts(self) -> Expression:
        """Start states of the runs (SX of `unknowns`), (runs, states)."""
        chosen = self.problem.chosen_starts
        if chosen is None:
            return ca.SX(ca.DM(self.problem.fixed_starts))
        return chosen.expressed(self.unknowns[self.coefficient_count :])

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
        """Bounds of every limit's rows, without rows that no unknown moves."""

    @property
    @abstractmethod
    def linear(self) -> list[bool]:
        """Whether each limit's rows are linear in z."""

    @property
    @abstractmethod
    def values(self) -> ca.Function:
        """Z -> entries of the matrices (their upper halves, stacked), rows (stacked)."""

    @property
    @abstractmethod
    def jacobian(self) -> ca.Function:
        """Z -> derivatives of the entries (dense), and of the rows."""

    @property
    @abstractmethod
    def hessian(self) -> ca.Function:
        """(z, weights of the entries, weights of the rows) -> second derivatives of the weighted sum, on
        and above the diagonal.
        """

    @property
    def entry_count(self) -> int:
        """Entries of all matrices together."""
        return sum(size * (size + 1) // 2 for size in self.sizes)

    @cached_property
    def scores(self) -> ca.Function:
        """Z -> entries of the matrices, and for every limit its largest violation over its size."""
        z = ca.MX.sym("z", self.size)
        entries, stacked = self.values(z)
        worst, first = [], 0
        for rows in self.rows:
            own = stacked[first : first + len(rows.lower)]
            first += len(rows.lower)
            worst.append(ca.fmax(0, excess(own, rows)) / rows.size)
        return scores_of(z, entries, worst)

    @property
    def scores_written_out(self) -> ca.Function:
        """Z -> what `scores` gives, to the last bit, in less time where no C is generated."""
        return self.scores

    @property
    @abstractmethod
    def written(self) -> int:
        """Operations that generated C of the values writes out."""

    @cached_property
    def bounded_unknowns(self) -> tuple[Places, Places, Array, Array]:
        """Rows that are a constant plus a multiple of a single unknown: those rows, the unknowns, the
        multiples, the constants.
        """
        nothing = np.zeros(self.size)
        slope = self.jacobian(nothing)[1]
        rows, columns = (np.array(part, dtype=int) for part in slope.sparsity().get_triplet())
        linear = np.repeat(self.linear, [len(one.lower) for one in self.rows])
        single = np.flatnonzero(linear & (np.bincount(rows, minlength=len(linear)) == 1))
        # The place of each row's last entry, which is its only one where it is single.
        place = np.zeros(len(linear), dtype=int)
        place[rows] = np.arange(len(rows))
        own = place[single]
        constants = np.array(self.values(nothing)[1]).ravel()[single]
        return single, columns[own], np.array(slope.nonzeros())[own], constants


class Smooth:
    """An expression (k,) of symbols (n,), and its derivatives, as functions (SX).

    Attributes:
        size: k.
    """

    def __init__(self, symbols: Expression, expression: Expression) -> None:
        """Take both; functions are made when first used."""
        self._symbols, self._expression, self.size = symbols, expression, int(expression.shape[0])

    @cached_property
    def values(self) -> ca.Function:
        """Symbols -> expression."""
        return ca.Function("values", [self._symbols], [self._expression])

    @cached_property
    def slope(self) -> ca.Function:
        """Symbols -> its derivatives (k, n), dense."""
        slope = ca.jacobian(self._expression, self._symbols)
        return ca.Function("slope", [self._symbols], [ca.densify(slope)])

    @cached_property
    def curvature(self) -> ca.Function:
        """(symbols, weights (k,)) -> first, dense, and second derivatives of the weighted sum."""
        weights = ca.SX.sym("weights", self.size)
        curvature, slope = ca.hessian(ca.dot(weights, self._expression), self._symbols)
        return ca.Function("curvature", [self._symbols, weights], [ca.densify(slope), curvature])


def small_drive(problem: Problem, held: Expression, start: Expression, refine: int = 1) -> Drive:
    """The drive of a few samples with `held` inputs (n, inputs) from a state.

    Args:
        problem: whose robot drives.
        held: inputs, (n, inputs).
        start: state, (states,).
        refine: points of the path per sample.
    """
    return roll_out(
        problem.system,
        inputs=held,
        start=start,
        parameters=ca.SX(ca.DM(problem.system.nominal)),
        period=ca.SX(problem.design.period),
        refine=refine,
    )


def splines_of(drive: Drive, bounding: Bounding) -> Drive:
    """The drive with what bounds its inputs and their derivatives at all times."""
    return replace(
        drive, input_values=bounding.values, input_rates=bounding.rates, input_jerks=bounding.jerks
    )


def said_once(slopes: Array, constants: Array, rows: RowBounds | Rows) -> Bools:
    """Which of rows slopes @ z + constants, between bounds, say what none before them does.

    Args:
        slopes: (rows, size).
        constants: (rows,).
        rows: with the bounds.
    """
    size = np.abs(slopes).max(axis=1, initial=0.0)
    table = np.column_stack([slopes, constants, rows.lower, rows.upper])
    keys = np.round(table / np.where(size > 0, size, 1.0)[:, None], DIGITS) + 0.0
    kept = np.zeros(len(table), dtype=bool)
    kept[np.unique(keys, axis=0, return_index=True)[1]] = True
    return kept


def scores_of(unknowns: Expression, entries: Expression, worst: Sequence[Expression]) -> ca.Function:
    """The function from unknowns to entries and violations, both dense.

    Args:
        unknowns: z (MX).
        entries: of the matrices.
        worst: of every limit the largest violation over its size.
    """
    both = [ca.densify(entries), ca.densify(ca.vertcat(ca.MX(0, 1), *worst))]
    return ca.Function("scores", [unknowns], both)


def excess(values: Expression, rows: RowBounds | Rows) -> Expression:
    """The most by which values (rows,) are beyond their bounds; below 0 where none is."""
    return ca.fmax(_above(values, rows.upper), _below(values, rows.lower))


def _above(values: Expression, upper: Array) -> Expression:
    # The most by which values exceed their bounds; far below 0 where there are none.
    bounded, same = _bounded(values, upper)
    if bounded is None:
        return -1e20
    # As most limits are: one subtraction instead of one for every row.
    return ca.mmax(bounded) - same[0] if len(same) == 1 else ca.mmax(bounded - ca.DM(same))


def _below(values: Expression, lower: Array) -> Expression:
    # The most by which they fall short of them.
    bounded, same = _bounded(values, lower)
    if bounded is None:
        return -1e20
    return same[0] - ca.mmin(bounded) if len(same) == 1 else ca.mmax(ca.DM(same) - bounded)


def _bounded(values: Expression, bounds: Array) -> tuple[Expression | None, Array]:
    # Those of the values that have a bound, or None, and their bounds: one where all have the same.
    kept = np.isfinite(bounds)
    if not kept.any():
        return None, bounds
    own = bounds[kept]
    chosen = values if kept.all() else values[np.flatnonzero(kept).tolist()]
    return chosen, own[:1] if (own == own[0]).all() else own


def upper_half(matrix: Expression) -> Expression:
    """The entries on and above the diagonal, column by column, (p (p + 1) / 2,)."""
    size = matrix.shape[0]
    return ca.vertcat(*(matrix[row, column] for column in range(size) for row in range(column + 1)))


def upper_halves(matrices: Iterable[Expression]) -> Expression:
    """Those of several matrices, stacked."""
    return ca.vertcat(*map(upper_half, matrices))


def symmetric(entries: Expression, size: int) -> Expression:
    """The symmetric matrix (p, p) with these entries on and above its diagonal."""
    rows: list[list[Any]] = [[None] * size for _ in range(size)]
    places = ((row, column) for column in range(size) for row in range(column + 1))
    for index, (row, column) in enumerate(places):
        rows[row][column] = rows[column][row] = entries[index]
    return ca.blockcat(rows)


def symmetric_all(entries: Expression, sizes: Sequence[int]) -> list[Expression]:
    """The symmetric matrices of these sizes whose upper halves are stacked."""
    edges = np.cumsum([0, *(size * (size + 1) // 2 for size in sizes)]).tolist()
    return [
        symmetric(entries[first:last], size)
        for first, last, size in zip(edges[:-1], edges[1:], sizes, strict=True)
    ]


def stacks(entries: Array, sizes: Sequence[int]) -> list[Array]:
    """Numeric matrices (K, p, p) of stacked entries (sum of p (p + 1) / 2, K), one for each size p."""
    found, first = [], 0
    for size in sizes:
        columns, rows = np.tril_indices(size)
        matrix = np.empty((entries.shape[1], size, size))
        own = entries[first : first + len(rows)].T
        matrix[:, rows, columns] = matrix[:, columns, rows] = own
        found.append(matrix)
        first += len(rows)
    return found
