"""The periods of drives, each by how it begins, and parts of them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array, Places, block_columns
from oed.kernel.dynamics import spline
from oed.kernel.dynamics.direct_call import direct_call
from oed.kernel.dynamics.rollout import any_drive
from oed.kernel.dynamics.system import System
from oed.kernel.dynamics.trajectory import Trajectory

NARROWEST = 1e-9
"""Share of a period below which a stretch is not cut any more: where rows change from one formula to another
no bound gets close, but what they jump from and to they are at its ends."""


@dataclass(frozen=True)
class Stretches:
    """Parts of periods: from a fraction of a period to another.

    Attributes:
        row: of the period, (K,).
        begin, end: fractions, (K,).
    """

    row: Places
    begin: Array
    end: Array

    def __len__(self) -> int:
        """K."""
        return len(self.row)

    def chosen(self, which: Any) -> Stretches:
        """Some of them."""
        return Stretches(self.row[which], self.begin[which], self.end[which])

    def cut(self, parts: int) -> Stretches:
        """So many equal ones of each."""
        edges = self.begin + (self.end - self.begin) * np.linspace(0, 1, parts + 1)[:, None]
        return Stretches(np.tile(self.row, parts), edges[:-1].ravel(), edges[1:].ravel())


@dataclass(frozen=True)
class Periods:
    """The periods of one drive, or of many robots with the same inputs, each by how it begins.

    Attributes:
        trajectory: whose inputs are held.
        states: at their begin, (drives * N, states), drive by drive.
        parameters: of the robots, (drives, p).
        sensitivities: of those states, by columns, (drives * N, s); s = 0 where nobody asks for them.
        parts: number of rows that each period is cut into: N is the number of samples times that.
    """

    trajectory: Trajectory
    states: Array
    parameters: Array
    sensitivities: Array
    parts: int = 1

    @cached_property
    def held(self) -> Array:
        """Inputs held in each period of a drive, (N, inputs)."""
        return np.repeat(self.trajectory.inputs, self.parts, axis=0)

    @property
    def lasting(self) -> float:
        """How long each is [s]."""
        return self.trajectory.period / self.parts

    @property
    def of_a_run(self) -> int:
        """How many a run has."""
        return self.parts * self.trajectory.samples // self.trajectory.runs

    @property
    def drives(self) -> int:
        """How many."""
        return len(self.parameters)

    @cached_property
    def table(self) -> Array:
        """All that is known of each period's begin, (drives * N, ...): its state, inputs, parameters,
        sensitivities, and the sample period.
        """
        rows = np.arange(len(self.states))
        parts = [self.states, self.held[self.place_of(rows)], self.parameters[self.drive_of(rows)]]
        return np.hstack([*parts, self.sensitivities, np.full((len(rows), 1), self.lasting)])

    @cached_property
    def whole(self) -> Stretches:
        """Each from its begin to its end."""
        rows = np.arange(len(self.states))
        return Stretches(rows, np.zeros(len(rows)), np.ones(len(rows)))

    @cached_property
    def pieces(self) -> Stretches:
        """The periods of one drive, cut at the knots of its splines."""
        if self.trajectory.degree == 0:
            return self.whole
        cuts = [_cuts(one, self.of_a_run) for one in self.trajectory.each]
        begins, ends = (np.concatenate([cut[side] for cut in cuts]) for side in (1, 2))
        rows = np.concatenate([run * self.of_a_run + row for run, (row, _, _) in enumerate(cuts)])
        return Stretches(rows, begins, ends)

    @cached_property
    def _of_pieces(self) -> Array:
        return self._splines(self.pieces)

    def splines(self, stretches: Stretches) -> Array:
        """What the splines are over stretches without a knot inside, (6, K, inputs): their values at both
        ends, and bounds of values and slopes (by the fraction) between.
        """
        # Every limit begins with the pieces.
        return self._of_pieces if stretches is self.pieces else self._splines(stretches)

    def _splines(self, stretches: Stretches) -> Array:
        drive, place = self.trajectory, self.place_of(stretches.row)
        tables = np.zeros((6, len(stretches), drive.coefficients.shape[1]))
        if drive.degree == 0:
            # Steps are what is held: nobody drives a value between two periods' middles.
            tables[:4] = self.held[place]
            return tables
        each = self.of_a_run
        for run, one in enumerate(drive.each):
            own = place // each == run
            begin, end = (
                (place % each + side)[own] * self.lasting for side in (stretches.begin, stretches.end)
            )
            bounds = spline.enclosure(one.knots, one.degree, one.coefficients, begin, end)
            slopes = [bounds.least * self.lasting, bounds.most * self.lasting]
            tables[:, own] = [bounds.begin, bounds.end, bounds.low, bounds.high, *slopes]
        return tables

    def drive_of(self, rows: Places) -> Places:
        """The drives that periods belong to."""
        return np.asarray(rows // len(self.held))

    def place_of(self, rows: Places) -> Places:
        """Which of their drive's periods they are."""
        return np.asarray(rows % len(self.held))


def periods_of(
    system: System,
    trajectory: Trajectory,
    parameters: Array,
    starts: Array,
    *,
    sensitive: bool = False,
    parts: int = 1,
) -> Periods:
    """The periods of systems with parameters (drives, p) from starts (drives, runs, states).

    Args:
        system: that is driven.
        trajectory: whose inputs all of them get.
        parameters: of each, (drives, p), SI.
        starts: start states of each, (drives, runs, states).
        sensitive: whether the sensitivities of the states are wanted.
        parts: number of rows that each period is cut into.
    """
    count, states, samples = len(parameters), len(system.states), parts * trajectory.samples
    function = _rolled(system, samples, trajectory.runs, sensitive, count)
    begun, period = starts.transpose(0, 2, 1), np.array(trajectory.period / parts)
    held = np.repeat(trajectory.inputs, parts, axis=0)
    found, slopes = direct_call(function, held.T, begun, parameters, period)
    table = found.reshape(count, states, samples).transpose(0, 2, 1)
    width = len(system.parameters) + states if sensitive else 0
    wide = slopes.reshape(count * samples, width, states).reshape(count * samples, -1)
    return Periods(trajectory, table.reshape(-1, states), parameters, wide, parts)


def _cuts(run: Trajectory, periods: int) -> tuple[Places, Array, Array]:
    # The parts of a run's periods between its knots: the period, from which fraction to which.
    knots = np.unique(run.knots) / (run.duration / periods)
    edges = np.sort(np.append(np.arange(periods + 1), knots[np.abs(knots - np.rint(knots)) > NARROWEST]))
    rows = np.minimum(((edges[:-1] + edges[1:]) / 2).astype(int), periods - 1)
    return rows, edges[:-1] - rows, edges[1:] - rows


@lru_cache(maxsize=16)
def _rolled(system: System, samples: int, runs: int, sensitive: bool, count: int) -> ca.Function:
    # (inputs, starts, parameters, period) -> states at the begin of every period, and their sensitivities, of
    # so many robots, side by side.
    symbols, drive = any_drive(system, samples, runs)
    states, width = len(system.states), len(system.parameters) + len(system.states)
    columns = block_columns(np.array(drive.begins), width)
    slopes = drive.sensitivities[:, columns] if sensitive else ca.MX(states, 0)
    results = [ca.densify(drive.states[drive.begins, :]), ca.densify(slopes)]
    function = ca.Function("rolled", symbols, results)
    return function.map("systems", "serial", count, [0, 3], []) if count > 1 else function
