"""Sample periods of drives, each described by what holds at its begin, and parts of them."""

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
"""Share of a period below which a stretch is not cut any more: where rows jump no bound gets close, but their
values on both sides of the jump are those at the stretch's ends."""


@dataclass(frozen=True)
class Stretches:
    """Parts of periods, from one fraction of a period to another.

    Attributes:
        row: row of the period, (K,).
        begin, end: fractions, (K,).
    """

    row: Places
    begin: Array
    end: Array

    def __len__(self) -> int:
        """Return K."""
        return len(self.row)

    def chosen(self, which: Any) -> Stretches:
        """Return some of the stretches."""
        return Stretches(self.row[which], self.begin[which], self.end[which])

    def cut(self, parts: int) -> Stretches:
        """Return the stretches, each cut into equal parts."""
        edges = self.begin + (self.end - self.begin) * np.linspace(0, 1, parts + 1)[:, None]
        return Stretches(np.tile(self.row, parts), edges[:-1].ravel(), edges[1:].ravel())


@dataclass(frozen=True)
class Periods:
    """Periods of one drive, or of many robots with the same inputs.

    Attributes:
        trajectory: drive whose inputs are held.
        states: states at the begin of each period, (drives * N, states), drive by drive.
        parameters: parameters of the robots, (drives, p).
        sensitivities: sensitivities of those states, by columns, (drives * N, s); s = 0 without them.
        parts: number of rows that each sample period is cut into: N is the number of samples times that.
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
    def duration(self) -> float:
        """Duration of a period [s]."""
        return self.trajectory.period / self.parts

    @property
    def per_run(self) -> int:
        """Number of periods of a run."""
        return self.parts * self.trajectory.samples // self.trajectory.runs

    @property
    def drives(self) -> int:
        """Number of drives."""
        return len(self.parameters)

    @cached_property
    def begins(self) -> Array:
        """State, inputs, parameters, sensitivities and duration of each period, (columns, drives * N)."""
        rows = np.arange(len(self.states))
        parts = [self.states, self.held[self.place_of(rows)], self.parameters[self.drive_of(rows)]]
        parts += [self.sensitivities, np.full((len(rows), 1), self.duration)]
        return np.ascontiguousarray(np.hstack(parts).T)

    @cached_property
    def entire(self) -> Stretches:
        """Stretches from the begin of each period to its end."""
        rows = np.arange(len(self.states))
        return Stretches(rows, np.zeros(len(rows)), np.ones(len(rows)))

    @cached_property
    def pieces(self) -> Stretches:
        """Periods of one drive, cut at the knots of its splines."""
        if self.trajectory.degree == 0:
            return self.entire
        cuts = [_cuts(run, self.per_run) for run in self.trajectory.each]
        begins, ends = (np.concatenate([cut[side] for cut in cuts]) for side in (1, 2))
        rows = np.concatenate([run * self.per_run + row for run, (row, _, _) in enumerate(cuts)])
        return Stretches(rows, begins, ends)

    def splines(self, stretches: Stretches) -> tuple[Array, Array]:
        """Return the splines of the inputs over stretches without a knot inside.

        Returns:
            values at both ends (2, inputs, K), and bounds of values and of slopes by the fraction between
            (2, inputs, 2, K).
        """
        drive, place = self.trajectory, self.place_of(stretches.row)
        table = np.zeros((6, len(stretches), drive.coefficients.shape[1]))
        if drive.degree == 0:
            # Steps are what is held: nobody drives a value between two periods' middles.
            table[:4] = self.held[place]
        for run, curve in enumerate(drive.each if drive.degree else ()):
            is_of_run = place // self.per_run == run
            first = place[is_of_run] % self.per_run
            begin, end = (
                (first + fraction[is_of_run]) * self.duration for fraction in (stretches.begin, stretches.end)
            )
            table[:, is_of_run] = spline.enclosure(curve.knots, curve.degree, curve.coefficients, begin, end)
        table[4:] *= self.duration
        ends, values, slopes = table.reshape(3, 2, *table.shape[1:])
        return ends.transpose(0, 2, 1), np.array([values, slopes]).transpose(0, 3, 1, 2)

    def drive_of(self, rows: Places) -> Places:
        """Return the drives that periods belong to."""
        return np.asarray(rows // len(self.held))

    def place_of(self, rows: Places) -> Places:
        """Return the places of periods in their drives."""
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
    """Simulate systems with parameters (drives, p) from starts (drives, runs, states).

    Args:
        system: system that is driven.
        trajectory: drive whose inputs every system gets.
        parameters: parameters of each system, (drives, p), SI.
        starts: start states of each system, (drives, runs, states).
        sensitive: the sensitivities of the states are needed.
        parts: number of rows that each period is cut into.
    """
    count, states, samples = len(parameters), len(system.states), parts * trajectory.samples
    function = _rolled(system, samples, trajectory.runs, sensitive, count)
    starts, period = starts.transpose(0, 2, 1), np.array(trajectory.period / parts)
    held = np.repeat(trajectory.inputs, parts, axis=0)
    begins, slopes = direct_call(function, held.T, starts, parameters, period)
    table = begins.reshape(count, states, samples).transpose(0, 2, 1)
    width = len(system.parameters) + states if sensitive else 0
    wide = slopes.reshape(count * samples, width, states).reshape(count * samples, -1)
    return Periods(trajectory, table.reshape(-1, states), parameters, wide, parts)


def _cuts(run: Trajectory, periods: int) -> tuple[Places, Array, Array]:
    # Parts of a run's periods between its knots: the period, the fraction at the begin and that at the end.
    knots = np.unique(run.knots) / (run.duration / periods)
    edges = np.sort(np.append(np.arange(periods + 1), knots[np.abs(knots - np.rint(knots)) > NARROWEST]))
    rows = np.minimum(((edges[:-1] + edges[1:]) / 2).astype(int), periods - 1)
    return rows, edges[:-1] - rows, edges[1:] - rows


@lru_cache(maxsize=16)
def _rolled(system: System, samples: int, runs: int, sensitive: bool, count: int) -> ca.Function:
    # (inputs, starts, parameters, period) -> states at the begin of every period, and their sensitivities, of
    # `count` robots side by side.
    symbols, drive = any_drive(system, samples, runs)
    states, width = len(system.states), len(system.parameters) + len(system.states)
    columns = block_columns(np.array(drive.begins), width)
    slopes = drive.sensitivities[:, columns] if sensitive else ca.MX(states, 0)
    results = [ca.densify(drive.states[drive.begins, :]), ca.densify(slopes)]
    function = ca.Function("rolled", symbols, results)
    return function.map("systems", "serial", count, [0, 3], []) if count > 1 else function
