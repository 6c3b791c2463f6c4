"""Embedding of a design's unknowns in the coefficients of its drives, one linear map for each input."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array, Places
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.space import Space
from oed.kernel.dynamics.trajectory import held_jerks, held_rates

SLIGHT = 1e-9
"""Share of an input's largest value by which a drive may differ from a signal, by rounding."""
DIGITS = 12
"""Digits in which rows that are equal but for rounding agree."""


@dataclass(frozen=True)
class Bounding:
    """Expressions of the unknowns that bound inputs and their derivatives at all times checked.

    Attributes:
        values: (K, inputs).
        rates: (K', inputs).
        jerks: (K'', inputs).
    """

    values: Expression
    rates: Expression
    jerks: Expression


@dataclass(frozen=True)
class Embedding(ABC):
    """The unknowns of a space's drives, in the inputs' SI units: input by input, of each run by run.

    Attributes:
        space: all drives.
        inputs: number of inputs of the system.
    """

    space: Space
    inputs: int

    @property
    @abstractmethod
    def counts(self) -> tuple[int, ...]:
        """Unknowns of each input in a run."""

    @property
    @abstractmethod
    def shared(self) -> tuple[bool, ...]:
        """True for every input whose unknowns are the same in all runs."""

    @property
    @abstractmethod
    def own_held(self) -> tuple[Array, ...]:
        """Matrices (N, n) that take each input's unknowns in a run to the values held in its periods."""

    @abstractmethod
    def bounds(self, ranges: Array) -> Array:
        """Bounds (size, 2) of the unknowns for inputs in these ranges (inputs, 2)."""

    @abstractmethod
    def within(self, unknowns: Array, ranges: Array) -> Array:
        """Unknowns (K, size) within such bounds, smaller where inputs would leave their ranges."""

    @abstractmethod
    def table(self, unknowns: Array) -> Array:
        """The coefficients (n, inputs) that unknowns (size,) stand for."""

    @abstractmethod
    def unknowns(self, table: Array) -> Array:
        """The unknowns (size,) of coefficients (n, inputs).

        Raises:
            ValueError: the coefficients belong to no drive of the space.
        """

    @abstractmethod
    def expressed(self, unknowns: Expression) -> Expression:
        """The coefficients (n, inputs) of unknowns (size,), as expressions (SX)."""

    @abstractmethod
    def held(self, table: Expression) -> Expression:
        """The inputs held in each period, (N, inputs), of coefficients (n, inputs)."""

    @abstractmethod
    def bounding(self, unknowns: Expression) -> Bounding:
        """Return expressions that bound the inputs of unknowns (size,)."""

    @property
    def repeats(self) -> bool:
        """True if several rows that bound the inputs may be equal."""
        return bool(self.space.own_signals)

    @cached_property
    def sizes(self) -> tuple[int, ...]:
        """Unknowns of each input in all runs."""
        both = zip(self.counts, self.shared, strict=True)
        return tuple(count if shared else count * self.space.runs for count, shared in both)

    @property
    def size(self) -> int:
        """All unknowns."""
        return sum(self.sizes)

    def spread(self, values: Array) -> Array:
        """Return values of each input (inputs,), repeated for all its unknowns (size,)."""
        return np.repeat(values, self.sizes)

    @cached_property
    def slices(self) -> tuple[slice, ...]:
        """Places of each input's unknowns."""
        return tuple(slice(*edges) for edges in pairwise(np.cumsum([0, *self.sizes]).tolist()))

    def by_runs(self, matrices: Sequence[Expression], unknowns: Expression) -> Expression:
        """Products of each input's matrix (rows, n) with its unknowns, (rows of all runs, inputs).

        Args:
            matrices: matrix of each input.
            unknowns: unknowns of all inputs, (size,).
        """
        runs, columns = self.space.runs, []
        for matrix, places, count, shared in zip(
            matrices, self.slices, self.counts, self.shared, strict=True
        ):
            values = matrix @ ca.reshape(unknowns[places], count, 1 if shared else runs)
            columns.append(ca.vec(ca.repmat(values, 1, runs) if shared else values))
        return ca.horzcat(*columns)


