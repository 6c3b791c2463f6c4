"""Start states of a design, and the unknowns that choose them."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from oed.foundation.arrays import ROUNDING, Array, Places
from oed.kernel.dynamics.expression import Expression


@dataclass(frozen=True)
class StartStates:
    """Start states x = middle + reach z of every run, of unknowns z for the states that are free.

    Attributes:
        middle: middle of the range of each state, its value where it is fixed, (runs, states).
        reach: half the range of each state, 0 where it is fixed, (states,).
        bounded: True where z has to stay within [-1, 1].
    """

    middle: Array
    reach: Array
    bounded: bool = False

    @classmethod
    def between(cls, ranges: Array, states: int, runs: int) -> StartStates:
        """Return start states of which the first are each between two values, and the others 0.

        Args:
            ranges: least and largest value of the first states, (k, 2).
            states: number of states of the system.
            runs: number of runs.
        """
        low, high = np.pad(ranges, ((0, states - len(ranges)), (0, 0))).T
        return cls(np.tile((low + high) / 2, (runs, 1)), (high - low) / 2, bounded=True)

    @property
    def free(self) -> Places:
        """Places of the states that are free, (free,)."""
        return np.flatnonzero(self.reach)

    @property
    def size(self) -> int:
        """Number of unknowns of all runs."""
        return len(self.free) * len(self.middle)

    @property
    def bounds(self) -> Array:
        """Bounds (size, 2) of the unknowns; infinite where there are none."""
        return np.tile([-1.0, 1.0] if self.bounded else [-np.inf, np.inf], (self.size, 1))

    def states(self, unknowns: Array) -> Array:
        """Return the start states (runs, states) of unknowns (size,)."""
        states = self.middle.copy()
        states[:, self.free] += self.reach[self.free] * unknowns.reshape(len(states), -1)
        return states

    def unknowns(self, starts: Array) -> Array:
        """Return the unknowns (size,) of start states (runs, states).

        Raises:
            ValueError: states outside their bounds.
        """
        if self.bounded and self.excess(starts) > ROUNDING:
            raise ValueError("the trajectory starts outside the design space's start_bounds")
        return np.asarray((starts[:, self.free] - self.middle[:, self.free]) / self.reach[self.free]).ravel()

    def excess(self, starts: Array) -> float:
        """Return the largest distance of start states (runs, states) from their bounds, as a share of each
        state's largest.
        """
        largest = np.abs(self.middle) + self.reach
        excess = (np.abs(starts - self.middle) - self.reach) / np.where(largest > 0, largest, 1.0)
        return float(excess.max(initial=0.0))

    def expressed(self, unknowns: Expression) -> Expression:
        """Return the start states (runs, states) of unknowns (size,), as expressions."""
        free = ca.reshape(unknowns, len(self.free), len(self.middle))
        return (ca.DM(self.middle.T) + ca.sparsify(ca.DM(np.diag(self.reach)[:, self.free])) @ free).T

    def by_unknowns(self, slopes: Array) -> Array:
        """Return derivatives (size,) by the unknowns of what has these by the start states (runs, states)."""
        return np.asarray(slopes[:, self.free] * self.reach[self.free]).ravel()
