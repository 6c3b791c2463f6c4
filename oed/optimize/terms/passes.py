"""One evaluation of the terms of a drive in pieces: forwards through the pieces, and back with weights."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.kernel.dynamics.embedding import without_zeros
from oed.kernel.dynamics.expression import Expression
from oed.kernel.problem import Problem
from oed.optimize.terms.base import Smooth, Terms, symmetric
from oed.optimize.terms.blocks import begins
from oed.optimize.terms.cell import read_end
from oed.optimize.terms.condensing import Condensing
from oed.optimize.terms.kernel import Kernel
from oed.optimize.terms.layout import PieceLayout
from oed.optimize.terms.link import Link
from oed.optimize.terms.piece_rows import PieceRows
from oed.optimize.terms.totals import Totals


class Ending:
    """The information of what is read at a run's last instant, after all its pieces, as a function of what is
    handed on and of the last inputs.
    """

    def __init__(self, problem: Problem, link: Link, size: int, scale: Sequence[float]) -> None:
        """Write it."""
        state = ca.SX.sym("state", link.width)
        held = ca.SX.sym("held", len(problem.system.inputs))
        gathered = read_end(problem, ca.DM(list(scale)) * held, state[: link.states])
        carry = link.carry
        turned = carry.turned(symmetric(gathered, carry.gathered_size), carry.whole(state[link.states :]))
        self._arguments, self._gathered = [state, held], ca.cse(turned)
        self._width = link.width
        self._slopes = ca.SX.sym("slopes", size, link.width + held.shape[0])

    @cached_property
    def values(self) -> ca.Function:
        """(state handed on, held) -> information."""
        return ca.Function("ending", self._arguments, [self._gathered])

    @cached_property
    def slopes(self) -> ca.Function:
        """(the same, their derivatives by z) -> derivatives (size, added) of the information by z."""
        slope = self._slopes @ ca.jacobian(self._gathered, ca.vertcat(*self._arguments)).T
        return ca.Function("ending_slopes", [*self._arguments, self._slopes], [ca.densify(slope)])

    @cached_property
    def curvature(self) -> ca.Function:
        """(the same, weights of the information) -> weights of the state, second derivatives by z."""
        weights = ca.SX.sym("weights", self._gathered.shape[0])
        bent, slope = ca.hessian(ca.dot(weights, self._gathered), ca.vertcat(*self._arguments))
        whole: Expression = self._slopes @ bent @ self._slopes.T
        results = [ca.densify(slope[: self._width, :]), ca.densify(whole)]
        return ca.Function("ending_curvature", [*self._arguments, self._slopes, weights], results)


@dataclass(frozen=True)
class Plan:
    """The parts of which a drive's terms are put together.

    Attributes:
        terms: what they are of, and z.
        layout: the pieces.
        kernel: one of them.
        link: what it hands on.
        total: what they add up to.
        rows: the limits' rows.
    """

    terms: Terms
    layout: PieceLayout
    kernel: Kernel
    link: Link
    total: Totals
    rows: PieceRows

    @cached_property
    def condensing(self) -> Condensing:
        """How the pieces follow each other."""
        return Condensing(self.link, self.terms.size, self.layout)

    @cached_property
    def ending(self) -> Ending | None:
        """What is read at the runs' last instants; None of regressions."""
        return (
            Ending(self.terms.problem, self.link, self.terms.size, self.kernel.cell.scale)
            if self.total.sensors
            else None
        )

    @cached_property
    def first(self) -> Smooth:
        """Rows of a run's first instant, of its start state."""
        return Smooth(self.rows.start_symbol, self.rows.first)


