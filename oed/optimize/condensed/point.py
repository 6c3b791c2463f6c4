"""One evaluation of a drive's information and limits, with first and second derivatives, as arrays."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array, Places
from oed.kernel.dynamics.direct_call import mapped
from oed.optimize.condensed.differentiated import Differentiated
from oed.optimize.condensed.information import Information
from oed.optimize.condensed.runs import Rolled, Runs
from oed.optimize.condensed.whole import WholeRuns
from oed.optimize.terms.instants import InstantRows
from oed.optimize.terms.run_unknowns import RunUnknowns


@dataclass(frozen=True)
class CondensedParts:
    """The parts that an evaluation goes through.

    Attributes:
        runs: cells of all samples.
        unknowns: places of every run's unknowns in z.
        drive: (z) -> start states, inputs held, linear rows, inputs and unknowns that limits on whole runs
            need.
        start_slopes: derivatives of the start states by z, (R, states, size).
        information: what samples add up to.
        ending: what is read at a run's end, of (x, inputs held until then); None of regressions.
        whole: limits on whole runs; None if there are none.
        instants: rows of an instant.
    """

    runs: Runs
    unknowns: RunUnknowns
    drive: ca.Function
    start_slopes: Array
    information: Information
    ending: Differentiated | None
    whole: WholeRuns | None
    instants: InstantRows

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.unknowns.size

    @cached_property
    def run_start_slopes(self) -> Array:
        """Derivatives of the start states by each run's unknowns, (R, states, w)."""
        return np.take_along_axis(self.start_slopes, self.unknowns.places[:, None, :], axis=2)

    def drives(self, candidates: Array) -> Drives:
        """Return the drives of unknowns (K, size)."""
        # By a function of one drive, whose digits do not depend on how many there are.
        count, runs = len(candidates), self.runs
        starts, held, linear, needed = mapped(self.drive, count)(candidates)
        return Drives(
            starts.reshape(count, runs.count, runs.cell.states),
            held.reshape(count, runs.count, *runs.held_slopes.shape[:2]),
            linear.reshape(count, self.drive.size1_out(2)),
            needed.reshape(count, self.drive.size1_out(3)),
        )


@dataclass(frozen=True)
class Drives:
    """Parts of K drives that are linear in the unknowns.

    Attributes:
        starts: states, (K, R, states).
        held: inputs, in units of their scale, (K, R, N, inputs).
        linear: rows of limits, (K, rows).
        needed: inputs and unknowns that limits on whole runs need besides states, (K, n).
    """

    starts: Array
    held: Array
    linear: Array
    needed: Array


@dataclass(frozen=True)
class ChosenRows:
    """Rows of instants at which a program looks, one a slot.

    Attributes:
        run: of each slot, (K,).
        sample: in the run, (K,).
        constants: time since the sample's begin [s] and how much of each row, (K, 1 + rows).
        asked: derivatives of the inputs that splines ask for by z, (K, inputs, size); none asked for: 0.
    """

    run: Places
    sample: Places
    constants: Array
    asked: Array


