"""What a search asks of drives, by the chain rule over one-sample cells."""

from __future__ import annotations

from functools import cached_property

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array, Bools, Places
from oed.kernel.dynamics.direct_call import DirectCall
from oed.kernel.dynamics.embedding import without_zeros
from oed.kernel.dynamics.system import follows_state
from oed.kernel.measurement.filter import reads_of
from oed.kernel.problem import Problem
from oed.optimize.condensed.calls import ArrayFunction
from oed.optimize.condensed.differentiated import Differentiated
from oed.optimize.condensed.information import Information
from oed.optimize.condensed.point import ChosenRows, CondensedParts, DriveAt, Drives
from oed.optimize.condensed.rows import RowEntries
from oed.optimize.condensed.runs import Runs
from oed.optimize.condensed.whole import WholeRuns
from oed.optimize.terms.base import Functions, Terms
from oed.optimize.terms.cell import SampleCell, read_end
from oed.optimize.terms.fixed_rows import FixedRows
from oed.optimize.terms.instants import InstantRows
from oed.optimize.terms.matrices import symmetric
from oed.optimize.terms.needs import needs_of
from oed.optimize.terms.row_bounds import RowBounds
from oed.optimize.terms.run_unknowns import RunUnknowns
from oed.optimize.terms.whole_rows import Formulas

TOGETHER = 40_000
"""Samples of candidates that are scored at once: what they hand on takes some hundred bytes each."""


def condensable(problem: Problem) -> bool:
    """Return whether what the samples of a problem's drives add makes up its information.

    That is not so for robust limits and other systems, for noise that readings share over time, and for
    segments of unequal length.
    """
    cuts = problem.measurement.cuts(problem.design.samples)
    return problem.robust is None and cuts is not None


