"""Terms by unrolling: the whole drive written out sample by sample, and differentiated as it stands.

It serves every problem, at a cost of building that grows with the samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array, Bools
from oed.kernel.dynamics.direct_call import DirectCall
from oed.kernel.dynamics.expression import Expression
from oed.kernel.limit import Rows
from oed.kernel.problem import Problem
from oed.optimize.condensed.calls import ArrayFunction
from oed.optimize.terms.base import Functions, Terms
from oed.optimize.terms.begun import Begun, Weighted
from oed.optimize.terms.blocks import Packed
from oed.optimize.terms.instants import InstantRows
from oed.optimize.terms.matrices import upper_half
from oed.optimize.terms.needs import by_instants
from oed.optimize.terms.row_bounds import RowBounds, excess, said_once, scores_of

LARGE = 8_000_000
"""Operations of second derivatives from which on directions share one function, which takes half as long
again but not gigabytes: a million take 100 MB.
"""


class Unrolled(Terms):
    """Information and limit rows of the drive written out, positions at `refine` points per sample.

    Attributes:
        matrices: its information, block by block (SX).
        limits: every limit's rows, without those that no unknown moves (SX).
    """

    def __init__(self, problem: Problem, refine: int = 1) -> None:
        """Write the expressions; functions are compiled when first used."""
        super().__init__(problem, refine)
        matrices = [one.matrix for one in problem.estimations(self.drive)]
        rows = [_dependent(rows, self.unknowns) for rows in problem.limit_rows(self.drive)]
        if problem.robust is None:
            both = zip(problem.limits, rows, strict=True)
            rows = [_once(one, self.unknowns) if limit.looks_at == "inputs" else one for limit, one in both]
        # Step and measurement repeat each other's sines; shared, a quarter of the operations goes away.
        shared = ca.cse([*matrices, *(one.expression for one in rows)])
        self.matrices: list[Expression] = shared[: len(matrices)]
        self.limits = [
            Rows(expression, one.lower, one.upper, one.size, one.unit)
            for expression, one in zip(shared[len(matrices) :], rows, strict=True)
        ]

    @cached_property
    def instants(self) -> InstantRows:
        """The rows of an instant."""
        places = [
            place for place, limit in enumerate(self.problem.limits) if by_instants(self.problem, limit)
        ]
        return InstantRows(self.problem, places, self.input_scale)

    @cached_property
    def _fixed(self) -> list[Rows]:
        # Of every limit the rows that a program has without slots.
        none = self.instants.without
        return [
            Rows(ca.SX(0, 1), none[place].lower, none[place].upper, rows.size, rows.unit)
            if place in none
            else rows
            for place, rows in enumerate(self.limits)
        ]

    @cached_property
    def rows(self) -> list[RowBounds]:
        """Bounds of every limit's rows, without those of instants."""
        return [RowBounds(rows.lower, rows.upper, rows.size, rows.unit) for rows in self._fixed]

    @property
    def sizes(self) -> list[int]:
        """The size of every matrix."""
        return [matrix.shape[0] for matrix in self.matrices]

    @cached_property
    def linear(self) -> list[bool]:
        """Whether each limit's rows are linear in z."""
        return [not any(ca.which_depends(rows.expression, self.unknowns, 2, True)) for rows in self._fixed]

    @cached_property
    def entries(self) -> Expression:
        """The upper halves of all matrices, stacked (SX)."""
        return ca.vertcat(*(upper_half(matrix) for matrix in self.matrices))

    @cached_property
    def scores(self) -> ca.Function:
        """Z -> entries, the most that limits are exceeded by."""
        worst = [excess(rows.expression, rows) for rows in self.limits]
        return scores_of(self.unknowns, self.entries, worst)

    @property
    def written(self) -> int:
        """Operations of a whole drive."""
        return int(self.scores.n_instructions())

    @cached_property
    def fixed_rows(self) -> Expression:
        """The limits' rows that a program has without slots, stacked (SX)."""
        return ca.vertcat(*(rows.expression for rows in self._fixed))

    @cached_property
    def whole(self) -> ca.Function:
        """Z -> entries, fixed rows."""
        return ca.Function("unrolled", [self.unknowns], [self.entries, self.fixed_rows])

    @cached_property
    def slopes(self) -> ca.Function:
        """Z -> derivatives of the entries (dense), and of the fixed rows."""
        slope = ca.jacobian(ca.vertcat(self.entries, self.fixed_rows), self.unknowns)
        count = self.entries.shape[0]
        parts = [ca.densify(slope[:count, :]), slope[count:, :]]
        return ca.Function("unrolled_slopes", [self.unknowns], parts)

    @cached_property
    def _functions(self) -> dict[int, Functions]:
        return {}

    def functions(self, slots: int = 0) -> Functions:
        """Return the terms' functions with so many slots for rows of instants."""
        if slots not in self._functions:
            self._functions[slots] = _functions_of(self, slots)
        return self._functions[slots]

    @cached_property
    def _scorers(self) -> dict[tuple[int, int], DirectCall]:
        return {}

    def scored(self, candidates: Array, threads: int = 1) -> tuple[Array, Array]:
        """Return the entries (K, e) of candidates, and the most by which they exceed each limit (K, limits).

        Args:
            candidates: unknowns, (K, size).
            threads: number of threads, which changes no digit.
        """
        count, workers = len(candidates), min(threads, len(candidates))
        if (count, workers) not in self._scorers:
            several = ("thread", workers) if workers > 1 else ()
            self._scorers[count, workers] = DirectCall(self.scores.map(count, *several))
        entries, excess = self._scorers[count, workers](candidates)
        return entries.reshape(count, -1), excess.reshape(count, -1)