class DriveAt:
    """Information and limits at unknowns z, every part computed once.

    Attributes:
        z: unknowns, (size,).
    """

    def __init__(self, parts: CondensedParts, z: Array) -> None:
        """Take the parts and z."""
        self._parts, self.z = parts, z
        self._instants: _Instants | None = None

    @cached_property
    def drive(self) -> Drives:
        """Start states, inputs and rows, which are linear in z."""
        return self._parts.drives(self.z[None])

    @cached_property
    def _rolled(self) -> Rolled:
        starts, held = self.drive.starts[0], self.drive.held[0]
        return Rolled(self._parts.runs, starts, held, self._parts.run_start_slopes)

    @cached_property
    def _end(self) -> Array:
        # x at the runs' ends and the inputs held until then.
        return np.hstack([self._rolled.ends, self._rolled.held[:, -1]])

    @cached_property
    def _groups(self) -> Array:
        ending = self._parts.ending
        ends = None if ending is None else ending.values(self._end)[None]
        return np.asarray(self._parts.information.grouped(self._rolled.added[None], ends)[0])

    @cached_property
    def _sums(self) -> Array:
        return np.asarray(self._parts.information.sums(self._groups[None])[0])

    @cached_property
    def entries(self) -> Array:
        """The matrices' entries, (e,)."""
        return np.asarray(self._parts.information.entries(self._sums[None])[0])

    @cached_property
    def _end_slopes(self) -> Array:
        # Of x at the runs' ends and the inputs held until then, (R, width + inputs, w).
        rolled = self._rolled
        held = self._parts.runs.held_slopes[-1]
        last = np.broadcast_to(held, (len(rolled.ends), *held.shape))
        return np.concatenate([rolled.end_slopes, last], axis=1)

    @cached_property
    def _group_slopes(self) -> Array:
        slopes = self._rolled.added_slopes(self._parts.information.groups)
        if self._parts.ending is not None:
            slopes[:, 0] += np.matmul(self._parts.ending.slopes(self._end), self._end_slopes)
        return slopes

    @cached_property
    def _sum_slopes(self) -> Array:
        parts = self._parts
        return parts.information.sum_slopes(
            self._groups, self._group_slopes, parts.unknowns.places, parts.size
        )

    @cached_property
    def entry_slopes(self) -> Array:
        """Derivatives of the entries by z, (e, size)."""
        return self._parts.information.entry_slopes(self._sums) @ self._sum_slopes

    @cached_property
    def _run_variables(self) -> Array:
        limits = self._parts.whole
        assert limits is not None
        samples, states = limits.states
        run, sample = np.divmod(samples, self._parts.runs.samples)
        values = self._rolled.points[run, sample, states]
        return np.asarray(limits.variables(values[None], self.drive.needed)[0])

    @cached_property
    def _run_variable_slopes(self) -> Array:
        limits, parts = self._parts.whole, self._parts
        assert limits is not None
        samples, states = limits.states
        run, sample = np.divmod(samples, parts.runs.samples)
        slopes = np.zeros((len(states), parts.size))
        if len(states):
            rows = self._rolled.slopes[run, sample, states]
            slopes[np.arange(len(states))[:, None], parts.unknowns.places[run]] = rows
        return limits.variable_slopes(slopes)

    @property
    def run_rows(self) -> Array:
        """Rows of limits on whole runs."""
        assert self._parts.whole is not None
        return np.asarray(self._parts.whole.values(self._run_variables[None])[0])

    @property
    def run_row_slopes(self) -> Array:
        """Derivatives of the rows of limits on whole runs by z, (rows, size)."""
        assert self._parts.whole is not None
        return self._parts.whole.slopes(self._run_variables, self._run_variable_slopes)

    def instants(self, chosen: ChosenRows) -> _Instants:
        """Return the chosen rows of instants, those of the last call again where they are the same."""
        if self._instants is None or self._instants.chosen is not chosen:
            self._instants = _Instants(self._parts, self._rolled, chosen, self.z)
        return self._instants

    def curvature(self, entries: Array, on_runs: Array, instants: Array, chosen: ChosenRows | None) -> Array:
        """Return second derivatives (size, size) by z of a weighted sum.

        Args:
            entries: weights of the matrices' entries, (e,).
            on_runs: weights of the rows of limits on whole runs.
            instants: weights of the chosen rows, (K,).
            chosen: these rows, if there are any.
        """
        parts, rolled = self._parts, self._rolled
        information = parts.information
        weights, bent = information.weighted(self._sums, entries)
        total = np.zeros((parts.size, parts.size))
        if bent is not None:
            total += self._sum_slopes.T @ bent @ self._sum_slopes
        groups, square = information.group_weights(self._groups, weights)
        by_runs = np.zeros((parts.runs.count, parts.unknowns.per_run, parts.unknowns.per_run))
        if square is not None:
            slopes = self._group_slopes
            by_runs += np.matmul(slopes.transpose(0, 1, 3, 2), np.matmul(square, slopes)).sum(axis=1)
        ends = np.zeros_like(rolled.ends)
        if parts.ending is not None:
            weights_at_ends = np.broadcast_to(groups[:, 0], (len(ends), groups.shape[2]))
            ends = np.matmul(weights_at_ends[:, None], parts.ending.slopes(self._end))[:, 0, : ends.shape[1]]
            inner = parts.ending.curvature(self._end, np.ascontiguousarray(weights_at_ends))
            slopes = self._end_slopes
            by_runs += np.matmul(slopes.transpose(0, 2, 1), np.matmul(inner, slopes))
        points = np.zeros_like(rolled.points)
        if parts.whole is not None:
            needed, slopes = self._run_variables, self._run_variable_slopes
            total += parts.whole.curvature(needed, slopes, on_runs)
            samples, states = parts.whole.states
            run, sample = np.divmod(samples, parts.runs.samples)
            np.add.at(points, (run, sample, states), parts.whole.weights(needed, on_runs))
        if chosen is not None:
            rows = self.instants(chosen)
            np.add.at(points, rows.places, rows.weights(instants))
            total += rows.curvature(instants)
        length = parts.runs.samples // information.groups
        added = np.repeat(groups, length, axis=1)
        by_runs += rolled.curvature(ends, np.ascontiguousarray(added), points)
        for places, by_run in zip(parts.unknowns.places, by_runs, strict=True):
            total[np.ix_(places, places)] += by_run
        return total