class Condensed(Terms):
    """Information and limit rows of drives whose samples add up, by the chain rule over their cells."""

    def __init__(self, problem: Problem, refine: int = 1) -> None:
        """Write a sample and what surrounds it; functions are made when first used."""
        super().__init__(problem, refine)
        space, sensors = problem.design, problem.sensors
        needs = needs_of(problem, self.bounding)
        self._cell = SampleCell(problem, self.input_scale.tolist())
        unknowns = RunUnknowns.of(self.embedding, self.size)
        reads = reads_of(sensors, space.samples)[:, : space.samples]
        runs = Runs(self._cell, space.runs, reads, self._held_slopes(unknowns))
        added = int(self._cell.gathered.numel())
        self._instants = InstantRows(problem, needs.instants, self.input_scale)
        moved = self._moved(runs, unknowns)
        whole_runs = WholeRuns(Formulas(self, needs.whole), moved) if needs.whole else None
        self._fixed = FixedRows(self, needs, whole_runs, self._instants.without)
        self._parts = CondensedParts(
            runs=runs,
            unknowns=unknowns,
            drive=self._drive(whole_runs),
            start_slopes=self.start_slopes,
            information=Information(problem, added),
            ending=self._ending() if sensors else None,
            whole=whole_runs,
            instants=self._instants,
        )
        self._point: DriveAt | None = None
        self._latest: tuple[Array, ChosenRows] | None = None

    def _drive(self, limits: WholeRuns | None) -> ca.Function:
        # What is linear in z.
        z, fixed = ca.MX.sym("z", self.size), self._fixed
        held = self.embedding.held_inputs(z)
        constant = ca.evalf(ca.substitute(self.starts.T, self.unknowns, ca.DM.zeros(self.size)))
        starts = ca.vec(constant) + without_zeros(self.start_slopes.reshape(-1, self.size)) @ z
        linear = without_zeros(fixed.slope) @ z + ca.DM(fixed.constant)
        needed = ca.MX(0, 1) if limits is None else without_zeros(limits.affine) @ z
        results = [starts, ca.vec(held.T), linear, needed]
        return ca.Function("drive", [z], [ca.densify(part) for part in results])

    def _held_slopes(self, unknowns: RunUnknowns) -> Array:
        # Derivatives of the inputs held by a run's unknowns, (N, inputs, w), the starts behind all others.
        space, first = self.problem.design, 0
        slopes = np.zeros((space.samples, self.embedding.inputs, unknowns.per_run))
        for place, held in enumerate(self.embedding.held):
            slopes[:, place, first : first + held.shape[1]] = held
            first += held.shape[1]
        return slopes

    def _ending(self) -> Differentiated:
        # The information read at a run's end, of x there and the inputs held until then.
        cell, system = self._cell, self.problem.system
        x, held = ca.SX.sym("x", cell.width), ca.SX.sym("held", len(system.inputs))
        gathered = read_end(self.problem, ca.DM(self.input_scale) * held, x[: cell.states])
        matrix = symmetric(gathered, cell.carry.gathered_size)
        added = cell.carry.at_end(matrix, x[cell.states :])
        return Differentiated(ca.vertcat(x, held), ca.cse(added))

    def _moved(self, runs: Runs, unknowns: RunUnknowns) -> Bools:
        # Which unknowns move the states at all samples' begins, (samples, states, size).
        states, width, onward = self._cell.states, self._cell.width, runs.state_pattern
        by_state, by_held = onward[:states, :states], onward[:states, width:]
        moved_by = np.zeros((runs.count, runs.samples, states, self.size), dtype=bool)
        for run in range(runs.count):
            moved, places = self.start_slopes[run] != 0, unknowns.places[run]
            for sample in range(runs.samples):
                moved_by[run, sample] = moved
                moved = by_state @ moved
                moved[:, places] |= by_held @ (runs.held_slopes[sample] != 0)
        return moved_by.reshape(runs.count * runs.samples, states, self.size)

    @property
    def sizes(self) -> list[int]:
        """The size of every matrix."""
        return self._parts.information.sizes

    @property
    def rows(self) -> list[RowBounds]:
        """Bounds of every limit's rows, without those of instants."""
        return self._fixed.bounds

    @property
    def linear(self) -> list[bool]:
        """Linearity in z of each limit's rows."""
        return self._fixed.linear

    @property
    def instants(self) -> InstantRows:
        """The rows of an instant."""
        return self._instants

    def at(self, z: Array) -> DriveAt:
        """Return the evaluation at z, the last one again where z is the same."""
        if self._point is None or not np.array_equal(self._point.z, z):
            self._point = DriveAt(self._parts, z.copy())
        return self._point

    @cached_property
    def _functions(self) -> dict[int, Functions]:
        return {}

    def functions(self, slots: int = 0) -> Functions:
        """Return the terms' functions with so many slots for rows of instants."""
        if slots not in self._functions:
            self._functions[slots] = self._functions_with(slots)
        return self._functions[slots]

    def _functions_with(self, count: int) -> Functions:
        rows = RowEntries(self._fixed, self._parts, count)
        width = [self.slots(count).width] if count else []
        entries = self.entry_count

        def values(z: Array, *numbers: Array) -> list[Array]:
            point = self.at(z)
            return [point.entries, rows.values(point, self._chosen(count, *numbers))]

        def slopes(z: Array, *numbers: Array) -> list[Array]:
            point = self.at(z)
            by_z = point.entry_slopes.ravel(order="F")
            return [by_z, rows.slopes(point, self._chosen(count, *numbers))]

        def curvature(z: Array, *arguments: Array) -> list[Array]:
            *numbers, weights, on_rows = arguments
            on_runs, on_instants = rows.weights(on_rows)
            matrix = self.at(z).curvature(weights, on_runs, on_instants, self._chosen(count, *numbers))
            return [matrix.T[self._upper]]

        dense, size = ca.Sparsity.dense, self.size
        sizes = [size, *width]
        return Functions(
            ArrayFunction("terms", sizes, [dense(entries, 1), dense(rows.count, 1)], values),
            ArrayFunction("slopes", sizes, [dense(entries, size), rows.pattern], slopes),
            ArrayFunction("curvature", [*sizes, entries, rows.count], [ca.Sparsity.upper(size)], curvature),
        )

    @cached_property
    def _upper(self) -> tuple[Places, ...]:
        return np.tril_indices(self.size)

    def _chosen(self, count: int, numbers: Array | None = None) -> ChosenRows | None:
        # Which rows the numbers of so many slots stand for; a program asks for the same again and again.
        if numbers is None:
            return None
        if self._latest is None or not np.array_equal(self._latest[0], numbers):
            self._latest = numbers.copy(), self._chosen_rows(count, numbers)
        return self._latest[1]

    def _chosen_rows(self, count: int, numbers: Array) -> ChosenRows:
        slots = self.slots(count)
        order, inputs, size = slots.order, self.embedding.inputs, self.size
        edges = np.cumsum([count, count, order * count, order * count])
        sample, elapsed, basis, places, chosen = np.split(numbers, edges)
        run, place_in_run = np.divmod(sample.astype(int), self.problem.design.samples)
        spline_slopes = np.zeros((count, inputs if order else 0, size))
        if order:
            columns = places.reshape(count, order).astype(int)
            stride = self.embedding.sizes[0]
            for place in range(inputs):
                rows = np.arange(count)[:, None], np.full_like(columns, place), columns + place * stride
                np.add.at(spline_slopes, rows, basis.reshape(count, order))
        constants = np.hstack([elapsed[:, None], chosen.reshape(count, self._instants.count)])
        return ChosenRows(run, place_in_run, constants, spline_slopes)

    @property
    def written(self) -> int:
        """Operations of a sample."""
        return int(self._cell.values.n_instructions())

    def scored(self, candidates: Array, threads: int = 1) -> tuple[Array, Array]:
        """Return the entries (K, e) of unknowns (K, size), and the most by which limits are exceeded.

        Args:
            candidates: unknowns, (K, size).
            threads: number of threads, which changes no digit.
        """
        portion = max(threads, TOGETHER // self.problem.design.all_samples)
        results = [
            self._scored_together(candidates[first : first + portion], threads)
            for first in range(0, len(candidates), portion)
        ]
        entries, excess = zip(*results, strict=True)
        return np.concatenate(entries), np.concatenate(excess)

    def _scored_together(self, candidates: Array, threads: int) -> tuple[Array, Array]:
        parts, runs, count = self._parts, self._parts.runs, len(candidates)
        drives = parts.drives(candidates)
        starts = drives.starts.reshape(count * runs.count, runs.cell.states)
        held = drives.held.reshape(count * runs.count, *drives.held.shape[2:])
        following, added, worst = self._rolled(starts, held, threads)
        ends = None
        if parts.ending is not None:
            last = np.hstack([following[:, -1], held[:, -1]])
            ends = parts.ending.values(last).reshape(count, runs.count, added.shape[2])
        groups = parts.information.grouped(added.reshape(count, runs.count, *added.shape[1:]), ends)
        entries = parts.information.entries(parts.information.sums(groups))
        return entries, self._excess(drives, following, worst)

    def _rolled(self, starts: Array, held: Array, threads: int) -> list[Array]:
        runs = self._parts.runs
        key = len(starts), threads
        if key not in self._rolls:
            several = ("thread", min(threads, len(starts))) if min(threads, len(starts)) > 1 else ()
            chain = self._scored_cell.mapaccum("scored", runs.samples)
            self._rolls[key] = DirectCall(chain.map(len(starts), *several))
        results = self._rolls[key](runs.begins(starts), held, runs.reads(len(starts)))
        widths = [self._cell.width, self._cell.gathered.numel(), len(self._instants.limits)]
        return [
            part.reshape(len(starts), runs.samples, width)
            for part, width in zip(results, widths, strict=True)
        ]

    @cached_property
    def _rolls(self) -> dict[tuple[int, int], DirectCall]:
        return {}

    @cached_property
    def _scored_cell(self) -> ca.Function:
        # A motion that lags jumps at a sample's begin, with the inputs.
        begin = 0 if follows_state(self.problem.system) else 1
        times = self.problem.design.period * np.arange(begin, self.refine + 1) / self.refine
        return self._cell.scored(self._instants, times.tolist())

    def _excess(self, drives: Drives, following: Array, worst: Array) -> Array:
        # The most by which each limit is exceeded, in shares of its size, (K, limits).
        runs, fixed, rows = self._parts.runs, self._fixed, [drives.linear]
        count, states = len(drives.starts), self._cell.states
        if self._parts.whole is not None:
            samples, places = self._parts.whole.states
            run, sample = np.divmod(samples, runs.samples)
            begun = following.reshape(count, runs.count, *following.shape[1:])[..., :-1, :states]
            begins = np.concatenate([drives.starts[:, :, None], begun], axis=2)
            needed = self._parts.whole.variables(begins[:, run, sample, places], drives.needed)
            rows.append(self._parts.whole.values(needed))
        fixed_rows = np.concatenate(rows, axis=1)[:, fixed.order]
        on_instants = worst.reshape(count, -1, worst.shape[2]).max(axis=1) if worst.shape[2] else worst[:0, 0]
        if self.problem.design.start_is_free and self._instants.count:
            on_instants = np.maximum(on_instants, self._at_starts(drives.starts, drives.held))
        excess, first = np.empty((count, len(self.rows))), 0
        for place, bounds in enumerate(self.rows):
            values = fixed_rows[:, first : first + len(bounds.lower)]
            first += len(bounds.lower)
            if place in self._instants.limits:
                excess[:, place] = on_instants[:, self._instants.limits.index(place)]
            else:
                above = np.maximum(values - bounds.upper, bounds.lower - values).max(axis=1, initial=-1e20)
                excess[:, place] = above / bounds.size
        return excess

    def _at_starts(self, starts: Array, held: Array) -> Array:
        # The same of limits on instants (K, limits) where the runs begin, which may be chosen.
        instants, count = self._instants, starts.shape[0] * starts.shape[1]
        first = held[:, :, 0].reshape(count, -1)
        variables = np.hstack(
            [starts.reshape(count, starts.shape[2]), first, *([first] if instants.asking else [])]
        )
        excess = instants.excess(instants.table(variables, np.zeros(count)))
        excess = excess.reshape(len(starts), -1, instants.count)
        by_limit = [excess[..., instants.owner == place].max(axis=(1, 2)) for place in instants.limits]
        return np.stack(by_limit, axis=1)
