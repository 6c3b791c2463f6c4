"""Pieces of a drive: what each does and gathers as a function of its start state and the coefficients in it.

First and second derivatives follow from those of the samples by the chain rule, for all pieces at once. As
everywhere, matrices stand side by side, and those by the unknowns are transposed: unknowns down the rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array, Bools, block_columns
from oed.kernel.dynamics.expression import Expression
from oed.optimize.terms.blocks import Packed, backwards, begins
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

    def __init__(self, cell: Cell, layout: PieceLayout, reads: Array) -> None:
        """Take the parts; `reads` says what a piece's samples know of readings, (..., samples)."""
        self.cell, self.layout = cell, layout
        self.states, self.inputs = cell.states, layout.inputs
        self.size = self.states + layout.own
        self._count = layout.count * layout.samples
        self.reads = ca.DM(np.tile(reads, layout.count))
        self.informed = [index for index, entry in enumerate(cell.gathered.elements()) if not entry.is_zero()]
        moving = len(cell.carry.moving)
        self.symbols = ca.SX.sym("gathered", moving + len(self.informed))
        information = ca.SX.zeros(cell.gathered.numel())
        information[self.informed] = self.symbols[moving:]
        self.gathered = ca.vertcat(cell.carry.lasting(self.symbols[:moving]), information)

    @cached_property
    def patterns(self) -> list[Bools]:
        """What depends on the start state: the end of what is handed on, information."""
        onward, gathered = (np.array(ca.DM(one.pattern, 1.0)) != 0 for one in self.cell.slopes)
        width, states = self.cell.width, self.states
        found = np.eye(width, states, dtype=bool)
        ever = found
        for _ in range(self.layout.samples):
            found = onward[:, :width] @ found
            ever = ever | found
        return [found, gathered[self.informed, :width] @ ever]

    @cached_property
    def held_slopes(self) -> ca.DM:
        """Derivatives (size, inputs) of every sample's inputs by its piece's unknowns."""
        layout = self.layout
        basis = np.tile(layout.basis, (layout.space.runs, 1, 1, 1))
        table = np.zeros((self._count, self.inputs, self.size))
        table[:, :, self.states :] = basis.reshape(self._count, self.inputs, layout.own)
        return ca.DM(table.reshape(-1, self.size).T)

    def roll(self, values: ca.Function, first: Expression, inputs: Expression) -> tuple[Expression, ...]:
        """What is handed on at every sample's begin (width, samples), the states that pieces end with, what
        pieces gather that changes, and what else is said of every sample.

        Args:
            values: the cell's function that says so of a sample.
            first: states that runs begin with, (states, runs).
            inputs: of every sample, (inputs, samples).
        """
        cell, count, space = self.cell, self.layout.count, self.layout.space
        ends = (np.arange(1, count + 1) * self.layout.samples - 1).tolist()
        if not cell.carry.moving:
            # Without sensitivities, which every piece begins anew, a run is a single pass.
            along = values.mapaccum(space.samples).map(space.runs)
            following, gathered, *more = along(first, inputs, self.reads)
            points = begins(first, following, space.samples)
            states = following[:, ends]
        else:
            step = cell.step.mapaccum(space.samples).map(space.runs)
            states = step(first, inputs)[:, ends]
            starts = begins(first, states, self.layout.each)
            begin = ca.vertcat(starts, ca.repmat(ca.MX(cell.carry.begin), 1, count))
            along = values.mapaccum(self.layout.samples).map(count)
            following, gathered, *more = along(begin, inputs, self.reads)
            points = begins(begin, following, self.layout.samples)
        total = ca.vertcat(following[self.states :, ends], self._added(gathered[self.informed, :]))
        return points, states, total, *more

    def _added(self, each: Expression) -> Expression:
        # Sums over the samples of every piece.
        starts = list(range(0, self._count + 1, self.layout.samples))
        pattern = ca.Sparsity(self._count, self.layout.count, starts, list(range(self._count)))
        return each @ ca.DM(pattern, 1.0)

    def sample_slopes(self, points: Expression, inputs: Expression) -> tuple[Expression, ...]:
        """Entries of every sample's slopes (of what is handed on, of what is gathered; by both)."""
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
        ends = block_columns(np.arange(1, count + 1) * samples - 1, width)
        points = begins(begin, following, samples, width)
        # Of every sample its point, then its inputs.
        columns = np.empty((self._count, width + self.inputs), dtype=int)
        columns[:, :width] = np.arange(self._count * width).reshape(self._count, width)
        columns[:, width:] = points.shape[1] + np.arange(self._count * self.inputs).reshape(self._count, -1)
        return ca.horzcat(points, self.held_slopes)[:, columns.ravel().tolist()], following[:, ends]

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

    def curvature(
        self,
        given: Sequence[Expression],
        steps: Expression,
        slopes: Sequence[Expression],
        weights: Sequence[Expression],
        more: Expression | None,
    ) -> Expression:
        """Second derivatives (size, size) of every piece's weighted sum.

        Args:
            given: what is handed on, and the inputs, at every sample.
            steps: derivatives of what is handed on and of the inputs at every sample's begin.
            slopes: of the samples.
            weights: of the pieces' ends (states,), of what they gather (only what changes).
            more: what else weighs what is handed on at every sample's begin, (width, samples), if anything.
        """
        cell, count, samples = self.cell, self.layout.count, self.layout.samples
        moving = len(cell.carry.moving)
        last = ca.vertcat(weights[0], weights[1][:moving, :])
        information = ca.MX(cell.gathered.numel(), count)
        information[self.informed, :] = weights[1][moving:, :]
        added = ca.densify(information)[:, np.repeat(np.arange(count), samples).tolist()]
        pulled = cell.pull.map(self._count)(slopes[1], added)
        pulled = pulled if more is None else pulled + more
        # Of every sample's end: what its piece's end weighs, and what later samples add.
        onward = backwards(slopes[0], samples)
        back = cell.slopes[0].back().mapaccum(samples).map(count)
        earlier = back(last, onward, backwards(pulled, samples))
        ends = backwards(begins(last, earlier, samples), samples)
        bent = cell.curvature.map(self._count)(*given, self.reads, ends, added)
        if not cell.bent_slopes:
            width = cell.width + self.inputs
            columns = np.arange(self._count)[:, None] * width + np.array(cell.bent, dtype=int)
            return self._between.map(count)(steps[:, columns.ravel().tolist()], bent)
        own = cell.bent_jacobian.map(self._count)(*given, self.reads)
        each = [one.chained(steps, entries) for one, entries in zip(cell.bent_slopes, own, strict=True)]
        return self._between_halves.map(count)(*map(ca.densify, each), *bent)

    @property
    def _between(self) -> ca.Function:
        # Second derivatives of all samples of a piece between the slopes of what is bent.
        (inner,) = self.cell.inner
        slopes, entries, whole = self._along(inner)
        return ca.Function("between", [slopes, entries], [slopes @ ca.densify(slopes @ whole).T])

    @property
    def _between_halves(self) -> ca.Function:
        # The same of halves: (slopes of what is bent, of what is beside, entries of both).
        parts = [self._along(one) for one in self.cell.inner]
        half = sum(slopes @ whole for slopes, _, whole in parts)
        found = parts[0][0] @ ca.densify(half).T
        slopes, entries, _ = zip(*parts, strict=True)
        return ca.Function("between", [*slopes, *entries], [found + found.T])

    def _along(self, inner: Packed) -> tuple[Expression, Expression, Expression]:
        # Symbols for slopes at all samples of a piece and for entries there, and these as one matrix.
        samples = self.layout.samples
        slopes = ca.MX.sym("slopes", self.size, inner.pattern.size1() * samples)
        entries = ca.MX.sym("entries", inner.pattern.nnz(), samples)
        whole = ca.sparsity_cast(ca.vec(entries), ca.diagcat(*[inner.pattern] * samples))
        return slopes, entries, whole
