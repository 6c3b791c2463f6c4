"""Rows of chosen instants by the chain rule, around the states at which their samples begin.

A program has a number of slots, each for one row of one instant; which these are is given with each call.
Empty ones are 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array, Places
from oed.kernel.dynamics.embedding import Embedding
from oed.kernel.dynamics.expression import Expression
from oed.optimize.terms.instants import InstantRows


@dataclass(frozen=True)
class Chosen:
    """Rows of instants, for so many slots of a program.

    Attributes:
        sample: in which each is, counted through all runs, (K,).
        elapsed: time since that began [s], (K,).
        row: which it is of those of its instant, (K,).
        basis: values of the splines' basis functions that are not 0 there, (degree + 1, K).
        places: unknowns of the first input that they are of, (degree + 1, K).
        lower: bounds (K,).
        upper: bounds (K,).
        count: of the rows, R.
    """

    sample: Places
    elapsed: Array
    row: Places
    basis: Array
    places: Places
    lower: Array
    upper: Array
    count: int

    def __len__(self) -> int:
        """K."""
        return len(self.sample)

    def numbers(self, slots: int) -> Array:
        """What a program with so many slots is given, (n,); those left over are empty."""
        spare = slots - len(self)
        chosen = np.zeros((slots, self.count))
        chosen[np.arange(len(self)), self.row] = 1.0
        columns = [np.pad(one, (0, spare)) for one in (self.sample.astype(float), self.elapsed)]
        columns += [np.pad(one, ((0, 0), (0, spare))).T.ravel() for one in (self.basis, self.places)]
        return np.concatenate([*columns, chosen.ravel()])

    def bounds(self, slots: int) -> tuple[Array, Array]:
        """Of all slots; empty ones have none."""
        spare = (0, slots - len(self))
        return tuple(  # type: ignore[return-value]
            np.pad(one, spare, constant_values=end)
            for one, end in ((self.lower, -np.inf), (self.upper, np.inf))
        )


class Slots:
    """So many slots of a program.

    Attributes:
        rows: of an instant.
        count: slots K.
        inputs: of the robot.
        order: basis functions of a spline that are not 0 at an instant; 0 where no row looks at splines.
        width: numbers that say which rows they are of.
    """

    def __init__(self, rows: InstantRows, embedding: Embedding, count: int) -> None:
        """Take the parts."""
        self.rows, self.count = rows, count
        self.inputs = embedding.inputs
        self.order = embedding.space.stored_spline.degree + 1 if rows.asking else 0
        self._stride = embedding.sizes[0] if rows.asking else 0
        self.width = count * (2 + 2 * self.order + rows.count)

    def split(self, numbers: Expression) -> tuple[Expression, ...]:
        """(samples, elapsed, basis, places, chosen) of the numbers, a column for each slot."""
        count, order = self.count, self.order
        edges = np.cumsum([0, count, count, order * count, order * count, self.rows.count * count]).tolist()
        parts = ca.vertsplit(numbers, edges)
        return tuple(ca.reshape(one, -1, count) for one in parts)
