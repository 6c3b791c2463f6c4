"""Runs of one-sample cells: rolled out, differentiated forwards, weighed backwards [Bock and Plitt, "A
multiple shooting algorithm for direct solution of optimal control problems", IFAC 1984].

A run is moved by its own unknowns alone, so its derivatives are by these few. Arrays begin with (runs,
samples), the runs of one system after those of another; x is a cell's state: the system's, its sensitivities
and, under drift, a filter's covariance.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array, Bools
from oed.kernel.dynamics.direct_call import mapped
from oed.kernel.tightening import Scenarios
from oed.optimize.terms.cell import Cell
from oed.optimize.terms.differentiated import matrices_of
from oed.optimize.terms.recurrence import Recurrence
from oed.optimize.terms.run_unknowns import RunUnknowns


class Runs:
    """All samples of all runs of K systems, each a cell: those of one system after those of another.

    Attributes:
        cell: one sample.
        held_slopes: derivatives of the inputs held by a run's unknowns, (N, inputs, w).
        start_slopes: derivatives of the start states by a run's unknowns, (count, states, w).
        size: number of all unknowns.
        places: places of a run's unknowns among all, (count, w).
        constants: constants of all cells, (count, N, constants).
        parameters: parameters of the runs' systems where they differ, (count, p) or (count, 0).
        shifts: shifts of the start states, (K, runs, states).
    """

    def __init__(
        self,
        cell: Cell,
        unknowns: RunUnknowns,
        *,
        held_slopes: Array,
        start_slopes: Array,
        reads: Array,
        scenarios: Scenarios,
    ) -> None:
        """Take the parts.

        Args:
            cell: one sample; its constants are those of the samples, then the parameters if they differ.
            unknowns: places of the runs' unknowns.
            held_slopes: derivatives of the inputs held by a run's unknowns, (N, inputs, w).
            start_slopes: derivatives of the start states by all unknowns, (runs, states, size).
            reads: constants of a run's samples, (N, c).
            scenarios: the systems' parameters, and the shifts of their starts.
        """
        self.cell, self.held_slopes, self.shifts = cell, held_slopes, scenarios.shifts
        repeated, runs, samples = len(scenarios.parameters), unknowns.runs, len(held_slopes)
        by_run = np.take_along_axis(start_slopes, unknowns.places[:, None, :], axis=2)
        self.places, self.start_slopes = (
            np.tile(unknowns.places, (repeated, 1)),
            np.tile(by_run, (repeated, 1, 1)),
        )
        of_samples = np.broadcast_to(reads, (repeated * runs, *reads.shape))
        self.size, self.parameters = unknowns.size, np.repeat(scenarios.varied, runs, axis=0)
        repeated_parameters = np.repeat(self.parameters[:, None], samples, axis=1)
        self.constants = np.concatenate([of_samples, repeated_parameters], axis=2)

    @property
    def count(self) -> int:
        """Runs of all systems."""
        return len(self.places)

    @property
    def systems(self) -> int:
        """Number of systems, K."""
        return len(self.shifts)

    @property
    def samples(self) -> int:
        """Samples of a run, N."""
        return len(self.held_slopes)

    def begins(self, starts: Array) -> Array:
        """Return x where the runs of drives begin, (drives * count, width), of start states (drives, runs,
        states).
        """
        count = len(starts) * self.count
        states = (starts[:, None] + self.shifts).reshape(count, starts.shape[2])
        return np.hstack([states, np.tile(self.cell.begin, (count, 1))])

    def held(self, held: Array) -> Array:
        """Return the inputs of all runs (drives * count, N, inputs), of drives' inputs (drives, runs, N,
        inputs).
        """
        table = np.broadcast_to(held[:, None], (len(held), len(self.shifts), *held.shape[1:]))
        return table.reshape(len(held) * self.count, *held.shape[2:])

    @cached_property
    def roll(self) -> Recurrence:
        """(x at the runs' begins, inputs held, constants) -> x at all cells' ends, what cells add."""
        return Recurrence(self.cell.values, self.count, self.samples)

    @cached_property
    def forward(self) -> Recurrence:
        """(slopes of x at the runs' begins, of the inputs held, entries of all cells' slopes) -> slopes of x
        at all cells' ends, by the runs' unknowns.
        """
        unknowns, inputs = self.held_slopes.shape[2], self.held_slopes.shape[1]
        slopes, held = ca.MX.sym("slopes", unknowns, self.cell.width), ca.MX.sym("held", unknowns, inputs)
        onward = self.cell.slopes[0]
        entries = ca.MX.sym("entries", onward.pattern.nnz())
        product = ca.horzcat(slopes, held) @ onward.matrix(entries).T
        step = ca.Function("forward", [slopes, held, entries], [ca.densify(product)])
        return Recurrence(step, self.count, self.samples)

    @cached_property
    def backward(self) -> Recurrence:
        """(weights of x at the runs' ends, entries of all cells' slopes, more weights of x at their begins)
        -> weights of x at all cells' begins, both from the last cell to the first.
        """
        return Recurrence(self.cell.slopes[0].back(), self.count, self.samples)

    @cached_property
    def state_pattern(self) -> Bools:
        """Pattern (width, width + inputs) of x at a cell's end by x at its begin and its inputs."""
        pattern = self.cell.slopes[0].pattern
        return np.array(matrices_of(pattern, np.ones(pattern.nnz()), 1)[0] != 0)


@dataclass
class RunValues:
    """What runs do.

    Attributes:
        held: inputs, (R, N, inputs).
        points: x at every cell's begin, (R, N, width).
        ends: x at every run's end, (R, width).
        added: what every cell adds, (R, N, added).
    """

    held: Array
    points: Array
    ends: Array
    added: Array

    @classmethod
    def of(cls, begins: Array, held: Array, following: Array, added: Array) -> Self:
        """Return what runs do, from x at all cells' ends.

        Args:
            begins: x where the runs begin, (R, width).
            held: inputs, (R, N, inputs).
            following: x at all cells' ends, (R, N, width).
            added: what every cell adds, (R, N, added).
        """
        points = np.concatenate([begins[:, None], following[:, :-1]], axis=1)
        return cls(held, points, following[:, -1], added)


@dataclass
class RunWeights:
    """Weights of what runs do, and second derivatives by their unknowns besides.

    Attributes:
        ends: weights of x at the runs' ends, (R, width).
        added: weights of what every cell adds, (R, N, added).
        points: weights of x at every cell's begin, (R, N, width).
        bent: second derivatives by each run's unknowns, (R, w, w).
    """

    ends: Array
    added: Array
    points: Array
    bent: Array


class Rolled(RunValues):
    """Runs of one drive, and their derivatives.

    Attributes:
        runs: cells of all samples.
    """

    def __init__(self, runs: Runs, starts: Array, held: Array) -> None:
        """Roll the runs out.

        Args:
            runs: cells of all samples.
            starts: start states of the drive, (runs, states).
            held: inputs of the drive, (runs, N, inputs).
        """
        self.runs, self._cell = runs, runs.cell
        begins, inputs = runs.begins(starts[None]), runs.held(held[None])
        following, added = runs.roll(begins, inputs, runs.constants)
        super().__init__(**vars(RunValues.of(begins, inputs, following, added)))

    @property
    def _shape(self) -> tuple[int, int]:
        return self.runs.count, self.runs.samples

    @cached_property
    def _cell_arguments(self) -> list[Array]:
        # Of all cells, one row each.
        count = self.runs.count * self.runs.samples
        return [
            self.points.reshape(count, self._cell.width),
            self.held.reshape(count, self.held.shape[2]),
            self.runs.constants.reshape(count, self.runs.constants.shape[2]),
        ]

    @cached_property
    def _cell_slopes(self) -> list[Array]:
        # Entries of the derivatives of what cells hand on and of what they add, by (x, inputs).
        count = self.runs.count * self.runs.samples
        results = mapped(self._cell.jacobian, count)(*self._cell_arguments)
        return [
            entries.reshape(count, part.pattern.nnz())
            for part, entries in zip(self._cell.slopes, results, strict=True)
        ]

    @cached_property
    def _added_slopes(self) -> Array:
        # Derivatives of what cells add, (R, N, added, width + inputs).
        pattern, entries = self._cell.slopes[1].pattern, self._cell_slopes[1]
        return matrices_of(pattern, entries, len(entries)).reshape(*self._shape, *pattern.shape)

    @cached_property
    def _following_slopes(self) -> Array:
        # Of x at all cells' ends, (R, N, width, w).
        runs, samples = self._shape
        entries = self._cell_slopes[0].reshape(runs, samples, -1)
        (flat,) = self.runs.forward(self._begin_slopes, self._held_slopes, entries)
        return flat.reshape(runs, samples, *self._begin_slopes.shape[1:])

    @cached_property
    def _begin_slopes(self) -> Array:
        begins = np.zeros((self.runs.count, self._cell.width, self.runs.start_slopes.shape[2]))
        begins[:, : self._cell.states] = self.runs.start_slopes
        return begins

    @property
    def _held_slopes(self) -> Array:
        return np.broadcast_to(self.runs.held_slopes, (self.runs.count, *self.runs.held_slopes.shape))

    @cached_property
    def slopes(self) -> Array:
        """Derivatives of (x, inputs) at every cell's begin by the unknowns, (R, N, width + inputs, w)."""
        begins = np.concatenate([self._begin_slopes[:, None], self._following_slopes[:, :-1]], axis=1)
        return np.concatenate([begins, self._held_slopes], axis=2)

    @property
    def end_slopes(self) -> Array:
        """Derivatives of x at every run's end, (R, width, w)."""
        return np.asarray(self._following_slopes[:, -1])

    def added_slopes(self, groups: int) -> Array:
        """Return derivatives (R, groups, added, w) of what each of so many equal parts of a run adds."""
        gathered = self._added_slopes
        runs, samples, added, columns = gathered.shape
        length = samples // groups
        parts = gathered.reshape(runs, groups, length, added, columns).transpose(0, 1, 3, 2, 4)
        steps = self.slopes.reshape(runs, groups, length * columns, self.slopes.shape[3])
        return np.asarray(np.matmul(parts.reshape(runs, groups, added, length * columns), steps))

    def no_weights(self) -> RunWeights:
        """Return weights of nothing."""
        unknowns = self.runs.held_slopes.shape[2]
        ends, added, points = map(np.zeros_like, (self.ends, self.added, self.points))
        bent = np.zeros((self.runs.count, unknowns, unknowns))
        return RunWeights(ends, added, points, bent)

    def curvature(self, weights: RunWeights) -> Array:
        """Return second derivatives (size, size) by all unknowns of a weighted sum of what runs do."""
        (runs, samples), width = self._shape, self._cell.width
        pulled = np.matmul(weights.added[:, :, None, :], self._added_slopes[..., :width])[:, :, 0]
        onward = self._cell_slopes[0]
        onward = onward.reshape(runs, samples, onward.shape[1])
        points = weights.points + pulled
        (begins,) = self.runs.backward(weights.ends, onward[:, ::-1], points[:, ::-1])
        following = np.concatenate([begins[:, -2::-1], weights.ends[:, None]], axis=1)
        total = np.zeros((self.runs.size, self.runs.size))
        bent = weights.bent + self._bent(following, weights.added)
        for places, by_run in zip(self.runs.places, bent, strict=True):
            total[np.ix_(places, places)] += by_run
        return total

    def _bent(self, following: Array, added: Array) -> Array:
        # Second derivatives of the cells, weighted, between the slopes of what is bent in them.
        (runs, samples), cell = self._shape, self._cell
        count = runs * samples
        weights = [following.reshape(count, cell.width), added.reshape(count, added.shape[2])]
        results = mapped(cell.curvature, count)(*self._cell_arguments, *weights)
        inner = [
            matrices_of(part.pattern, entries, count)
            for part, entries in zip(cell.inner, results, strict=True)
        ]
        slopes = self.slopes.reshape(count, *self.slopes.shape[2:])
        if not cell.bent_slopes:
            bent = np.ascontiguousarray(slopes[:, cell.bent])
            return self._products(bent, np.matmul(inner[0], bent))
        entries_of_bent = mapped(cell.bent_jacobian, count)(*self._cell_arguments)
        bent, more_bent = (
            np.matmul(matrices_of(part.pattern, entries, count), slopes)
            for part, entries in zip(cell.bent_slopes, entries_of_bent, strict=True)
        )
        half = np.matmul(inner[0].transpose(0, 2, 1), bent) + np.matmul(
            inner[1].transpose(0, 2, 1), more_bent
        )
        total = self._products(bent, half)
        return np.asarray(total + total.transpose(0, 2, 1))

    def _products(self, first: Array, second: Array) -> Array:
        # Sums over a run's samples of the products of first' and second, (R, w, w).
        runs, unknowns = self.runs.count, first.shape[-1]
        rows = first.reshape(runs, -1, unknowns).transpose(0, 2, 1)
        return np.asarray(np.matmul(rows, second.reshape(runs, -1, unknowns)))
