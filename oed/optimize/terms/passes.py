"""One evaluation of the terms of a drive in pieces: forwards through the pieces, and back with weights."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.kernel.dynamics.embedding import without_zeros
from oed.kernel.dynamics.expression import Expression
from oed.optimize.terms.begun import Begun, Weighted, first_entries, gathered, scattered
from oed.optimize.terms.blocks import begins
from oed.optimize.terms.plan import Plan


class Sweep:
    """The terms at z as expressions (MX), every intermediate result once.

    Attributes:
        z: the unknowns.
    """

    def __init__(self, plan: Plan, values: ca.Function | None = None) -> None:
        """Begin with z; `values` may be the cell's function that says more of every sample than its own."""
        self.plan, self.z = plan, ca.MX.sym("z", plan.terms.size)
        self._values = plan.kernel.cell.values if values is None else values
        self._kernel, self._link, self._join = plan.kernel, plan.link, plan.condensing
        self._size, self._unknowns = plan.terms.size, plan.unknowns
        self._count, self._runs = plan.layout.count, plan.layout.space.runs

    @cached_property
    def inputs(self) -> Expression:
        """Held in every sample, (inputs, samples), in units of their scale."""
        embedding = self.plan.terms.embedding
        return embedding.by_runs([without_zeros(one) for one in embedding.own_held], self.z).T

    @cached_property
    def starts(self) -> Expression:
        """Of the runs, (states, runs)."""
        terms, states = self.plan.terms, self._kernel.states
        constant = ca.evalf(ca.substitute(terms.starts.T, terms.unknowns, ca.DM.zeros(self._size)))
        moved = without_zeros(terms.start_slopes.reshape(-1, self._size)) @ self.z
        return ca.densify(ca.MX(constant) + ca.reshape(moved, states, self._runs))

    @cached_property
    def _start_slopes(self) -> list[Array]:
        # Of what each run begins with, by its unknowns: (per run, width).
        width = self._link.width - self._kernel.states
        runs = zip(self.plan.terms.start_slopes, self._unknowns.places, strict=True)
        return [np.pad(one[:, places].T, ((0, 0), (0, width))) for one, places in runs]

    @cached_property
    def _states(self) -> Expression:
        # Of every piece the begin, then the runs' ends.
        return self._with_ends(self.starts, self.rolled[1])

    def _with_ends(self, begin: Expression, following: Expression) -> Expression:
        each = self.plan.layout.each
        last = following[:, [each * (run + 1) - 1 for run in range(self._runs)]]
        return ca.horzcat(begins(begin, following, each), last)

    @cached_property
    def rolled(self) -> tuple[Expression, ...]:
        """What is handed on at every sample's begin, the pieces' end states, what they gather, and more."""
        return self._kernel.roll(self._values, self.starts, self.inputs)

    @cached_property
    def _carried(self) -> Expression:
        # The sensitivities at every piece's begin, then at the runs' ends.
        link, layout = self._link, self.plan.layout
        if not link.carry.moving:
            return ca.MX(0, self._count + self._runs)
        begin = ca.repmat(ca.MX(link.carry.begin), 1, self._runs)
        follow = link.follow.mapaccum(layout.each).map(self._runs)
        return self._with_ends(begin, follow(begin, self.rolled[2]))

    @cached_property
    def _arguments(self) -> list[Expression]:
        return [self._carried[:, : self._count], self.rolled[2]]

    @cached_property
    def _end_arguments(self) -> list[Expression]:
        # Of the runs' ends: state handed on, inputs held until then.
        held = self.inputs[:, [self.plan.layout.space.samples * (run + 1) - 1 for run in range(self._runs)]]
        return [ca.vertcat(self._states, self._carried)[:, self._count :], held]

    @cached_property
    def _last_held(self) -> Array:
        # The inputs held at a run's end by its unknowns, (per run, inputs).
        layout = self.plan.layout
        found = np.zeros((self._unknowns.per_run, self._kernel.inputs))
        found[layout.within[-1]] = layout.basis[-1, -1].T
        return found

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

    @cached_property
    def _sample_slopes(self) -> tuple[Expression, ...]:
        return self._kernel.sample_slopes(self.rolled[0], self.inputs)

    @cached_property
    def steps(self) -> tuple[Expression, Expression]:
        """By the pieces' own unknowns, as of `Kernel.steps`."""
        return self._kernel.steps(self._sample_slopes[0])

    @cached_property
    def _piece_slopes(self) -> list[Expression]:
        # Of what pieces hand on, and of their information.
        return [self.steps[1], self._kernel.gathered_slopes(self.steps[0], self._sample_slopes[1])]

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
    def begin_slopes(self) -> Expression:
        """Derivatives of what is handed on at every piece's begin, by its run's unknowns, (per run, width *
        pieces).
        """
        return self._slopes[:, : self._link.width * self._count]

    @cached_property
    def _end_slopes(self) -> list[Expression]:
        # (handed on, held) at the runs' ends by their unknowns, (per run, width + inputs) each.
        first, width = self._link.width * self._count, self._link.width
        ends = [self._slopes[:, first + run * width : first + (run + 1) * width] for run in range(self._runs)]
        return [ca.horzcat(*(ca.horzcat(end, ca.DM(self._last_held)) for end in ends))]

    @cached_property
    def _group_slopes(self) -> Expression:
        # By z, (size * added, groups).
        _, _, begin, own = self._link_slopes
        link, join, unknowns = self._link, self._join, self._unknowns
        added = link.added_by_begin.chained(self.begin_slopes, begin)
        added = ca.densify(added + join.spread(own, link.added))
        parts, together = self.plan.total.by_runs
        total = ca.reshape(added, unknowns.per_run * link.added, self._count) @ parts
        ending = self.plan.ending
        if ending is not None:
            more = ending.slopes.map(self._runs)(*self._end_arguments, *self._end_slopes)
            total += ca.reshape(more, unknowns.per_run * link.added, self._runs)
        wide = unknowns.wide(ca.reshape(total, unknowns.per_run, -1))
        return ca.reshape(wide, self._size * link.added, parts.shape[1]) @ together

    @cached_property
    def _sum_slopes(self) -> Expression:
        return self.plan.total.sums_slopes(self._groups, self._group_slopes)

    @property
    def entry_slopes(self) -> Expression:
        """Derivatives of the entries by z."""
        return self.plan.total.finish.slope(self._sums) @ self._sum_slopes.T

    def curvature(self, entries: Expression, begun: Sequence[Weighted] = ()) -> Expression:
        """Second derivatives by z of the weighted sum of entries and of what is known at samples' begins.

        Args:
            entries: weights of the entries.
            begun: samples, and what rows weigh of their begins.
        """
        plan, link, join, count = self.plan, self._link, self._join, self._count
        weights, bent = plan.total.finish.curvature(self._sums, entries)
        total = self._sum_slopes @ bent @ self._sum_slopes.T if bent.nnz() else 0
        groups, square = plan.total.weights(self._groups, weights)
        if square is not None:
            total += plan.total.bent(self._group_slopes, square)
        last, more = self._end_curvature(groups)
        added = groups[:, plan.total.group.tolist()]
        pulled = link.pull.map(count)(self._link_slopes[2], added)
        on_begins, on_samples, inner = self._weighted(begun)
        pulled = pulled if on_begins is None else pulled + on_begins
        ends = join.weights(last, self._link_slopes[0], pulled)
        following, carried = ends[: self._kernel.states, :], ends[self._kernel.states :, :]
        weighted = link.pull_gathered.map(count)(*self._arguments, carried, added)
        given, steps = [self.rolled[0], self.inputs], self.steps[0]
        own = self._kernel.curvature(given, steps, self._sample_slopes, [following, weighted], on_samples)
        own = own if inner is None else own + inner
        parts = link.hessian.map(count)(*self._arguments, carried, added, *self._piece_slopes, own)
        return total + more + join.curvature(self.begin_slopes, *parts)

    def _weighted(self, begun: Sequence[Weighted]) -> list[Expression | None]:
        # What they add to weights of the pieces' begins and of the samples', and to second derivatives by the
        # pieces' own unknowns.
        found: list[Expression | None] = [None, None, None]
        for one in begun:
            assert isinstance(one.begun, BegunInPieces)
            more = [*one.begun.weighted(one.states), one.begun.inner(one) if one.bent else None]
            found = [a if b is None else b if a is None else a + b for a, b in zip(found, more, strict=True)]
        return found

    def _end_curvature(self, groups: Expression) -> tuple[Expression, Expression]:
        # Weights of what the runs end with, and second derivatives of what is read there.
        ending = self.plan.ending
        if ending is None:
            return ca.MX.zeros(self._link.width, self._runs), 0
        weights, parts = ending.curvature.map(self._runs)(*self._end_arguments, *self._end_slopes, groups)
        return weights, self._unknowns.square(parts)

    def begun(self, samples: Expression) -> BegunInPieces:
        """What is known at the begins of some samples (1, K), counted through all runs."""
        return BegunInPieces(self, samples)


