"""What a search asks of drives, by the chain rule over one-sample cells."""

from __future__ import annotations

from functools import cached_property, partial

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array, Bools, Places
from oed.kernel.dynamics.direct_call import mapped
from oed.kernel.dynamics.embedding import without_zeros
from oed.kernel.dynamics.system import follows_state
from oed.kernel.measurement.filter import reads_of
from oed.kernel.problem import Problem
from oed.kernel.tightening import Scenarios
from oed.optimize.terms.cell import Cell
from oed.optimize.terms.differentiated import Differentiated
from oed.optimize.terms.fixed_rows import FixedRows
from oed.optimize.terms.information import Information
from oed.optimize.terms.instants import InstantRows
from oed.optimize.terms.judged import AddedInformation, Judged, WholeInformation
from oed.optimize.terms.motion_cell import MotionCell
from oed.optimize.terms.needs import needs_of
from oed.optimize.terms.point import CondensedParts, DriveAt, Drives
from oed.optimize.terms.recurrence import Recurrence
from oed.optimize.terms.rows import RowEntries
from oed.optimize.terms.run_unknowns import RunUnknowns
from oed.optimize.terms.runs import Runs, RunValues
from oed.optimize.terms.sample_cell import SampleCell, read_at_end
from oed.optimize.terms.unknowns import Unknowns
from oed.optimize.terms.whole import LimitsOnRuns
from oed.optimize.terms.whole_rows import information_formulas, limit_formulas

TOGETHER = 40_000
"""Samples of candidates that are scored at once: what they hand on takes some hundred bytes each."""