def _functions_of(terms: Unrolled, count: int) -> Functions:
    sweep, slots = UnrolledSweep(terms), terms.slots(count)
    arguments, rows, slopes = [sweep.z], sweep.rows, sweep.row_slopes
    weights = [ca.MX.sym("entries", terms.entry_count), ca.MX.sym("rows", rows.shape[0] + count)]
    fixed, on_slots = ca.vertsplit(weights[1], [0, rows.shape[0], weights[1].shape[0]])
    weighted, more = list[Weighted](), ca.MX(terms.size, terms.size)
    if count:
        numbers = ca.MX.sym("numbers", slots.width)
        begun = sweep.begun(slots.split(numbers)[0])
        around = slots.around(sweep.z, begun, numbers, terms.size)
        arguments.append(numbers)
        rows, slopes = ca.vertcat(rows, around.values), ca.vertcat(slopes, around.slopes)
        weighted_begins, more = around.curvature(on_slots)
        weighted.append(weighted_begins)
    curvature = ca.triu(sweep.curvature(weights[0], fixed, weighted) + more)
    calls = [
        ca.Function("terms", arguments, [ca.densify(sweep.entries), ca.densify(rows)]),
        ca.Function("slopes", arguments, [ca.densify(sweep.entry_slopes), Packed(slopes).entries]),
        ca.Function("curvature", [*arguments, *weights], [Packed(curvature).entries]),
    ]
    patterns = [
        [ca.Sparsity.dense(terms.entry_count), ca.Sparsity.dense(rows.shape[0])],
        [ca.Sparsity.dense(terms.entry_count, terms.size), slopes.sparsity()],
        [curvature.sparsity()],
    ]
    return Functions(
        *(
            ArrayFunction(
                call.name(), [call.numel_in(place) for place in range(call.n_in())], results, DirectCall(call)
            )
            for call, results in zip(calls, patterns, strict=True)
        )
    )


class UnrolledSweep:
    """The terms at z: functions of what is written out (SX).

    Args:
        terms: written out.
    """

    def __init__(self, terms: Unrolled) -> None:
        """Begin with z."""
        self.terms, self.z = terms, ca.MX.sym("z", terms.size)

    @cached_property
    def _values(self) -> list[Expression]:
        return list(self.terms.whole(self.z))

    entries = property(lambda self: self._values[0])
    rows = property(lambda self: self._values[1])

    @cached_property
    def _slopes(self) -> list[Expression]:
        return list(self.terms.slopes(self.z))

    entry_slopes = property(lambda self: self._slopes[0])
    row_slopes = property(lambda self: self._slopes[1])

    @cached_property
    def begins(self) -> Expression:
        """States and inputs held (in their scale) at all samples' begins (SX), (samples, each)."""
        drive, scale = self.terms.drive, ca.DM(1 / self.terms.input_scale)
        return ca.horzcat(drive.states[drive.begins, :], self.terms.held @ ca.diag(scale))

    def begun(self, samples: Expression) -> Begun:
        """What is known at some samples' begins."""
        states = len(self.terms.problem.system.states)
        return Begun(self.begins, states, self.terms.unknowns, self.z, samples)

    def curvature(self, entries: Expression, rows: Expression, begun: Sequence[Weighted]) -> Expression:
        """Second derivatives by z."""
        parts, weights = [self.terms.entries, self.terms.fixed_rows], [entries, rows]
        if begun:
            states = self.begins[:, : len(self.terms.problem.system.states)].T
            parts.append(ca.vec(states))
            weights.append(sum(part.begun.weighted(part.states) for part in begun))
        symbols = [ca.SX.sym("weights", part.shape[0]) for part in parts]
        weighted = sum(ca.dot(*both) for both in zip(symbols, map(ca.densify, parts), strict=True))
        arguments = [self.terms.unknowns, *symbols]
        slope = ca.gradient(weighted, self.terms.unknowns)
        gradient = ca.Function("unrolled_gradient", arguments, [slope])
        inner = sum(_inner(part) for part in begun if part.bent)
        if gradient.n_instructions() * self.terms.size > LARGE:
            return _by_directions(gradient, [self.z, *weights]) + inner
        # Every unknown meets every other somewhere: finding that out would take longer than using it.
        curvature = ca.jtimes(slope, self.terms.unknowns, ca.SX.eye(self.terms.size))
        return ca.Function("unrolled_curvature", arguments, [curvature])(self.z, *weights) + inner