class BegunInPieces(Begun):
    """What a sweep knows at the begins of some samples.

    Args:
        sweep: through the pieces.
        samples: which, (1, K).
    """

    def __init__(self, sweep: Sweep, samples: Expression) -> None:
        """Take both."""
        self._sweep, self._samples, self._count = sweep, samples, samples.shape[1]
        plan = sweep.plan
        self._kernel, self._layout, self._link = plan.kernel, plan.layout, plan.link
        self._states, self._inputs = self._kernel.states, self._kernel.inputs
        self._piece = ca.floor(samples / self._layout.samples)
        self._unknowns = plan.unknowns
        self.states = gathered(sweep.rolled[0], first_entries(samples, self._kernel.cell.width, self._states))
        self.held = gathered(sweep.inputs, first_entries(samples, self._inputs, self._inputs))

    @cached_property
    def _steps(self) -> Expression:
        # Derivatives of states and inputs held by what their piece begins with and its own unknowns,
        # (size of a piece, (states + inputs) K).
        kernel = self._kernel
        size, width = kernel.size, kernel.cell.width
        columns = [*range(self._states), *range(width, width + self._inputs)]
        inner = ca.DM((np.array(columns)[:, None] * size + np.arange(size)).ravel())
        base = size * (width + self._inputs) * self._samples
        places = ca.repmat(base, inner.shape[0], 1) + ca.repmat(inner, 1, self._count)
        return ca.reshape(gathered(self._sweep.steps[0], places), size, -1)

    @cached_property
    def _begins(self) -> Expression:
        # Derivatives of the states that their pieces begin with by the runs' unknowns, (per run, states K).
        size = self._unknowns.per_run
        begins = first_entries(self._piece, self._link.width, self._states)
        whole = gathered(self._sweep.begin_slopes, first_entries(ca.vec(begins).T, size, size))
        return ca.reshape(whole, size, -1)

    @cached_property
    def _own_places(self) -> Expression:
        # Of their pieces' own unknowns in z, (own, K).
        acting = self._layout.own
        return gathered(ca.DM(self._layout.places.T), first_entries(self._piece, acting, acting))

    @cached_property
    def _run_places(self) -> Expression:
        # Of their runs' unknowns in z, (per run, K).
        run, own = ca.floor(self._piece / self._layout.each), self._unknowns.per_run
        return gathered(ca.DM(self._unknowns.places.T), first_entries(run, own, own))

    @cached_property
    def slopes(self) -> Expression:
        """Derivatives by z."""
        by_begin, own = self._steps[: self._states, :], self._steps[self._states :, :]
        through = _through(self._unknowns.per_run, self._states, self.each).map(self._count)
        return self._by_z(through(self._begins, by_begin), own)

    def pulled(self, gradients: Expression) -> Expression:
        """Derivatives by z of rows, of which those by states and inputs are given."""
        local = _through(self._kernel.size, self.each).map(self._count)(self._steps, gradients)
        by_begin, own = local[: self._states, :], local[self._states :, :]
        through = _through(self._unknowns.per_run, self._states).map(self._count)
        return self._by_z(through(self._begins, by_begin), own)

    def _by_z(self, by_run: Expression, own: Expression) -> Expression:
        # Derivatives (size, n) by z, as many of every sample: the sum of those by the unknowns of its run
        # (per run, n) and of its piece (own, n). Of a run that has all unknowns nothing need be moved.
        size, columns = self._sweep.plan.terms.size, own.shape[1]
        each, shifts = np.repeat(np.arange(self._count), columns // self._count).tolist(), np.arange(columns)
        entries, places = own, self._own_places[:, each]
        if not self._unknowns.common:
            entries, places = ca.vertcat(by_run, own), ca.vertcat(self._run_places[:, each], places)
        target = places + ca.repmat(ca.DM(size * shifts[None, :]), places.shape[0], 1)
        total = ca.reshape(scattered(ca.vec(entries), ca.vec(target), size * columns), size, -1)
        return total + by_run if self._unknowns.common else total

    def inner(self, weighted: Weighted) -> Expression:
        """Second derivatives by the pieces' own unknowns, (size, size) of each piece."""
        size, width, count = self._kernel.size, len(weighted.bent), self._layout.count
        slope, own = ca.MX.sym("slope", size, width), ca.MX.sym("inner", width, width)
        each = ca.Function("between", [slope, own], [slope @ own @ slope.T]).map(self._count)
        entries = each(self._steps[:, self.of(weighted.bent)], weighted.inner)
        places = first_entries(self._piece, size**2, size**2)
        return ca.reshape(scattered(ca.vec(entries), ca.vec(places), size**2 * count), size, -1)

    def weighted(self, weights: Expression) -> tuple[Expression, Expression]:
        """What weights (states, K) of the states add to those of what pieces begin with, and samples."""
        width, cell = self._link.width, self._kernel.cell.width
        each = self._states + self._inputs
        columns = (np.arange(self._count)[:, None] * each + np.arange(self._states)).ravel().tolist()
        matrix, weight = ca.MX.sym("matrix", self._states, self._states), ca.MX.sym("weight", self._states)
        back = ca.Function("back", [matrix, weight], [matrix @ weight]).map(self._count)
        begins = back(self._steps[: self._states, columns], weights)
        layout = self._layout
        found = []
        for values, size, blocks, count in (
            (begins, width, self._piece, layout.count),
            (weights, cell, self._samples, layout.count * layout.samples),
        ):
            places = first_entries(blocks, size, self._states)
            found.append(ca.reshape(scattered(ca.vec(values), ca.vec(places), size * count), size, count))
        return found[0], found[1]


def _through(rows: int, inner: int, columns: int = 1) -> ca.Function:
    # The product of two matrices.
    left, right = ca.MX.sym("left", rows, inner), ca.MX.sym("right", inner, columns)
    return ca.Function("through", [left, right], [left @ right])
