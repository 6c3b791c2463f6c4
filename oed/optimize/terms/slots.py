"""Rows of chosen instants by the chain rule, around the states at which their samples begin.

A program has a number of slots, each for one row of one instant; which these are is given with each call.
Empty ones are 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array, Places
from oed.kernel.dynamics.embedding import Embedding
from oed.kernel.dynamics.expression import Expression
from oed.optimize.terms.begun import Begun, Weighted, gathered, scattered
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

    def of_inputs(self, places: Expression) -> Expression:
        """Places (order, K) of the first input's unknowns, of every input's: (order, inputs * K)."""
        each = ca.repmat(ca.vec(places).T, self.inputs, 1)
        shift = ca.DM(self._stride * np.arange(self.inputs)[:, None])
        every = each + ca.repmat(shift, 1, each.shape[1])
        # (inputs, order * K) as (order, inputs * K).
        order = np.arange(self.inputs * self.order * self.count).reshape(self.count, self.order, self.inputs)
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
        inputs, order = self._slots.inputs, self._slots.order
        return ca.reshape(ca.repmat(self._basis, inputs, 1), order, -1)

    @property
    def _asked(self) -> Expression:
        # What the splines ask for, (inputs, K).
        each = gathered(self._z, self._own_places) * self._own_basis
        return ca.reshape(ca.sum1(each), self._slots.inputs, self._slots.count)

    @property
    def values(self) -> Expression:
        """The rows, (K,)."""
        return self._slots.rows.values.map(self._slots.count)(*self._arguments).T

    @cached_property
    def _gradients(self) -> Expression:
        # By what rows are of, (rows.size, K).
        return self._slots.rows.slopes.map(self._slots.count)(*self._arguments)

    @property
    def slopes(self) -> Expression:
        """Derivatives (K, size) of the rows by z."""
        slots, size, known = self._slots, self._size, self._slots.rows.known
        found = self._begun.pulled(self._gradients[:known, :])
        if slots.order:
            asked = ca.repmat(ca.vec(self._gradients[known:, :]).T, slots.order, 1) * self._own_basis
            columns = np.repeat(np.arange(slots.count), slots.order * slots.inputs)
            target = ca.vec(self._own_places) + ca.DM(size * columns)
            found += ca.reshape(scattered(ca.vec(asked), target, size * slots.count), size, -1)
        return found.T

    def curvature(self, weights: Expression) -> tuple[Weighted, Expression]:
        """What weights (K,) of the rows weigh of the states and inputs at the begins, and second derivatives
        (size, size) of the weighted sum besides those that come by these.
        """
        slots, rows = self._slots, self._slots.rows
        states = self._begun.states.shape[0]
        on_states = self._gradients[:states, :] * ca.repmat(weights.T, states, 1)
        own, asked, across = rows.curvature.map(slots.count)(*self._arguments, weights.T)
        total = ca.MX(self._size, self._size)
        if rows.bent_asked:
            total += self._by_asked(asked)
        if rows.crossing:
            crossed = self._across(across)
            total += crossed + crossed.T
        return Weighted(self._begun, on_states, rows.bent, own), total

    @property
    def _bent_asked(self) -> list[int]:
        # Columns of the inputs asked for that are bent, among those of all slots.
        each = self._slots.inputs * np.arange(self._slots.count)
        columns: list[int] = (each[:, None] + np.array(self._slots.rows.bent_asked)).ravel().tolist()
        return columns

    def _by_asked(self, inner: Expression) -> Expression:
        # Second derivatives by what splines ask for, (bent asked, bent asked) each, by z.
        order, width = self._slots.order, inner.shape[0]
        basis, own = ca.SX.sym("basis", order), ca.SX.sym("inner", width, width)
        spread = ca.Function("spread", [basis, own], [ca.vec(ca.kron(own, basis @ basis.T))])
        entries = spread.map(self._slots.count)(self._basis, inner)
        places = ca.reshape(self._own_places[:, self._bent_asked], order * width, -1)
        rows = ca.repmat(places, order * width, 1)
        columns = places[np.repeat(np.arange(order * width), order * width).tolist(), :]
        return self._summed(entries, rows, columns)

    def _across(self, inner: Expression) -> Expression:
        # Those by what is known at the begins and by what splines ask for, (bent, bent asked) each, by z.
        begun, order, rows = self._begun, self._slots.order, self._slots.rows
        slope = ca.MX.sym("slope", self._size, len(rows.bent))
        own = ca.MX.sym("inner", len(rows.bent), len(rows.bent_asked))
        through = ca.Function("through", [slope, own], [slope @ own]).map(self._slots.count)
        each = through(begun.slopes[:, begun.of(rows.bent)], inner)
        basis = ca.vec(self._own_basis[:, self._bent_asked]).T
        repeated = np.repeat(np.arange(each.shape[1]), order).tolist()
        entries = each[:, repeated] * ca.repmat(basis, self._size, 1)
        columns = ca.repmat(ca.vec(self._own_places[:, self._bent_asked]).T, self._size, 1)
        places = ca.repmat(ca.DM(np.arange(self._size)), 1, columns.shape[1])
        return self._summed(entries, places, columns)

    def _summed(self, entries: Expression, rows: Expression, columns: Expression) -> Expression:
        # A matrix (size, size) with the sums of entries.
        target = ca.vec(rows + self._size * columns)
        return ca.reshape(scattered(ca.vec(entries), target, self._size**2), self._size, -1)