class Terms(Unknowns):
    """Information and limit rows of a problem's drives as functions of the unknowns z, by the chain rule over
    cells of one sample.

    Limits on instants have no rows but those of instants that are given with each call, in slots; of all
    other limits there are all rows.

    Attributes:
        instants: rows of an instant.
        sizes: size of every judged matrix of one system.
        rows: bounds of every limit's rows, without those of instants.
        linear: linearity in z of each limit's rows.
    """

    def __init__(self, problem: Problem, refine: int = 1) -> None:
        """Write a sample and what surrounds it; functions are made when first used."""
        super().__init__(problem, refine)
        needs = needs_of(problem, self.bounding)
        self._places = RunUnknowns.of(self.embedding, self.size)
        self.instants = InstantRows(problem, needs.instants, self.input_scale)
        judged, watched = self._judged(), self.instants.cell
        runs = judged.runs if watched is None else self._runs(watched, self.instants.scenarios)
        limits = None
        if needs.whole:
            limits = LimitsOnRuns(*limit_formulas(self, needs.whole), self._moved(runs))
        self._fixed = FixedRows(self, needs, limits, self.instants.without)
        self.sizes, self.rows, self.linear = judged.sizes, self._fixed.bounds, self._fixed.linear
        drive = self._drive(limits, judged)
        self._parts = CondensedParts(drive, judged, runs, limits, self.instants)
        self._point: DriveAt | None = None

    def _judged(self) -> Judged:
        # Of samples that add up, or else of whole drives.
        problem, scale = self.problem, self.input_scale
        sensors, space = problem.sensors, problem.design
        scenarios = judged_scenarios(problem)
        varied = scenarios.varied.size > 0
        if problem.measurement.cuts(space.samples) is None:
            size = len(problem.system.parameters) + len(problem.system.states)
            motion = partial(MotionCell, problem.system, space.period, scale, varied=varied)
            cell = motion(columns=range(size))
            formulas, sizes = information_formulas(self, cell)
            if not (formulas.x[0] >= cell.states).any():
                cell = motion()
            return WholeInformation(self._runs(cell, scenarios), formulas, sizes)
        sample = SampleCell(problem, scale, varied=varied)
        reads = reads_of(sensors, space.samples)[:, : space.samples].T
        runs = self._runs(sample, scenarios, reads)
        ending = None
        if sensors:
            variables, parameters, added = read_at_end(problem, sample, scale, varied=varied)
            ending = Differentiated(variables, added, parameters)
        return AddedInformation(runs, Information(problem, sample.added), ending)

    def _runs(self, cell: Cell, scenarios: Scenarios, reads: Array | None = None) -> Runs:
        samples = self.problem.design.samples
        return Runs(
            cell,
            self._places,
            held_slopes=self._held_slopes,
            start_slopes=self.start_slopes,
            reads=np.zeros((samples, 0)) if reads is None else reads,
            scenarios=scenarios,
        )

    def _drive(self, limits: LimitsOnRuns | None, judged: Judged) -> ca.Function:
        # What is linear in z.
        z, fixed = ca.MX.sym("z", self.size), self._fixed
        held = self.embedding.held_inputs(z)
        constant = ca.evalf(ca.substitute(self.starts.T, self.unknowns, ca.DM.zeros(self.size)))
        starts = ca.vec(constant) + without_zeros(self.start_slopes.reshape(-1, self.size)) @ z
        linear = without_zeros(fixed.slope) @ z + ca.DM(fixed.constant)
        formulas = [
            None if limits is None else limits.formulas,
            judged.formulas if isinstance(judged, WholeInformation) else None,
        ]
        needed = [ca.MX(0, 1) if part is None else without_zeros(part.affine) @ z for part in formulas]
        results = [starts, ca.vec(held.T), linear, *needed]
        return ca.Function("drive", [z], [ca.densify(part) for part in results])

    @cached_property
    def _held_slopes(self) -> Array:
        # Derivatives of the inputs held by a run's unknowns, (N, inputs, w), the starts behind all others.
        space, first = self.problem.design, 0
        slopes = np.zeros((space.samples, self.embedding.inputs, self._places.per_run))
        for place, held in enumerate(self.embedding.held):
            slopes[:, place, first : first + held.shape[1]] = held
            first += held.shape[1]
        return slopes

    def _moved(self, runs: Runs) -> Bools:
        # Which unknowns move the states at all samples' begins, (samples, states, size).
        states, width, onward = runs.cell.states, runs.cell.width, runs.state_pattern
        by_state, by_held = onward[:states, :states], onward[:states, width:]
        moved_by = np.zeros((self._places.runs, runs.samples, states, self.size), dtype=bool)
        for run, places in enumerate(self._places.places):
            moved = self.start_slopes[run] != 0
            for sample in range(runs.samples):
                moved_by[run, sample] = moved
                moved = by_state @ moved
                moved[:, places] |= by_held @ (runs.held_slopes[sample] != 0)
        return moved_by.reshape(self._places.runs * runs.samples, states, self.size)

    @property
    def entry_count(self) -> int:
        """Number of entries of all matrices of all judged systems."""
        return self._parts.judged.runs.systems * sum(size * (size + 1) // 2 for size in self.sizes)

    @cached_property
    def bounded_unknowns(self) -> tuple[Places, Places, Array, Array]:
        """Rows that are a constant plus a multiple of a single unknown: those rows, the unknowns, the
        multiples, the constants.
        """
        entries, point = self.entries_of_rows(), self.at(np.zeros(self.size))
        rows, columns = entries.row, entries.column
        counts = np.array([len(limit.lower) for limit in self.rows], dtype=int)
        linear = np.repeat(np.array(self.linear, dtype=bool), counts)
        single = np.flatnonzero(linear & (np.bincount(rows, minlength=len(linear)) == 1))
        # The place of each row's last entry, which is its only one where it is single.
        place = np.zeros(len(linear), dtype=int)
        place[rows] = np.arange(len(rows))
        entry = place[single]
        constants, slopes = entries.values(point, None)[single], entries.slopes(point, None)[entry]
        return single, columns[entry], slopes, constants

    def at(self, z: Array) -> DriveAt:
        """Return the evaluation at z, the last one again where z is the same."""
        if self._point is None or not np.array_equal(self._point.z, z):
            self._point = DriveAt(self._parts, z.copy())
        return self._point

    def entries_of_rows(self, slots: int = 0) -> RowEntries:
        """Return all rows of a program with so many slots for rows of instants."""
        return RowEntries(self._fixed, self._parts, slots)

    @property
    def written(self) -> int:
        """Number of operations of a sample."""
        return int(self._parts.judged.runs.cell.values.n_instructions())

    def scored(self, candidates: Array, threads: int = 1) -> tuple[Array, Array]:
        """Return the entries (K, e) of candidates, and the most by which each limit is exceeded at the points
        looked at, in shares of its size, below 0 within it, (K, limits).

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
        parts = self._parts
        drives = parts.drives(candidates)
        watched, worst = self._rolled(parts.watched, self._scored_cell, drives, threads)
        judged = watched
        if parts.watched is not parts.judged.runs:
            judged, _ = self._rolled(parts.judged.runs, parts.judged.runs.cell.values, drives, threads)
        return parts.judged.entries(judged, drives.information), self._excess(drives, watched, worst)

    def _rolled(self, runs: Runs, cell: ca.Function, drives: Drives, threads: int) -> tuple[RunValues, Array]:
        # What the runs of drives do, and what else the cell returns.
        begins, held = runs.begins(drives.starts), runs.held(drives.held)
        key = cell, len(begins), min(threads, len(begins))
        if key not in self._rolls:
            self._rolls[key] = Recurrence(*key[:2], runs.samples, key[2])
        constants = np.tile(runs.constants, (len(drives.starts), 1, 1))
        following, added, *further = self._rolls[key](begins, held, constants)
        return RunValues.of(begins, held, following, added), further[0] if further else added

    @cached_property
    def _rolls(self) -> dict[tuple[ca.Function, int, int], Recurrence]:
        return {}

    @cached_property
    def _scored_cell(self) -> ca.Function:
        # A watched sample that also returns the most by which groups of rows are exceeded in it.
        cell, instants, period = self._parts.watched.cell, self.instants, self.problem.design.period
        x, inputs, constants = cell.symbols
        # A motion that lags jumps at a sample's begin, with the inputs.
        begin = 0 if follows_state(self.problem.system) else 1
        variables = ca.vertcat(x[: instants.begun], inputs, *([inputs] if instants.asking else []))
        first, last = constants.shape[0] - instants.scenarios.varied.shape[1], constants.shape[0]
        _, parameters = ca.vertsplit(constants, [0, first, last])
        rows = [
            instants.all_rows(variables, ca.vertcat(period * point / self.refine, parameters))
            for point in range(begin, self.refine + 1)
        ]
        table = ca.horzcat(*map(instants.exceeded, rows))
        worst = [ca.mmax(table[np.flatnonzero(group).tolist(), :]) for group in instants.groups]
        results = [*cell.results, ca.densify(ca.vertcat(ca.SX(0, 1), *worst))]
        return ca.Function("scored", cell.symbols, ca.cse(results))

    def _excess(self, drives: Drives, watched: RunValues, worst: Array) -> Array:
        # The most by which each limit is exceeded, in shares of its size, (K, limits).
        runs, fixed, rows = self._parts.watched, self._fixed, [drives.linear]
        count, limits, instants = len(drives.starts), self._parts.limits, self.instants
        if limits is not None:
            entries, samples = limits.formulas.x
            points = watched.points.reshape(count, runs.count * runs.samples, runs.cell.width)
            variables = np.hstack([points[:, samples, entries], drives.limits])
            (flat,) = mapped(limits.formulas.values, count, 1)(variables, np.zeros(0))
            rows.append(flat.reshape(count, -1)[:, limits.moved])
        fixed_rows = np.concatenate(rows, axis=1)[:, fixed.order]
        on_instants = np.zeros((count, 0))
        if instants.count:
            by_system = worst.reshape(count, runs.systems, -1, len(instants.groups)).max(axis=2)
            on_instants = instants.by_limit(by_system)
            if self.problem.design.start_is_free:
                on_instants = np.maximum(on_instants, self._at_starts(watched, count))
        excess, first = np.empty((count, len(self.rows))), 0
        for place, bounds in enumerate(self.rows):
            values = fixed_rows[:, first : first + len(bounds.lower)]
            first += len(bounds.lower)
            if place in instants.limits:
                excess[:, place] = on_instants[:, instants.limits.index(place)]
            else:
                above = np.maximum(values - bounds.upper, bounds.lower - values).max(axis=1, initial=-1e20)
                excess[:, place] = above / bounds.size
        return excess

    def _at_starts(self, watched: RunValues, count: int) -> Array:
        # The most by which limits on instants are exceeded where the runs begin, which may be chosen.
        runs, instants = self._parts.watched, self.instants
        first = watched.held[:, 0]
        begins = watched.points[:, 0, : instants.begun]
        variables = np.hstack([begins, first, *([first] if instants.asking else [])])
        systems = np.tile(np.arange(runs.count) // self._places.runs, count)
        table = instants.table(variables, instants.constants(systems, np.zeros(len(systems))))
        excess = instants.excess(table)
        by_group = [excess[:, group].max(axis=1) for group in instants.groups]
        by_system = np.stack(by_group, axis=1).reshape(count, runs.systems, -1, len(by_group)).max(axis=2)
        return instants.by_limit(by_system)


def judged_scenarios(problem: Problem) -> Scenarios:
    """Return the systems whose information is judged: the nominal one, or those of a robust objective."""
    robust = problem.robust
    if robust is None or robust.objective == "nominal":
        return Scenarios.nominal(problem.system, problem.design.runs)
    return robust.judged(problem.uncertain_system)