@dataclass(frozen=True)
class OneSpline(Embedding):
    """One spline for all inputs: the unknowns are its coefficients that are free."""

    @cached_property
    def free(self) -> Places:
        """Rows of the coefficients that are free."""
        return self.space.free_rows

    @cached_property
    def counts(self) -> tuple[int, ...]:
        """The free coefficients."""
        return (len(self.free) // self.space.runs,) * self.inputs

    @property
    def shared(self) -> tuple[bool, ...]:
        """No runs share any."""
        return (False,) * self.inputs

    @cached_property
    def own_held(self) -> tuple[Array, ...]:
        """The splines in the middles of the periods."""
        sampling = self.space.own_sampling
        return (sampling[:, 1:-1] if self.space.rest_to_rest else sampling,) * self.inputs

    def bounds(self, ranges: Array) -> Array:
        """The inputs' ranges."""
        return np.repeat(ranges, len(self.free), axis=0)

    def within(self, unknowns: Array, ranges: Array) -> Array:
        """Return the unknowns unchanged: splines stay between their coefficients."""
        return unknowns

    def table(self, unknowns: Array) -> Array:
        """The free coefficients, and 0 elsewhere."""
        table = np.zeros((self.space.all_coefficients, self.inputs))
        table[self.free] = unknowns.reshape((len(self.free), self.inputs), order="F")
        return table

    def unknowns(self, table: Array) -> Array:
        """The free coefficients."""
        return table[self.free].ravel(order="F")

    def expressed(self, unknowns: Expression) -> Expression:
        """The free coefficients, and 0 elsewhere."""
        table = ca.SX.zeros(self.space.all_coefficients, self.inputs)
        table[self.free.tolist(), :] = ca.reshape(unknowns, len(self.free), self.inputs)
        return table

    def held(self, table: Expression) -> Expression:
        """The splines in the middles of the periods."""
        return without_zeros(self.space.sampling_matrix) @ table

    def bounding(self, unknowns: Expression) -> Bounding:
        """The coefficients, and those of the derivatives."""
        table = self.expressed(unknowns)
        rates, jerks = without_zeros(self.space.rate_matrix), without_zeros(self.space.jerk_matrix)
        return Bounding(table, rates @ table, jerks @ table)


@dataclass(frozen=True)
class HeldSignals(Embedding):
    """A signal for each input: the coefficients are the values held."""

    @property
    def counts(self) -> tuple[int, ...]:
        """Numbers of unknowns of the signals."""
        return tuple(signal.unknowns for signal in self.space.own_signals)

    @property
    def shared(self) -> tuple[bool, ...]:
        """True for every signal that is the same in all runs."""
        return tuple(signal.shared for signal in self.space.own_signals)

    @cached_property
    def own_held(self) -> tuple[Array, ...]:
        """The signals' matrices."""
        space = self.space
        return tuple(signal.matrix(space.duration, space.samples) for signal in space.own_signals)

    def bounds(self, ranges: Array) -> Array:
        """Return the bounds of the signals' unknowns."""
        runs, bounds = self.space.runs, []
        for signal, (low, high) in zip(self.space.own_signals, ranges, strict=True):
            bounds.append(np.tile(signal.bounds(low, high), (1 if signal.shared else runs, 1)))
        return np.concatenate(bounds)

    def within(self, unknowns: Array, ranges: Array) -> Array:
        """Return the unknowns as each signal bounds them."""
        bounded = np.empty_like(unknowns)
        for signal, places, (low, high) in zip(self.space.own_signals, self.slices, ranges, strict=True):
            table = unknowns[:, places]
            bounded[:, places] = signal.within(table.reshape(-1, signal.unknowns), low, high).reshape(
                table.shape
            )
        return bounded

    def table(self, unknowns: Array) -> Array:
        """The values held."""
        columns = []
        for matrix, places, shared in zip(self.own_held, self.slices, self.shared, strict=True):
            values = unknowns[places].reshape(-1, matrix.shape[1])
            columns.append((np.tile(values, (self.space.runs, 1)) if shared else values) @ matrix.T)
        return np.stack([column.ravel() for column in columns], axis=1)

    def unknowns(self, table: Array) -> Array:
        """Return unknowns by least squares, which leaves no residual."""
        parts = []
        for place, matrix in enumerate(self.own_held):
            held = table[:, place].reshape(self.space.runs, -1).T
            wanted = held.mean(axis=1, keepdims=True) if self.shared[place] else held
            solution = np.linalg.lstsq(matrix, wanted, rcond=None)[0]
            if np.abs(matrix @ solution - held).max() > SLIGHT * np.abs(held).max():
                kind = self.space.own_signals[place].kind
                again = ", the same in all runs" if self.shared[place] else ""
                raise ValueError(
                    f"input {place + 1} of the trajectory is not the design space's {kind}{again}"
                )
            parts.append(solution.T.ravel())
        return np.concatenate(parts)

    def expressed(self, unknowns: Expression) -> Expression:
        """The values held."""
        return self.by_runs([without_zeros(matrix) for matrix in self.own_held], unknowns)

    def held(self, table: Expression) -> Expression:
        """The coefficients themselves."""
        return table

    def bounding(self, unknowns: Expression) -> Bounding:
        """Return the values held and their changes, as of splines of degree 0: every row once."""
        knots, samples = self.space.own_knots, self.space.samples
        rates, jerks = (
            [changes(knots, 0, matrix, samples) for matrix in self.own_held]
            for changes in (held_rates, held_jerks)
        )
        return Bounding(*(self._once(matrices, unknowns) for matrices in (self.own_held, rates, jerks)))

    def _once(self, matrices: Sequence[Array], unknowns: Expression) -> Expression:
        rows = _first_of_each(np.hstack(matrices))
        return self.by_runs([without_zeros(matrix[rows]) for matrix in matrices], unknowns)


def _first_of_each(table: Array) -> Places:
    # Rows that are not like any before, without those of zeros; one at least.
    keys = np.round(table / (np.abs(table).max(initial=0.0) or 1.0), DIGITS) + 0.0
    first = np.sort(np.unique(keys, axis=0, return_index=True)[1])
    moved = first[keys[first].any(axis=1)]
    return moved if len(moved) else first[:1]


def embedding_of(space: Space, inputs: int) -> Embedding:
    """Return the embedding of a space's unknowns in the coefficients of its drives.

    Args:
        space: all drives.
        inputs: number of inputs of the system.
    """
    return HeldSignals(space, inputs) if space.own_signals else OneSpline(space, inputs)


def without_zeros(matrix: Array) -> ca.DM:
    """A constant whose zeros are structural."""
    return ca.sparsify(ca.DM(matrix))