class _Instants:
    # Chosen rows of instants at one z, around the states and inputs at their samples' begins.

    def __init__(self, parts: CondensedParts, rolled: Rolled, chosen: ChosenRows, z: Array) -> None:
        self._parts, self._rolled, self.chosen, self._z = parts, rolled, chosen, z
        self._rows = parts.instants.chosen

    @property
    def places(self) -> tuple[Places, Places, Places]:
        # Of the robots' states at the samples' begins among x at all of these, (K, states).
        states = np.arange(self._parts.runs.cell.states, dtype=np.int64)
        return self.chosen.run[:, None], self.chosen.sample[:, None], states

    @cached_property
    def _variables(self) -> Array:
        columns = [self._rolled.points[self.places], self._rolled.held[self.chosen.run, self.chosen.sample]]
        if self._parts.instants.asking:
            columns.append(self.chosen.asked @ self._z)
        return np.hstack(columns)

    @cached_property
    def _variable_slopes(self) -> Array:
        # By z, (K, variables, size).
        parts, slopes, chosen = self._parts, self._rolled.slopes, self.chosen
        columns = np.r_[0 : parts.runs.cell.states, parts.runs.cell.width : slopes.shape[2]]
        around = np.zeros((len(chosen.run), parts.instants.size, parts.size))
        rows = np.arange(len(chosen.run))[:, None, None], np.arange(len(columns))[None, :, None]
        unknowns = parts.unknowns.places[chosen.run][:, None, :]
        around[(*rows, unknowns)] = slopes[chosen.run[:, None], chosen.sample[:, None], columns]
        if parts.instants.asking:
            around[:, len(columns) :] = chosen.asked
        return around

    @cached_property
    def _steep(self) -> Array:
        # By the variables, (K, 1, variables).
        return self._rows.slopes(self._variables, self.chosen.constants)

    @property
    def values(self) -> Array:
        # The rows, (K,).
        return self._rows.values(self._variables, self.chosen.constants)[:, 0]

    @property
    def slopes(self) -> Array:
        # Derivatives by z, (K, size).
        return np.asarray(np.matmul(self._steep, self._variable_slopes)[:, 0])

    def weights(self, weights: Array) -> Array:
        # Weights of the states (K, states) that weights (K,) of the rows make.
        return weights[:, None] * self._steep[:, 0, : self._parts.runs.cell.states]

    def curvature(self, weights: Array) -> Array:
        # Second derivatives (size, size) by z of the weighted sum, but for those of the states.
        size = self._parts.size
        if self._rows.is_linear:
            return np.zeros((size, size))
        inner = self._rows.curvature(self._variables, weights[:, None], self.chosen.constants)
        slopes = self._variable_slopes
        return np.asarray(slopes.reshape(-1, size).T @ np.matmul(inner, slopes).reshape(-1, size))