class Sweep:
    """The terms at z as expressions (MX), every intermediate result once.

    Attributes:
        z: the unknowns.
    """

    def __init__(self, plan: Plan, *, scoring: bool = False) -> None:
        """Begin with z; `scoring` for `entries` and `worst` alone."""
        self.plan, self.z, self._scoring = plan, ca.MX.sym("z", plan.terms.size), scoring
        self._kernel, self._link, self._join = plan.kernel, plan.link, plan.condensing
        self._size = plan.terms.size
        self._count, self._runs = plan.layout.count, plan.layout.space.runs

    @cached_property
    def _inputs(self) -> Expression:
        # Held in every sample, (inputs, samples), in units of their scale.
        embedding = self.plan.terms.embedding
        return embedding.by_runs([without_zeros(one) for one in embedding.own_held], self.z).T

    @cached_property
    def _starts(self) -> Expression:
        # Of the runs, (states, runs).
        terms, states = self.plan.terms, self._kernel.states
        constant = ca.evalf(ca.substitute(terms.starts.T, terms.unknowns, ca.DM.zeros(self._size)))
        moved = without_zeros(terms.start_slopes.reshape(-1, self._size)) @ self.z
        return ca.densify(ca.MX(constant) + ca.reshape(moved, states, self._runs))

    @cached_property
    def _start_slopes(self) -> list[Array]:
        # Of what each run begins with, by z: (size, width).
        width = self._link.width - self._kernel.states
        return [np.pad(one.T, ((0, 0), (0, width))) for one in self.plan.terms.start_slopes]

    @cached_property
    def _states(self) -> Expression:
        # Of every piece the begin, then the runs' ends.
        return self._with_ends(self._starts, self._rolled[1])

    def _with_ends(self, begin: Expression, following: Expression) -> Expression:
        each = self.plan.layout.each
        last = following[:, [each * (run + 1) - 1 for run in range(self._runs)]]
        return ca.horzcat(begins(begin, following, each), last)

    @cached_property
    def _rolled(self) -> tuple[Expression, ...]:
        # What is handed on at every sample's begin, the pieces' end states, what they gather, their rows.
        cell = self._kernel.cell
        return self._kernel.roll(cell.scored if self._scoring else cell.values, self._starts, self._inputs)

    @cached_property
    def _carried(self) -> Expression:
        # The sensitivities at every piece's begin, then at the runs' ends.
        link, layout = self._link, self.plan.layout
        if not link.carry.moving:
            return ca.MX(0, self._count + self._runs)
        begin = ca.repmat(ca.MX(link.carry.begin), 1, self._runs)
        follow = link.follow.mapaccum(layout.each).map(self._runs)
        return self._with_ends(begin, follow(begin, self._rolled[2]))

    @cached_property
    def _arguments(self) -> list[Expression]:
        return [self._carried[:, : self._count], self._rolled[2]]

    @cached_property
    def _end_arguments(self) -> list[Expression]:
        # Of the runs' ends: state handed on, inputs held until then.
        held = self._inputs[:, [self.plan.layout.space.samples * (run + 1) - 1 for run in range(self._runs)]]
        return [ca.vertcat(self._states, self._carried)[:, self._count :], held]

    @cached_property
    def _last_held(self) -> Array:
        # The inputs held at the runs' ends by z, (runs * inputs, size).
        layout, inputs = self.plan.layout, self._kernel.inputs
        found = np.zeros((self._runs, inputs, self._size))
        for run in range(self._runs):
            found[run][:, layout.places[(run + 1) * layout.each - 1]] = layout.basis[-1, -1]
        return found.reshape(-1, self._size)

    @cached_property
    def _groups(self) -> Expression:
        added = self._link.add.map(self._count)(*self._arguments) @ self.plan.total.membership
        ending = self.plan.ending
        return added if ending is None else added + ending.values.map(self._runs)(*self._end_arguments)

    @cached_property
    def _sums(self) -> Expression:
        return self.plan.total.sums(self._groups)

    @property
    def entries(self) -> Expression:
        """The matrices' entries."""
        return self.plan.total.finish.values(self._sums)

    @property
    def rows(self) -> Expression:
        """The limits' rows."""
        return self.plan.rows.values(self.z, self._first, ca.reshape(self._rolled[3], -1, self._count))

    @property
    def _first(self) -> Expression:
        return self.plan.first.values.map(self._runs)(self._starts)

    @property
    def worst(self) -> list[Expression]:
        """The excess of every limit's rows, where `whole_samples` count."""
        return self.plan.rows.excesses(self.z, self._first, self._rolled[3])

    @cached_property
    def _sample_slopes(self) -> tuple[Expression, ...]:
        return self._kernel.sample_slopes(self._rolled[0], self._inputs)

    @cached_property
    def _steps(self) -> tuple[Expression, Expression]:
        return self._kernel.steps(self._sample_slopes[0])

    @cached_property
    def _piece_slopes(self) -> list[Expression]:
        # Of what pieces hand on, and of their information.
        return [self._steps[1], self._kernel.gathered_slopes(self._steps[0], self._sample_slopes[1])]

    @cached_property
    def _piece_rows(self) -> tuple[Expression, Expression]:
        # Slopes of the pieces' rows by start state (entries) and by own coefficients.
        slopes = self._kernel.row_slopes(self._steps[0], self._sample_slopes[2])
        states = self._kernel.states
        return self._link.row_slopes.map(self._count)(slopes[:states, :]), slopes[states:, :]

    @cached_property
    def _link_slopes(self) -> tuple[Expression, ...]:
        function = self._link.jacobian.map(self._count)
        found: tuple[Expression, ...] = function(*self._arguments, *self._piece_slopes)
        return found

    @cached_property
    def _slopes(self) -> Expression:
        onward, moved, *_ = self._link_slopes
        return self._join.slopes(ca.MX(ca.DM(np.hstack(self._start_slopes))), onward, moved)

    @property
    def _begin_slopes(self) -> Expression:
        return self._slopes[:, : self._link.width * self._count]

    @cached_property
    def _end_slopes(self) -> list[Expression]:
        # (handed on, held) at the runs' ends by z, (size, width + inputs) each.
        held = np.split(self._last_held.T, self._runs, axis=1)
        first, width = self._link.width * self._count, self._link.width
        ends = [self._slopes[:, first + run * width : first + (run + 1) * width] for run in range(self._runs)]
        return [ca.horzcat(*(ca.horzcat(end, ca.DM(own)) for end, own in zip(ends, held, strict=True)))]

    @cached_property
    def _group_slopes(self) -> Expression:
        _, _, begin, own = self._link_slopes
        link, join = self._link, self._join
        added = link.added_by_begin.chained(self._begin_slopes, begin)
        added = ca.densify(added + join.spread(own, link.added))
        total = ca.reshape(added, self._size * link.added, self._count) @ self.plan.total.membership
        ending = self.plan.ending
        if ending is None:
            return total
        more = ending.slopes.map(self._runs)(*self._end_arguments, *self._end_slopes)
        return total + ca.reshape(more, self._size * link.added, self._runs)

    @cached_property
    def _sum_slopes(self) -> Expression:
        return self.plan.total.sums_slopes(self._groups, self._group_slopes)

    @property
    def entry_slopes(self) -> Expression:
        """Derivatives of the entries by z."""
        return self.plan.total.finish.slope(self._sums) @ self._sum_slopes.T

    @property
    def row_slopes(self) -> Expression:
        """Derivatives of the rows by z."""
        begin, own = self._piece_rows
        rows = self._link.rows_by_begin.chained(self._begin_slopes, begin)
        rows = ca.densify(rows + self._join.spread(own, self._kernel.row_count))
        slopes = self.plan.first.slope.map(self._runs)(self._starts)
        first = [start @ self._of_run(slopes, run).T for run, start in self._starts_by_unknowns]
        return self.plan.rows.slopes(ca.horzcat(*first), rows)

    @property
    def _starts_by_unknowns(self) -> Iterable[tuple[int, ca.DM]]:
        # Derivatives of every run's start state by z, (size, states).
        return enumerate(map(ca.DM, self.plan.terms.start_slopes.transpose(0, 2, 1)))

    def _of_run(self, table: Expression, run: int) -> Expression:
        # A run's columns, by its start state.
        states = self._kernel.states
        return table[:, run * states : (run + 1) * states]

    def curvature(self, entries: Expression, rows: Expression) -> Expression:
        """Second derivatives by z of the weighted sum of entries and rows."""
        plan, link, join, count = self.plan, self._link, self._join, self._count
        weights, bent = plan.total.finish.curvature(self._sums, entries)
        total = self._sum_slopes @ bent @ self._sum_slopes.T if bent.nnz() else 0
        groups, square = plan.total.weights(self._groups, weights)
        if square is not None:
            total += plan.total.bent(self._group_slopes, square)
        first, own_rows = plan.rows.weights(rows)
        last, more = self._end_curvature(groups)
        added = groups[:, plan.total.group.tolist()]
        begin, begin_rows = self._link_slopes[2], self._piece_rows[0]
        pulled = link.pull.map(count)(begin, begin_rows, added, own_rows)
        ends = join.weights(last, self._link_slopes[0], pulled)
        states, carried = ends[: self._kernel.states, :], ends[self._kernel.states :, :]
        gathered = link.pull_gathered.map(count)(*self._arguments, carried, added)
        given, steps = [self._rolled[0], self._inputs], self._steps[0]
        own = self._kernel.curvature(given, steps, self._sample_slopes, [states, gathered, own_rows])
        parts = link.hessian.map(count)(*self._arguments, carried, added, *self._piece_slopes, own)
        return total + more + self._first_curvature(first) + join.curvature(self._begin_slopes, *parts)

    def _end_curvature(self, groups: Expression) -> tuple[Expression, Expression]:
        # Weights of what the runs end with, and second derivatives of what is read there.
        ending = self.plan.ending
        if ending is None:
            return ca.MX.zeros(self._link.width, self._runs), 0
        weights, parts = ending.curvature.map(self._runs)(*self._end_arguments, *self._end_slopes, groups)
        return weights, sum(ca.horzsplit(parts, self._size))

    def _first_curvature(self, weights: Expression) -> Expression:
        if not self.plan.rows.first.numel():
            return 0
        _, bent = self.plan.first.curvature.map(self._runs)(self._starts, weights)
        parts = (start @ self._of_run(bent, run) @ start.T for run, start in self._starts_by_unknowns)
        return sum(parts)