def _by_directions(gradient: ca.Function, given: Sequence[Expression]) -> Expression:
    # The gradient's derivatives by its first argument, one direction after the other: each is written once.
    size, count = given[0].shape[0], len(given)
    every = gradient.forward(1).map("directions", "serial", size, list(range(count + 1)), [])
    others = [ca.MX(one.shape[0], size) for one in given[1:]]
    return every(*given, gradient(*given), ca.MX.eye(size), *others)


def _inner(weighted: Weighted) -> Expression:
    # Second derivatives by z of what enters by some of the states and inputs.
    begun, width = weighted.begun, len(weighted.bent)
    slopes = begun.slopes[:, begun.of(weighted.bent)]
    slope, curvature = ca.MX.sym("slope", slopes.shape[0], width), ca.MX.sym("inner", width, width)
    half = ca.Function("half", [slope, curvature], [slope @ curvature]).map(begun.states.shape[1])
    return slopes @ half(slopes, weighted.inner).T


class OtherRobots:
    """The information that a drive's inputs give other robots: one function of their parameters."""

    def __init__(self, problem: Problem, terms: Unrolled) -> None:
        """Write the expressions; functions are compiled when first used."""
        drive, z = terms.drive, terms.unknowns
        parameters = ca.SX.sym("p", len(problem.system.parameters))
        shift = ca.SX.sym("shift", problem.design.runs, len(problem.system.states))
        begin, _ = drive.ends_of(drive.states)
        other = drive.again(parameters, begin + shift)
        matrices = ca.cse([one.matrix for one in problem.estimations(other)])
        self.entries = ca.vertcat(*(upper_half(matrix) for matrix in matrices))
        self.arguments: list[Any] = [z, parameters, shift]

    @cached_property
    def values(self) -> ca.Function:
        """(z, parameters, shift of the start states) -> entries."""
        return ca.Function("other", self.arguments, [self.entries])

    @cached_property
    def jacobian(self) -> ca.Function:
        """(z, parameters, shift of the start) -> derivatives of the entries by z."""
        slope = ca.jacobian(self.entries, self.arguments[0])
        return ca.Function("other_slopes", self.arguments, [ca.densify(slope)])

    @cached_property
    def hessian(self) -> ca.Function:
        """(z, parameters, shift, weights of the entries) -> second derivatives by z of the weighted sum."""
        z, weights = self.arguments[0], ca.SX.sym("entries", self.entries.shape[0])
        gradient = ca.gradient(ca.dot(weights, self.entries), z)
        curvature = ca.jtimes(gradient, z, ca.SX.eye(z.shape[0]))
        return ca.Function("other_curvature", [*self.arguments, weights], [ca.triu(curvature)])


def _dependent(rows: Rows, unknowns: Expression) -> Rows:
    # Rows that no unknown moves (coefficients that rest fixes) would only burden the solver.
    # Dense, or rows that are structurally 0 (where runs meet) would not be counted.
    expression = ca.densify(rows.expression)
    moved = np.array(ca.which_depends(expression, unknowns, 1, True), dtype=bool)
    return _chosen(replace(rows, expression=expression), moved)


def _once(rows: Rows, unknowns: Expression) -> Rows:
    # Linear rows that say what one before them does would only burden the solver, too.
    if not rows.lower.size or any(ca.which_depends(rows.expression, unknowns, 2, True)):
        return rows
    slopes = ca.densify(ca.jacobian(rows.expression, unknowns))
    both = ca.Function("rows", [unknowns], [slopes, rows.expression])
    steep, constants = map(np.array, both(np.zeros(unknowns.shape[0])))
    return _chosen(rows, said_once(steep, constants.ravel(), rows))


def _chosen(rows: Rows, chosen: Bools) -> Rows:
    places = np.flatnonzero(chosen).tolist()
    return replace(
        rows, expression=rows.expression[places], lower=rows.lower[chosen], upper=rows.upper[chosen]
    )
