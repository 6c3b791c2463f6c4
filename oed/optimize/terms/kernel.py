"""Pieces of a drive: what each does and gathers as a function of its start state and the coefficients in it.

First and second derivatives follow from those of the samples by the chain rule, for all pieces at once. As
everywhere, matrices stand side by side, and those by the unknowns are transposed: unknowns down the rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import casadi as ca
import numpy as np

from oed.foundation.arrays import Bools, Places
from oed.kernel.dynamics.expression import Expression
from oed.optimize.terms.cell import Cell
from oed.optimize.terms.layout import PieceLayout


class Kernel:
    """All pieces of a layout, sample by sample.

    The unknowns of a piece are its start state and the coefficients in it, input by input, in units of z.

    Attributes:
        cell: one sample.
        layout: the pieces.
        states: of the robot.
        size: unknowns of a piece.
        gathered: what a piece gathers: constants, and symbols (SX) elsewhere: sensitivities of its end by
            (parameters, its start), by columns, then information.
        symbols: those symbols: the sensitivities that change, then information that is not always 0.
        informed: which of the cell's entries of information are not always 0.
    """

    def __init__(self, cell: Cell, layout: PieceLayout, every: Sequence[int]) -> None:
        """Take the parts; every so many samples each sensor reads."""
        self.cell, self.layout = cell, layout
        self.states, self.inputs = cell.states, layout.inputs
        self.size = self.states + layout.inputs * layout.window
        self._count = layout.count * layout.samples
        place = np.arange(self._count) % layout.samples
        self.reads = ca.DM(np.array([place % one == 0 for one in every], float).reshape(-1, self._count))
        self.informed = [index for index, entry in enumerate(cell.gathered.elements()) if not entry.is_zero()]
        moving = len(cell.carry.moving)
        self.symbols = ca.SX.sym("gathered", moving + len(self.informed))
        information = ca.SX.zeros(cell.gathered.numel())
        information[self.informed] = self.symbols[moving:]
        self.gathered = ca.vertcat(ca.vec(cell.carry.table(self.symbols[:moving])), information)

    @property
    def row_count(self) -> int:
        """Limit rows of a piece, sample by sample."""
        return self.cell.row_count * self.layout.samples

    @cached_property
    def patterns(self) -> list[Bools]:
        """What depends on the start state: the end of what is handed on, information, the limit rows."""
        onward, gathered, rows = (np.array(ca.DM(one.pattern, 1.0)) != 0 for one in self.cell.slopes[:3])
        width, states = self.cell.width, self.states
        found = np.eye(width, states, dtype=bool)
        ever = found
        for _ in range(self.layout.samples):
            found = onward[:, :width] @ found
            ever = ever | found
        each = (rows[:, :width] @ ever).reshape(-1, states)
        return [found, gathered[self.informed, :width] @ ever, np.tile(each, (self.layout.samples, 1))]

    @cached_property
    def held_slopes(self) -> ca.DM:
        """Derivatives (size, inputs) of every sample's inputs by its piece's unknowns."""
        layout = self.layout
        basis = np.tile(layout.basis, (layout.space.runs, 1, 1)).reshape(self._count, layout.window)
        table = np.zeros((self._count, self.inputs, self.size))
        for one in range(self.inputs):
            first = self.states + one * layout.window
            table[:, one, first : first + layout.window] = basis
        return ca.DM(table.reshape(-1, self.size).T)

    def roll(self, begins: Expression, inputs: Expression) -> tuple[Expression, ...]:
        """What is handed on at every sample's begin (width, samples), the states that pieces end with, what
        pieces gather that changes, their rows.

        Args:
            begins: states that runs begin with.
            inputs: of every sample.
        """
        cell, count, space = self.cell, self.layout.count, self.layout.space
        ends = (np.arange(1, count + 1) * self.layout.samples - 1).tolist()
        if not cell.carry.moving:
            # Without sensitivities, which every piece begins anew, a run is a single pass.
            along = cell.values.mapaccum(space.samples).map(space.runs)
            following, gathered, rows = along(begins, inputs, self.reads)
            points = _shifted(begins, following, space.samples)
            states = following[:, ends]
        else:
            step = cell.step.mapaccum(space.samples).map(space.runs)
            states = step(begins, inputs)[:, ends]
            starts = _shifted(begins, states, self.layout.each)
            begin = ca.vertcat(starts, ca.repmat(ca.MX(cell.carry.begin), 1, count))
            along = cell.values.mapaccum(self.layout.samples).map(count)
            following, gathered, rows = along(begin, inputs, self.reads)
            points = _shifted(begin, following, self.layout.samples)
        total = ca.vertcat(following[self.states :, ends], self._added(gathered[self.informed, :]))
        return points, states, total, ca.reshape(rows, -1, count)

    def _added(self, each: Expression) -> Expression:
        # Sums over the samples of every piece.
        starts = list(range(0, self._count + 1, self.layout.samples))
        pattern = ca.Sparsity(self._count, self.layout.count, starts, list(range(self._count)))
        return each @ ca.DM(pattern, 1.0)

    def sample_slopes(self, points: Expression, inputs: Expression) -> tuple[Expression, ...]:
        """Entries of every sample's slopes (of what is handed on, gathered, of rows; by that and inputs)."""
        found: tuple[Expression, ...] = self.cell.jacobian.map(self._count)(points, inputs, self.reads)
        return found

    def steps(self, onward: Expression) -> tuple[Expression, Expression]:
        """Derivatives (size, width + inputs) of what is handed on and of the inputs at every sample's begin,
        and (size, width) of what is handed on at every piece's end.
        """
        width, samples, count = self.cell.width, self.layout.samples, self.layout.count
        step = self._product(0).mapaccum(samples).map(count)
        begin = ca.repmat(ca.DM(np.eye(self.size, width) * (np.arange(width) < self.states)), 1, count)
        following = step(begin, self.held_slopes, onward)
        ends = (np.arange(1, count + 1) * samples - 1)[:, None] * width + np.arange(width)
        columns = np.empty((self._count, width + self.inputs), dtype=int)
        columns[:, :width] = _order(count, samples)[:, None] * width + np.arange(width)
        held = (count + self._count) * width + np.arange(self._count * self.inputs)
        columns[:, width:] = held.reshape(self._count, self.inputs)
        both = ca.horzcat(begin, following, self.held_slopes)
        return both[:, columns.ravel().tolist()], following[:, ends.ravel().tolist()]

    def _product(self, part: int) -> ca.Function:
        packed, width = self.cell.slopes[part], self.cell.width
        slope, held = ca.MX.sym("slope", self.size, width), ca.MX.sym("held", self.size, self.inputs)
        entries = ca.MX.sym("entries", packed.pattern.nnz())
        whole = ca.horzcat(slope, held) @ packed.matrix(entries).T
        return ca.Function("product", [slope, held, entries], [ca.densify(whole)])

    def gathered_slopes(self, steps: Expression, gathered: Expression) -> Expression:
        """Derivatives (size, informed) of every piece's information."""
        samples = self.layout.samples
        pattern = ca.horzcat(*[self.cell.slopes[1].pattern] * samples)
        slopes = ca.MX.sym("slopes", self.size, pattern.size2())
        entries = ca.MX.sym("entries", self.cell.slopes[1].pattern.nnz(), samples)
        total = ca.densify(slopes @ ca.sparsity_cast(ca.vec(entries), pattern).T)
        whole = ca.Function("informed", [slopes, entries], [total[:, self.informed]])
        return whole.map(self.layout.count)(steps, gathered)

    def row_slopes(self, steps: Expression, rows: Expression) -> Expression:
        """Derivatives (size, rows) of every piece's rows."""
        packed = self.cell.slopes[2]
        if not packed.pattern.nnz():
            return ca.MX.zeros(self.size, self.cell.row_count * self._count)
        slope, entries = (
            ca.MX.sym("slope", self.size, packed.pattern.size2()),
            ca.MX.sym("e", packed.pattern.nnz()),
        )
        whole = ca.Function("rows", [slope, entries], [ca.densify(slope @ packed.matrix(entries).T)])
        return whole.map(self._count)(steps, rows)

    def curvature(
        self,
        given: Sequence[Expression],
        steps: Expression,
        slopes: Sequence[Expression],
        weights: Sequence[Expression],
    ) -> Expression:
        """Second derivatives (size, size) of every piece's weighted sum.

        Args:
            given: what is handed on, and the inputs, at every sample.
            steps: derivatives of what is handed on and of the inputs at every sample's begin.
            slopes: of the samples.
            weights: of the pieces' ends (states,), of what they gather (only what changes), of their rows.
        """
        cell, count, samples = self.cell, self.layout.count, self.layout.samples
        moving = len(cell.carry.moving)
        last = ca.vertcat(weights[0], weights[1][:moving, :])
        information = ca.MX(cell.gathered.numel(), count)
        information[self.informed, :] = weights[1][moving:, :]
        added = ca.densify(information)[:, np.repeat(np.arange(count), samples).tolist()]
        rows = ca.reshape(weights[2], cell.row_count, self._count)
        pulled = cell.pull.map(self._count)(*slopes[1:], added, rows)
        ends = self._weights(last, slopes[0], pulled)
        bent = cell.curvature.map(self._count)(*given, self.reads, ends, added, rows)
        width = cell.width + self.inputs
        columns = np.arange(self._count)[:, None] * width + np.array(cell.bent, dtype=int)
        return self._between.map(count)(steps[:, columns.ravel().tolist()], bent)

    @property
    def _between(self) -> ca.Function:
        # Second derivatives of all samples of a piece between the slopes of what is bent.
        inner, samples = self.cell.inner.pattern, self.layout.samples
        slopes = ca.MX.sym("slopes", self.size, inner.size1() * samples)
        entries = ca.MX.sym("entries", inner.nnz(), samples)
        whole = ca.sparsity_cast(ca.vec(entries), ca.diagcat(*[inner] * samples))
        return ca.Function("between", [slopes, entries], [slopes @ ca.densify(slopes @ whole).T])

    def _weights(self, last: Expression, onward: Expression, pulled: Expression) -> Expression:
        # Weights of every sample's end: those of its piece's end, and what later samples add.
        cell, count, samples = self.cell, self.layout.count, self.layout.samples
        order = np.arange(self._count).reshape(count, samples)[:, ::-1].ravel().tolist()
        back = cell.back.mapaccum(samples).map(count)
        begins = back(last, onward[:, order], pulled[:, order])
        return _shifted(last, begins, samples)[:, order]


def _shifted(begin: Expression, following: Expression, each: int) -> Expression:
    # What parts of a sequence begin with: what the sequences begin with, then what `each` parts end with.
    order = _order(begin.shape[1], each)
    return ca.horzcat(begin, following)[:, order.tolist()]


def _order(count: int, each: int) -> Places:
    # Where every part's begin stands among those of the sequences, and behind them the parts' ends.
    order = np.empty((count, each), dtype=np.int64)
    order[:, 0] = np.arange(count)
    order[:, 1:] = count + np.arange(count)[:, None] * each + np.arange(each - 1)
    return order.ravel()
