"""Runs of one-sample cells: rolled out, differentiated forwards, weighed backwards [Bock and Plitt, "A
multiple shooting algorithm for direct solution of optimal control problems", IFAC 1984].

A run is moved by its own unknowns alone, so its derivatives are by these few. Arrays begin with (runs,
samples); x is a cell's state: the robot's, its sensitivities and, under drift, a filter's covariance.
"""

from __future__ import annotations

from functools import cached_property

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array, Bools
from oed.kernel.dynamics.direct_call import DirectCall, mapped
from oed.optimize.condensed.differentiated import matrices_of
from oed.optimize.terms.cell import SampleCell


class Runs:
    """All samples of all runs, each a cell.

    Attributes:
        cell: one sample.
        count: runs, R.
        samples: of a run, N.
        held_slopes: derivatives of the inputs held by a run's unknowns, (N, inputs, w).
    """

    def __init__(self, cell: SampleCell, count: int, reads: Array, held_slopes: Array) -> None:
        """Take the parts.

        Args:
            cell: one sample.
            count: number of runs.
            reads: which sensors read in each sample, (sensors, N).
            held_slopes: derivatives of the inputs held by a run's unknowns, (N, inputs, w).
        """
        self.cell, self.count, self.held_slopes = cell, count, held_slopes
        self.samples = len(held_slopes)
        self._reads = np.ascontiguousarray(reads.T)

    def reads(self, runs: int) -> Array:
        """Return which sensors read in each sample of so many runs, one row a sample."""
        return np.tile(self._reads, (runs, 1))

    def begins(self, starts: Array) -> Array:
        """Return what the first cells begin with, (runs, width), where the robots start at (runs, states)."""
        carried = np.array(self.cell.carry.begin, dtype=float).ravel()
        return np.hstack([starts, np.tile(carried, (len(starts), 1))])

    @cached_property
    def roll(self) -> DirectCall:
        """(x at the runs' begins, inputs held, sensors that read) -> x at all cells' ends, what cells add."""
        return DirectCall(self.cell.values.mapaccum("roll", self.samples).map(self.count))

    @cached_property
    def forward(self) -> DirectCall:
        """(slopes of x at the runs' begins, of the inputs held, entries of all cells' slopes) -> slopes of x
        at all cells' ends, by the runs' unknowns.
        """
        unknowns, inputs = self.held_slopes.shape[2], self.held_slopes.shape[1]
        slopes, held = ca.MX.sym("slopes", unknowns, self.cell.width), ca.MX.sym("held", unknowns, inputs)
        onward = self.cell.slopes[0]
        entries = ca.MX.sym("entries", onward.pattern.nnz())
        product = ca.horzcat(slopes, held) @ onward.matrix(entries).T
        step = ca.Function("forward", [slopes, held, entries], [ca.densify(product)])
        return DirectCall(step.mapaccum("forward", self.samples).map(self.count))

    @cached_property
    def backward(self) -> DirectCall:
        """(weights of x at the runs' ends, entries of all cells' slopes, more weights of x at their begins)
        -> weights of x at all cells' begins, both from the last cell to the first.
        """
        step = self.cell.slopes[0].back()
        return DirectCall(step.mapaccum("backward", self.samples).map(self.count))

    @cached_property
    def state_pattern(self) -> Bools:
        """Pattern (width, width + inputs) of x at a cell's end by x at its begin and its inputs."""
        pattern = self.cell.slopes[0].pattern
        return np.array(matrices_of(pattern, np.ones(pattern.nnz()), 1)[0] != 0)


class Rolled:
    """Runs from given starts with given inputs, and their derivatives.

    Attributes:
        held: inputs, (R, N, inputs).
        points: x at every cell's begin, (R, N, width).
        ends: x at every run's end, (R, width).
        added: what every cell adds, (R, N, added).
    """

    def __init__(self, runs: Runs, starts: Array, held: Array, start_slopes: Array) -> None:
        """Roll the runs out.

        Args:
            runs: cells of all samples.
            starts: start states, (R, states).
            held: inputs, (R, N, inputs).
            start_slopes: derivatives of the start states by each run's unknowns, (R, states, w).
        """
        self._runs, self._cell, self._start_slopes = runs, runs.cell, start_slopes
        begins = runs.begins(starts)
        following, added = runs.roll(begins, held, runs.reads(runs.count))
        following = following.reshape(*self._shape, runs.cell.width)
        self.added = added.reshape(*self._shape, runs.cell.gathered.numel())
        self.held, self.ends = held, following[:, -1]
        self.points = np.concatenate([begins[:, None], following[:, :-1]], axis=1)

    @property
    def _shape(self) -> tuple[int, int]:
        return self._runs.count, self._runs.samples

    @cached_property
    def _cell_arguments(self) -> list[Array]:
        # Of all cells, one row each.
        count = self._runs.count * self._runs.samples
        return [
            self.points.reshape(count, self._cell.width),
            self.held.reshape(count, self.held.shape[2]),
            self._runs.reads(self._runs.count),
        ]

    @cached_property
    def _cell_slopes(self) -> list[Array]:
        # Entries of the derivatives of what cells hand on and of what they add, by (x, inputs).
        count = self._runs.count * self._runs.samples
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
        (flat,) = self._runs.forward(self._begin_slopes, self._held_slopes, self._cell_slopes[0])
        return flat.reshape(runs, samples, *self._begin_slopes.shape[1:])

    @cached_property
    def _begin_slopes(self) -> Array:
        begins = np.zeros((self._runs.count, self._cell.width, self._start_slopes.shape[2]))
        begins[:, : self._cell.states] = self._start_slopes
        return begins

    @property
    def _held_slopes(self) -> Array:
        return np.broadcast_to(self._runs.held_slopes, (self._runs.count, *self._runs.held_slopes.shape))

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

    def curvature(self, ends: Array, added: Array, points: Array) -> Array:
        """Return second derivatives (R, w, w) by the runs' unknowns of a weighted sum of what runs do.

        Args:
            ends: weights of x at the runs' ends, (R, width).
            added: weights of what every cell adds, (R, N, added).
            points: weights of x at every cell's begin, (R, N, width).
        """
        (runs, samples), width = self._shape, self._cell.width
        pulled = points + np.matmul(added[:, :, None, :], self._added_slopes[..., :width])[:, :, 0]
        onward = self._cell_slopes[0]
        onward = onward.reshape(runs, samples, onward.shape[1])
        (flat,) = self._runs.backward(ends, onward[:, ::-1], pulled[:, ::-1])
        begins = flat.reshape(runs, samples, width)[:, ::-1]
        following = np.concatenate([begins[:, 1:], ends[:, None]], axis=1)
        return self._bent(following, added)

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
        runs, unknowns = self._runs.count, first.shape[-1]
        rows = first.reshape(runs, -1, unknowns).transpose(0, 2, 1)
        return np.asarray(np.matmul(rows, second.reshape(runs, -1, unknowns)))
