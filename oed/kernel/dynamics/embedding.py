"""Embedding of a design's unknowns in the inputs of its drives, one linear map for each input."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import casadi as ca
import numpy as np

from oed.foundation.arrays import ROUNDING, Array, Places
from oed.kernel.dynamics import spline
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.signals import Signal
from oed.kernel.dynamics.space import Space
from oed.kernel.dynamics.trajectory import bounding_values, middles

DIGITS = 12
"""Digits in which rows that are equal but for rounding agree."""


@dataclass(frozen=True)
class Bounding:
    """Expressions of the unknowns that bound inputs and their derivatives at all times checked.

    Attributes:
        values: bounds of the inputs, (K, inputs).
        rates: bounds of their derivatives, (K', inputs).
        jerks: bounds of their second derivatives, (K'', inputs).
    """

    values: Expression
    rates: Expression
    jerks: Expression


@dataclass(frozen=True)
class Embedding:
    """Linear map from a design's unknowns to the inputs of its drives, in the inputs' SI units.

    The unknowns stand input by input, and those of an input run by run, unless all runs share its signal.

    Attributes:
        space: all drives allowed.
        inputs: number of inputs of the system.
    """

    space: Space
    inputs: int

    @cached_property
    def signals(self) -> tuple[Signal, ...]:
        """Signal of each input."""
        return self.space.signals_of(self.inputs)

    @cached_property
    def counts(self) -> tuple[int, ...]:
        """Number of unknowns of each input in a run."""
        return tuple(signal.unknowns for signal in self.signals)

    @cached_property
    def sizes(self) -> tuple[int, ...]:
        """Number of unknowns of each input in all runs."""
        runs = self.space.runs
        return tuple(signal.unknowns * (1 if signal.shared else runs) for signal in self.signals)

    @property
    def size(self) -> int:
        """Number of all unknowns."""
        return sum(self.sizes)

    @cached_property
    def slices(self) -> tuple[slice, ...]:
        """Places of each input's unknowns among all."""
        return tuple(slice(*edges) for edges in pairwise(np.cumsum([0, *self.sizes]).tolist()))

    @cached_property
    def coefficients(self) -> tuple[Array, ...]:
        """Matrices (n, unknowns) that take each input's unknowns in a run to its coefficients in it."""
        space = self.space
        if space.stores_steps:
            return tuple(signal.matrix(space.duration, space.samples) for signal in self.signals)
        return (np.eye(space.spline.count)[:, space.free],) * self.inputs

    @cached_property
    def held(self) -> tuple[Array, ...]:
        """Matrices (N, unknowns) that take each input's unknowns in a run to the values held in it."""
        space, times = self.space, middles(self.space.duration, self.space.samples)
        knots, degree = space.run_knots, space.stored_spline.degree
        return tuple(spline.values(knots, degree, matrix, times) for matrix in self.coefficients)

    def bounds(self, ranges: Array) -> Array:
        """Return the bounds (size, 2) of the unknowns for inputs in these ranges (inputs, 2)."""
        parts = [np.zeros((0, 2))]
        for signal, size, (low, high) in zip(self.signals, self.sizes, ranges, strict=True):
            parts.append(np.tile(signal.bounds(low, high), (size // signal.unknowns, 1)))
        return np.concatenate(parts)

    def within(self, unknowns: Array, ranges: Array) -> Array:
        """Return unknowns (K, size) within their bounds, smaller where inputs would leave their ranges."""
        bounded = np.empty_like(unknowns)
        for signal, places, (low, high) in zip(self.signals, self.slices, ranges, strict=True):
            table = unknowns[:, places]
            by_run = table.reshape(-1, signal.unknowns)
            bounded[:, places] = signal.within(by_run, low, high).reshape(table.shape)
        return bounded

    def spread(self, values: Array) -> Array:
        """Return values of each input (inputs,), repeated for all its unknowns (size,)."""
        return np.repeat(values, self.sizes)

    def table(self, unknowns: Array) -> Array:
        """Return the coefficients (n, inputs) of unknowns (size,)."""
        table = np.zeros((self.space.all_coefficients, self.inputs))
        for place, (matrix, places) in enumerate(zip(self.coefficients, self.slices, strict=True)):
            by_run = unknowns[places].reshape(-1, matrix.shape[1]) @ matrix.T
            table.reshape(self.space.runs, -1, self.inputs)[:, :, place] = by_run
        return table

    def unknowns(self, table: Array) -> Array:
        """Return the unknowns (size,) of coefficients (n, inputs).

        Raises:
            ValueError: the coefficients belong to no drive of the space.
        """
        parts = [np.zeros(0)]
        for place, (signal, matrix) in enumerate(zip(self.signals, self.coefficients, strict=True)):
            by_run = table[:, place].reshape(self.space.runs, -1).T
            wanted = by_run.mean(axis=1, keepdims=True) if signal.shared else by_run
            solution = np.linalg.lstsq(matrix, wanted, rcond=None)[0]
            if np.abs(matrix @ solution - by_run).max() > ROUNDING * np.abs(by_run).max():
                again = ", the same in all runs" if signal.shared else ""
                raise ValueError(
                    f"input {place + 1} of the trajectory is not the design space's {signal.kind}{again}"
                )
            parts.append(solution.T.ravel())
        return np.concatenate(parts)

    def by_unknowns(self, slopes: Array) -> Array:
        """Return derivatives by the unknowns, (size,).

        Args:
            slopes: derivatives by the inputs held in all periods, (N, inputs).
        """
        parts = [np.zeros(0)]
        for signal, matrix, column in zip(self.signals, self.held, slopes.T, strict=True):
            by_run = column.reshape(self.space.runs, -1) @ matrix
            parts.append(by_run.sum(axis=0) if signal.shared else by_run.ravel())
        return np.concatenate(parts)

    def basis(self, run: Places, times: Array) -> tuple[Array, Places]:
        """Return the values of the basis functions that are not 0 at some times, (degree + 1, K), and the
        places of their unknowns of the first input, (degree + 1, K).

        Args:
            run: run of each time, (K,).
            times: times since the begin of the run [s], (K,).
        """
        matrix, space = self.coefficients[0], self.space
        functions, places = spline.basis(space.run_knots, space.stored_spline.degree, times)
        # A coefficient is an unknown, or fixed by rest.
        entries = functions * matrix.sum(axis=1)[places]
        return entries.T, (run[:, None] * self.counts[0] + matrix.argmax(axis=1)[places]).T

    def by_runs(self, matrices: Sequence[Array], unknowns: Expression) -> Expression:
        """Return the products of each input's matrix with its unknowns, (rows of all runs, inputs).

        Args:
            matrices: matrix of each input, (rows, unknowns in a run).
            unknowns: unknowns of all inputs, (size,).
        """
        columns = []
        for signal, matrix, places in zip(self.signals, matrices, self.slices, strict=True):
            values = without_zeros(matrix) @ ca.reshape(unknowns[places], signal.unknowns, -1)
            columns.append(ca.vec(ca.repmat(values, 1, self.space.runs) if signal.shared else values))
        return ca.horzcat(*columns) if columns else type(unknowns)(self.space.all_samples, 0)

    def held_inputs(self, unknowns: Expression) -> Expression:
        """Return the inputs held in each period, (N, inputs), of unknowns (size,)."""
        return self.by_runs(self.held, unknowns)

    def bounding(self, unknowns: Expression) -> Bounding:
        """Return expressions that bound the inputs of unknowns (size,): every row once."""
        space, tables = self.space, []
        for order in range(3):
            rows = [
                bounding_values(space.run_knots, space.stored_spline.degree, matrix, space.samples, order)
                for matrix in self.coefficients
            ]
            if rows:
                chosen = _distinct(np.hstack(rows))
                rows = [matrix[chosen] for matrix in rows]
            tables.append(self.by_runs(rows, unknowns))
        return Bounding(*tables)


def _distinct(table: Array) -> Places:
    # Rows that are not like any before, without those of zeros; one at least.
    keys = np.round(table / (np.abs(table).max(initial=0.0) or 1.0), DIGITS) + 0.0
    first = np.sort(np.unique(keys, axis=0, return_index=True)[1])
    moved = first[keys[first].any(axis=1)]
    return moved if len(moved) else first[:1]


def without_zeros(matrix: Array) -> ca.DM:
    """Return a constant whose zeros are structural."""
    return ca.sparsify(ca.DM(matrix))
