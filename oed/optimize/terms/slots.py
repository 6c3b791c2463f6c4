"""Rows of chosen instants by the chain rule, around the states at which their samples begin.

A program has a number of slots, each for one row of one instant; which these are is given with each call.
Empty ones are 0.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array, Places
from oed.kernel.dynamics.embedding import Embedding
from oed.kernel.dynamics.expression import Expression
from oed.optimize.terms.instants import InstantRows


class Begun(ABC):
    """What is known at the begins of some samples, as expressions (MX).

    Attributes:
        states: (states, K).
        held: inputs held in them, in units of their scale, (inputs, K).
    """

    states: Expression
    held: Expression

    @property
    @abstractmethod
    def slopes(self) -> Expression:
        """Derivatives by z of each one's states, then inputs held, (size, (states + inputs) K)."""


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
        width: numbers that say which rows they are of.
    """

    def __init__(self, rows: InstantRows, embedding: Embedding, count: int) -> None:
        """Take the parts."""
        self.rows, self.count = rows, count
        self._inputs, self._size = embedding.inputs, embedding.size
        self.order = embedding.space.own_spline.degree + 1 if rows.asking else 0
        self._stride = embedding.sizes[0] if rows.asking else 0
        self.width = count * (2 + 2 * self.order + rows.count)

    def around(self, z: Expression, begun: Begun, numbers: Expression, size: int) -> Around:
        """The rows as expressions.

        Args:
            z: the unknowns.
            begun: what is known at their samples' begins.
            numbers: which they are of.
            size: of z.
        """
        return Around(self, z, begun, numbers, size)

    def split(self, numbers: Expression) -> tuple[Expression, ...]:
        """(samples, elapsed, basis, places, chosen) of the numbers, a column for each slot."""
        count, order = self.count, self.order
        edges = np.cumsum([0, count, count, order * count, order * count, self.rows.count * count]).tolist()
        parts = ca.vertsplit(numbers, edges)
        return tuple(ca.reshape(one, -1, count) for one in parts)

    @cached_property
    def samples(self) -> ca.Function:
        """Numbers -> samples, (1, K)."""
        numbers = ca.MX.sym("numbers", self.width)
        return ca.Function("samples", [numbers], [self.split(numbers)[0]])

    def of_inputs(self, places: Expression) -> Expression:
        """Places (order, K) of the first input's unknowns, of every input's: (order, inputs * K)."""
        each = ca.repmat(ca.vec(places).T, self._inputs, 1)
        shift = ca.DM(self._stride * np.arange(self._inputs)[:, None])
        every = each + ca.repmat(shift, 1, each.shape[1])
        # (inputs, order * K) as (order, inputs * K).
        order = np.arange(self._inputs * self.order * self.count).reshape(
            self.count, self.order, self._inputs
        )
        return ca.reshape(ca.vec(every)[order.transpose(0, 2, 1).ravel().tolist()], self.order, -1)


class Around:
    """The rows of slots at z as expressions (MX), and their derivatives."""

    def __init__(self, slots: Slots, z: Expression, begun: Begun, numbers: Expression, size: int) -> None:
        """Take the parts; see `Slots.around`."""
        self._slots, self._z, self._begun, self._size = slots, z, begun, size
        _, elapsed, self._basis, self._places, chosen = slots.split(numbers)
        own = [begun.states, begun.held]
        if slots.order:
            own.append(self._asked)
        self._arguments = [ca.vertcat(*own), elapsed, chosen]

    @cached_property
    def _own_places(self) -> Expression:
        return self._slots.of_inputs(self._places)

    @cached_property
    def _own_basis(self) -> Expression:
        inputs, order = self._slots._inputs, self._slots.order
        return ca.reshape(ca.repmat(self._basis, inputs, 1), order, -1)

    @property
    def _asked(self) -> Expression:
        # What the splines ask for, (inputs, K).
        each = gathered(self._z, self._own_places) * self._own_basis
        return ca.reshape(ca.sum1(each), self._slots._inputs, self._slots.count)

    @property
    def values(self) -> Expression:
        """The rows, (K,)."""
        return self._slots.rows.values.map(self._slots.count)(*self._arguments).T

    @cached_property
    def _table(self) -> Expression:
        # Derivatives by z of all that rows are of, side by side, (size, rows.size * K).
        slots, size = self._slots, self._size
        own = self._begun.slopes
        if not slots.order:
            return own
        columns = np.repeat(np.arange(slots._inputs * slots.count), slots.order)
        target = ca.vec(self._own_places) + ca.DM(size * columns)
        asked = ca.reshape(
            scattered(ca.vec(self._own_basis), target, size * slots._inputs * slots.count), size, -1
        )
        each = own.shape[1] // slots.count
        order = np.concatenate(
            [
                np.arange(own.shape[1]).reshape(slots.count, each),
                own.shape[1] + np.arange(asked.shape[1]).reshape(slots.count, -1),
            ],
            axis=1,
        )
        return ca.horzcat(own, asked)[:, order.ravel().tolist()]

    @cached_property
    def _gradients(self) -> Expression:
        # By what rows are of, (rows.size, K).
        return self._slots.rows.slopes.map(self._slots.count)(*self._arguments)

    @property
    def slopes(self) -> Expression:
        """Derivatives (K, size) of the rows by z."""
        table, gradient = (
            ca.MX.sym("table", self._size, self._slots.rows.size),
            ca.MX.sym("gradient", self._slots.rows.size),
        )
        product = ca.Function("through", [table, gradient], [table @ gradient])
        return product.map(self._slots.count)(self._table, self._gradients).T

    def on_states(self, weights: Expression) -> Expression:
        """What weights (K,) of the rows weigh the states, (states, K)."""
        states = self._begun.states.shape[0]
        return self._gradients[:states, :] * ca.repmat(weights.T, states, 1)

    def curvature(self, weights: Expression) -> Expression:
        """Second derivatives (size, size) of the weighted sum, but for those of the states."""
        rows, count = self._slots.rows, self._slots.count
        if not rows.bent:
            return ca.MX(self._size, self._size)
        width = len(rows.bent)
        bent = rows.curvature.map(count)(*self._arguments, weights.T)
        columns = np.arange(count)[:, None] * rows.size + np.array(rows.bent)
        left = self._table[:, columns.ravel().tolist()]
        slope, inner = ca.MX.sym("slope", self._size, width), ca.MX.sym("inner", width, width)
        half = ca.Function("half", [slope, inner], [slope @ inner]).map(count)(left, bent)
        return left @ half.T


def first_entries(blocks: Expression, width: int, rows: int) -> Expression:
    """Places (rows, K) of the first entries of blocks.

    Args:
        blocks: which of them, (1, K).
        width: entries of each.
        rows: how many.
    """
    entries = ca.repmat(ca.DM(np.arange(rows)[:, None]), 1, blocks.shape[1])
    return ca.repmat(width * blocks, rows, 1) + entries


def gathered(table: Expression, places: Expression) -> Expression:
    """The entries of a table at places in it, counted column by column, in the shape of these."""
    return ca.reshape(ca.MX(ca.densify(ca.vec(table)))[ca.vec(places)], *places.shape)


def scattered(entries: Expression, places: Expression, size: int) -> Expression:
    """A column (size,) with the sums of the entries that belong to each place.

    Args:
        entries: (n,).
        places: of each, (n,).
        size: of the column.
    """
    return _scatter(size, entries.shape[0])(entries, places)


@lru_cache(maxsize=64)
def _scatter(size: int, count: int) -> ca.Function:
    # As the derivative of picking entries, which CasADi knows.
    column, places, entries = (
        ca.MX.sym("column", size),
        ca.MX.sym("places", count),
        ca.MX.sym("entries", count),
    )
    total = ca.jtimes(column[places], column, entries, True)
    return ca.Function("scatter", [entries, places], [ca.densify(total)])
