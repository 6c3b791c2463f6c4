"""One evaluation of a drive's information and limits, with first and second derivatives, as arrays."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array, Places
from oed.kernel.dynamics.direct_call import mapped
from oed.optimize.terms.chosen import ChosenRows
from oed.optimize.terms.instants import InstantRows
from oed.optimize.terms.judged import Judged, JudgedAt
from oed.optimize.terms.runs import Rolled, Runs
from oed.optimize.terms.whole import LimitsOnRuns, WholeDrive


@dataclass(frozen=True)
class CondensedParts:
    """The parts that an evaluation goes through.

    Attributes:
        drive: (z) -> start states, inputs held, linear rows, inputs and unknowns that limits on whole runs
            need, and those that the information needs.
        judged: information of the judged systems.
        watched: runs of the systems whose instants are watched, the nominal one first; those of the judged
            ones where these are the same.
        limits: limits on whole runs; None if there are none.
        instants: rows of an instant.
    """

    drive: ca.Function
    judged: Judged
    watched: Runs
    limits: LimitsOnRuns | None
    instants: InstantRows

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.watched.size

    def drives(self, candidates: Array) -> Drives:
        """Return the drives of unknowns (K, size)."""
        # By a function of one drive, whose digits do not depend on how many there are.
        count, runs = len(candidates), self.watched
        alone = runs.count // runs.systems
        starts, held, *linear = mapped(self.drive, count)(candidates)
        return Drives(
            starts.reshape(count, alone, runs.cell.states),
            held.reshape(count, alone, *runs.held_slopes.shape[:2]),
            *(table.reshape(count, self.drive.size1_out(2 + place)) for place, table in enumerate(linear)),
        )


@dataclass(frozen=True)
class Drives:
    """Parts of K drives that are linear in the unknowns.

    Attributes:
        starts: states, (K, R, states).
        held: inputs, in units of their scale, (K, R, N, inputs).
        linear: rows of limits, (K, rows).
        limits: inputs and unknowns that limits on whole runs need besides states, (K, n).
        information: inputs and unknowns that the information needs besides x, (K, m).
    """

    starts: Array
    held: Array
    linear: Array
    limits: Array
    information: Array


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
    def _judged_runs(self) -> Rolled:
        return Rolled(self._parts.judged.runs, self.drive.starts[0], self.drive.held[0])

    @cached_property
    def _watched_runs(self) -> Rolled:
        runs = self._parts.watched
        if runs is self._parts.judged.runs:
            return self._judged_runs
        return Rolled(runs, self.drive.starts[0], self.drive.held[0])

    @cached_property
    def _judged(self) -> JudgedAt:
        return self._parts.judged.at(self._judged_runs, self.drive.information[0])

    @property
    def entries(self) -> Array:
        """The matrices' entries, (e,)."""
        return self._judged.entries

    @property
    def entry_slopes(self) -> Array:
        """Derivatives of the entries by z, (e, size)."""
        return self._judged.slopes

    @cached_property
    def _whole(self) -> WholeDrive:
        limits = self._parts.limits
        assert limits is not None
        return WholeDrive(limits.formulas, self._watched_runs, 0, self.drive.limits[0])

    @property
    def run_rows(self) -> Array:
        """Rows of limits on whole runs that some unknown moves."""
        assert self._parts.limits is not None
        return self._whole.values[self._parts.limits.moved]

    @property
    def run_row_slopes(self) -> Array:
        """Derivatives of these rows by z, (rows, size)."""
        assert self._parts.limits is not None
        return self._whole.slopes[self._parts.limits.moved]

    def instants(self, chosen: ChosenRows) -> _Instants:
        """Return the chosen rows of instants, those of the last call again where they are the same."""
        if self._instants is None or self._instants.chosen is not chosen:
            self._instants = _Instants(self._parts, self._watched_runs, chosen, self.z)
        return self._instants

    def curvature(self, entries: Array, on_runs: Array, instants: Array, chosen: ChosenRows | None) -> Array:
        """Return second derivatives (size, size) by z of a weighted sum.

        Args:
            entries: weights of the matrices' entries, (e,).
            on_runs: weights of the rows of limits on whole runs.
            instants: weights of the chosen rows, (K,).
            chosen: these rows, if there are any.
        """
        parts = self._parts
        on_judged = self._judged_runs.no_weights()
        total = self._judged.weigh(entries, on_judged)
        alike = parts.watched is parts.judged.runs
        if parts.limits is not None or chosen is not None:
            on_watched = on_judged if alike else self._watched_runs.no_weights()
            if parts.limits is not None:
                total += self._whole.weigh(parts.limits.spread(on_runs), on_watched)
            if chosen is not None:
                rows = self.instants(chosen)
                np.add.at(on_watched.points, rows.places, rows.weights(instants))
                total += rows.curvature(instants)
            if not alike:
                total += self._watched_runs.curvature(on_watched)
        return total + self._judged_runs.curvature(on_judged)


class _Instants:
    # Chosen rows of instants at one z, around x and the inputs at their samples' begins.

    def __init__(self, parts: CondensedParts, rolled: Rolled, chosen: ChosenRows, z: Array) -> None:
        self._parts, self._rolled, self.chosen, self._z = parts, rolled, chosen, z
        self._rows = parts.instants.weighted
        shares = np.zeros((len(chosen), parts.instants.count))
        shares[np.arange(len(chosen)), chosen.row] = chosen.share
        self._constants = np.hstack([chosen.constants, shares])

    @property
    def places(self) -> tuple[Places, Places, Places]:
        # Of what rows look at among x at all samples' begins, (K, begun).
        begun = np.arange(self._parts.instants.begun, dtype=np.int64)
        return self.chosen.run[:, None], self.chosen.sample[:, None], begun

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
        columns = np.r_[0 : parts.instants.begun, parts.watched.cell.width : slopes.shape[2]]
        around = np.zeros((len(chosen.run), parts.instants.size, parts.size))
        rows = np.arange(len(chosen.run))[:, None, None], np.arange(len(columns))[None, :, None]
        unknowns = parts.watched.places[chosen.run][:, None, :]
        around[(*rows, unknowns)] = slopes[chosen.run[:, None], chosen.sample[:, None], columns]
        if parts.instants.asking:
            around[:, len(columns) :] = chosen.asked
        return around

    @cached_property
    def _steep(self) -> Array:
        # By the variables, (K, 1, variables).
        return self._rows.slopes(self._variables, self._constants)

    @property
    def values(self) -> Array:
        # The rows, (K,).
        return self._rows.values(self._variables, self._constants)[:, 0]

    @property
    def slopes(self) -> Array:
        # Derivatives by z, (K, size).
        return np.asarray(np.matmul(self._steep, self._variable_slopes)[:, 0])

    def weights(self, weights: Array) -> Array:
        # Weights of what rows look at of x (K, begun) that weights (K,) of the rows make.
        return weights[:, None] * self._steep[:, 0, : self._parts.instants.begun]

    def curvature(self, weights: Array) -> Array:
        # Second derivatives (size, size) by z of the weighted sum, but for those of x.
        size = self._parts.size
        if self._rows.is_linear:
            return np.zeros((size, size))
        inner = self._rows.curvature(self._variables, weights[:, None], self._constants)
        slopes = self._variable_slopes
        return np.asarray(slopes.reshape(-1, size).T @ np.matmul(inner, slopes).reshape(-1, size))
