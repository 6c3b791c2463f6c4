"""Dynamic programming over the speeds of two inputs that lie on a lattice."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from oed.foundation.arrays import Array, Places


@dataclass(frozen=True)
class SpeedLimits:
    """Limits of two inputs held in N periods.

    Attributes:
        samples: number of periods N.
        bounds: smallest and largest value of each input, (2, 2).
        step: largest change from a period to the next; infinite without one.
        ends: largest magnitude in the first and the last period; infinite without one.
    """

    samples: int
    bounds: Array
    step: float
    ends: float

    @property
    def symmetric(self) -> bool:
        """True if the reversed speeds satisfy the same limits."""
        return bool(np.allclose(self.bounds.sum(axis=1), 0.0))

    @property
    def both_ways(self) -> SpeedLimits:
        """Limits that allow the reversed speeds as well."""
        largest = np.abs(self.bounds).max(axis=1)
        return replace(self, bounds=np.stack([-largest, largest], axis=1))


def lattice(low: float, high: float, step: float, ends: float) -> Array:
    """Return the values of optimal speeds, ascending: every bound plus or minus multiples of the step.

    Args:
        low: lower bound of the speed.
        high: upper bound of the speed.
        step: largest change in one period.
        ends: largest magnitude in the first and the last period; infinite without one.
    """
    seeds = [low, high, (low + high) / 2, *([-ends, ends] if np.isfinite(ends) else [])]
    return reachable(low, high, step, seeds)


def reachable(low: float, high: float, step: float, seeds: Sequence[float]) -> Array:
    """Return the values within bounds that multiples of a step reach from seeds, ascending.

    Args:
        low: lower bound.
        high: upper bound.
        step: step; infinite for the seeds alone.
        seeds: values from which the steps begin.
    """
    inside = [seed for seed in seeds if low <= seed <= high]
    if not np.isfinite(step):
        return np.unique(inside)
    count = int(np.ceil((high - low) / step)) + 1
    values = np.concatenate([seed + step * np.arange(-count, count + 1) for seed in inside])
    values = np.sort(values[(values >= low) & (values <= high)])
    # Values that differ by rounding are merged.
    return np.asarray(values[np.concatenate([[True], np.diff(values) > 1e-9 * max(1.0, high - low)])])


class LatticeProgram:
    """Dynamic programme over both inputs: the speeds of largest tr(Z F) under sign conditions."""

    def __init__(self, limits: SpeedLimits, weights: Array) -> None:
        """Build the lattice within limits of the speeds, for weights S (2,) of F = S (sum w w') S."""
        self.limits, self.weights = limits, weights
        self.grids = [lattice(low, high, limits.step, limits.ends) for low, high in limits.bounds]
        first, second = np.meshgrid(*self.grids, indexing="ij")
        self.scaled = np.stack([weights[0] * first, weights[1] * second])
        self.neighbours = [_neighbours(grid, limits.step) for grid in self.grids]
        self.ends = np.maximum(np.abs(first), np.abs(second)) <= limits.ends * (1 + 1e-12)
        middle = limits.bounds.mean(axis=1)
        self.signs = {
            (first_sign, second_sign): (first_sign * (first - middle[0]) >= -1e-9)
            & (second_sign * (second - middle[1]) >= -1e-9)
            for first_sign, second_sign in itertools.product((1, -1), repeat=2)
        }

    @property
    def steps(self) -> int:
        """Number of comparisons of one pass, a measure of its time."""
        first, second = self.neighbours
        return int(self.limits.samples * len(first) * len(second) * (first.shape[1] + second.shape[1]))

    def maximise(self, matrix: Array, conditions: Mapping[int, tuple[int, int]]) -> tuple[float, Array]:
        """Return the largest tr(Z F), -inf without feasible speeds, and its speeds (N, 2), scaled by S."""
        cost = np.einsum("aij,ab,bij->ij", self.scaled, matrix, self.scaled)
        count = self.limits.samples
        values = self._restricted(cost, count - 1, conditions)
        table = [values]
        for index in range(count - 2, -1, -1):
            values = self._restricted(self._best_next(values) + cost, index, conditions)
            table.append(values)
        table.reverse()
        best = float(values.max())
        return best, self._trace(table) if np.isfinite(best) else np.zeros((count, 2))

    def _restricted(self, values: Array, index: int, conditions: Mapping[int, tuple[int, int]]) -> Array:
        # Values of the speeds that are allowed in a period, -inf for all others.
        if index in (0, self.limits.samples - 1):
            values = np.where(self.ends, values, -np.inf)
        if index in conditions:
            values = np.where(self.signs[conditions[index]], values, -np.inf)
        return values

    def _best_next(self, values: Array) -> Array:
        first, second = self.neighbours
        values = values[first].max(axis=1)
        return np.asarray(values[:, second].max(axis=2))

    def _trace(self, table: Sequence[Array]) -> Array:
        first, second = self.neighbours
        place = divmod(int(table[0].argmax()), table[0].shape[1])
        places = [place]
        for values in table[1:]:
            rows, columns = first[place[0]], second[place[1]]
            row, column = divmod(int(values[rows[:, None], columns].argmax()), len(columns))
            place = (int(rows[row]), int(columns[column]))
            places.append(place)
        rows, columns = np.array(places).T
        return np.asarray(self.scaled[:, rows, columns].T)


def _neighbours(grid: Array, step: float) -> Places:
    # Indices of the values that may follow each value, (n, m), the last one repeated as padding.
    reach = step * (1 + 1e-9)
    low = np.searchsorted(grid, grid - reach, side="left")
    high = np.searchsorted(grid, grid + reach, side="right")
    width = int((high - low).max())
    return np.asarray(np.minimum(low[:, None] + np.arange(width), high[:, None] - 1))
