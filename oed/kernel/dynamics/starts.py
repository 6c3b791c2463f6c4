"""Start states that a design chooses: which of them, and how its unknowns stand for them."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array, Places
from oed.kernel.dynamics.expression import Expression

SLIGHT = 1e-9
"""Share of a start state's size that is rounding."""


@dataclass(frozen=True)
class ChosenStarts:
    """Start states x = middle + reach * z of z, of each run its own.

    Attributes:
        middle: middle of the range of all states, (states,); the value of those that are fixed.
        reach: half the range of the states that are free, (free,).
        places: places of the free states, (free,).
        bounded: z has to stay within [-1, 1].
        runs: number of runs.
    """

    middle: Array
    reach: Array
    places: Places
    bounded: bool
    runs: int

    @classmethod
    def anywhere(cls, states: int, chosen: int, runs: int) -> ChosenStarts:
        """The first `chosen` states are free, the others begin at 0; z is in SI units.

        Args:
            states: number of states of the system.
            chosen: number of states that are free.
            runs: number of runs.
        """
        return cls(np.zeros(states), np.ones(chosen), np.arange(chosen), bounded=False, runs=runs)

    @classmethod
    def between(cls, ranges: Array, states: int, runs: int) -> ChosenStarts:
        """The first states are each between two values, fixed where these are equal; the others begin at 0.

        Args:
            ranges: least and largest values, (k, 2).
            states: number of states of the system.
            runs: number of runs.
        """
        low, high = np.pad(ranges, ((0, states - len(ranges)), (0, 0))).T
        places = np.flatnonzero(high > low)
        reach = (high - low)[places] / 2
        return cls(np.where(high > low, (low + high) / 2, low), reach, places, bounded=True, runs=runs)

    @property
    def size(self) -> int:
        """Unknowns of all runs."""
        return len(self.places) * self.runs

    @property
    def bounds(self) -> Array:
        """Bounds (size, 2) of the unknowns; infinite where there are none."""
        return np.tile([-1.0, 1.0] if self.bounded else [-np.inf, np.inf], (self.size, 1))

    def states(self, unknowns: Array) -> Array:
        """The start states (runs, states) that unknowns (size,) stand for."""
        states = np.tile(self.middle, (self.runs, 1))
        states[:, self.places] += self.reach * unknowns.reshape(self.runs, -1)
        return states

    def unknowns(self, starts: Array) -> Array:
        """The unknowns (size,) of start states (runs, states).

        Raises:
            ValueError: states outside what may be chosen.
        """
        if self.bounded and self.excess(starts) > SLIGHT:
            raise ValueError("the trajectory starts outside the design space's start_bounds")
        return np.asarray((starts - self.middle)[:, self.places] / self.reach).ravel()

    def excess(self, starts: Array) -> float:
        """Return the largest distance of start states (runs, states) from their bounds, as a share of each
        state's largest.
        """
        reach = np.zeros(len(self.middle))
        reach[self.places] = self.reach
        largest = np.abs(self.middle) + reach
        off = (np.abs(starts - self.middle) - reach) / np.where(largest > 0, largest, 1.0)
        return float(off.max(initial=0.0))

    def expressed(self, unknowns: Expression) -> Expression:
        """The start states (runs, states) of unknowns (size,), as expressions (SX)."""
        free = ca.reshape(unknowns, len(self.places), self.runs).T
        columns = [
            ca.SX(self.runs, 1) if not middle else ca.SX(ca.DM.ones(self.runs, 1) * middle)
            for middle in self.middle
        ]
        for place, column in enumerate(self.places):
            columns[column] = columns[column] + self.reach[place] * free[:, place]
        return ca.horzcat(ca.SX(self.runs, 0), *columns)

    def by_unknowns(self, slopes: Array) -> Array:
        """Derivatives (size,) by the unknowns of what has these by the start states (runs, states)."""
        return np.asarray(slopes[:, self.places] * self.reach).ravel()
