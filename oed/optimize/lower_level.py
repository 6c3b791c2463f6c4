"""Lower level of limits at all times: the instants at which a drive exceeds them, and the excess there.

In a semi-infinite program the upper level searches for the drive; the lower level searches for the instants
at which a fixed drive exceeds each limit most.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from oed.foundation.arrays import Array, Bools, Places
from oed.kernel.between.periods import periods_of
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.problem import Problem
from oed.optimize.terms.terms import Terms


@dataclass(frozen=True)
class Instants:
    """Instants of drives, each with a row of the limits.

    Attributes:
        row: place among the rows of an instant, (K,).
        run: number of the run among those of all watched systems, (K,).
        time: time on the run's clock [s], (K,).
    """

    row: Places
    run: Places
    time: Array

    def __len__(self) -> int:
        """Return the number K of instants."""
        return len(self.row)

    def joined(self, further: Instants) -> Instants:
        """Return these and further instants."""
        return Instants(
            np.concatenate([self.row, further.row]),
            np.concatenate([self.run, further.run]),
            np.concatenate([self.time, further.time]),
        )

    def some(self, mask: Bools) -> Instants:
        """Return the instants that a mask (K,) selects."""
        return Instants(self.row[mask], self.run[mask], self.time[mask])

    def near(self, instants: Instants, apart: float) -> Bools:
        """Return the mask (K,) of instants less than a time [s] from any other instants of the same row."""
        same = (self.row[:, None] == instants.row) & (self.run[:, None] == instants.run)
        close = np.abs(self.time[:, None] - instants.time) < apart
        return np.asarray((same & close).any(axis=1))


class LowerLevel:
    """Limits of a problem on instants, along drives.

    Args:
        problem: problem with all samples.
        terms: terms of the search, on all samples or on fewer.
    """

    def __init__(self, problem: Problem, terms: Terms) -> None:
        """Store the rows of the terms."""
        self._problem, self._rows, self._scale = problem, terms.instants, terms.input_scale

    def peaks(self, drive: Trajectory, share: float, fine: int) -> Instants:
        """Return the instants of all peaks of a drive's excess over each row.

        Args:
            drive: drive of the problem.
            share: smallest excess of a peak, as a share of the limit's size.
            fine: number of times of a period that are checked.
        """
        table, times = self._table(drive, fine)
        excess = self._rows.excess(table)
        runs, _ = times.shape
        # Course of every row over the time of every run of every system, (rows, runs, times).
        courses = excess.reshape(runs, -1, self._rows.count).transpose(2, 0, 1)
        kept = np.repeat(self._rows.systems, runs // self._rows.systems.shape[1], axis=1)
        courses = np.where(kept[:, :, None], courses, -np.inf)
        wide = np.pad(courses, ((0, 0), (0, 0), (1, 1)), constant_values=-np.inf)
        before, after = wide[:, :, :-2], wide[:, :, 2:]
        peaks = (courses > share) & (courses >= before) & (courses > after)
        row, run, place = np.nonzero(peaks)
        low, high, next_low = (course[peaks] for course in (before, courses, after))
        # The vertex of the parabola through the highest point and its neighbours.
        with np.errstate(invalid="ignore", divide="ignore"):
            shift = 0.5 * (low - next_low) / (low - 2 * high + next_low)
        inside = (place > 0) & (place < times.shape[1] - 1) & (np.abs(shift) <= 0.5)
        step = drive.period / fine
        return Instants(row, run, times[run, place] + np.where(inside, shift, 0.0) * step)

    def violations(self, instants: Instants, drive: Trajectory) -> Array:
        """Return the excess (K,) of a drive over the rows of instants, in shares of their limits' sizes.

        Args:
            instants: instants of drives of the problem.
            drive: drive on all samples.
        """
        return self._rows.excess(self.at(drive, instants), instants.row)

    def at(self, drive: Trajectory, instants: Instants) -> Array:
        """Return the value of each instant's row along a drive, (K,)."""
        place, elapsed = within(instants, drive.samples // drive.runs, drive.period)
        table = self._rows_of(drive, place, elapsed, instants.run, instants.time)
        return table[np.arange(len(instants)), instants.row]

    def _table(self, drive: Trajectory, fine: int) -> tuple[Array, Array]:
        # Rows (instants, R) at `fine` times of every period of every watched system, run by run, and these
        # times (runs of all systems, instants).
        samples, count = drive.samples // drive.runs, self._rows.systems.shape[1] * drive.runs
        steps = np.arange(0 if self._problem.design.start_is_free else 1, samples * fine + 1)
        times = np.tile(drive.period * steps / fine, (count, 1))
        run = np.repeat(np.arange(count), len(steps))
        sample = np.minimum(np.tile(np.maximum(steps - 1, 0) // fine, count), samples - 1)
        elapsed = times.ravel() - drive.period * sample
        table = self._rows_of(drive, run * samples + sample, elapsed, run, times.ravel())
        return table, times

    def _rows_of(self, drive: Trajectory, place: Places, elapsed: Array, run: Places, time: Array) -> Array:
        scenarios, rows, samples = self._rows.scenarios, self._rows, drive.samples
        entries = [] if rows.cell is None else rows.cell.entries
        starts = drive.starts + scenarios.shifts
        periods = periods_of(scenarios.system, drive, scenarios.parameters, starts, sensitive=bool(entries))
        parts = [periods.states[place], drive.inputs[place % samples] / self._scale]
        if entries:
            parts.insert(1, np.asarray(periods.sensitivities[place][:, entries]))
        if rows.asking:
            inputs = np.empty_like(parts[-1])
            for number, repetition in enumerate(drive.each):
                in_run = run % drive.runs == number
                inputs[in_run] = repetition.inputs_at(time[in_run]) / self._scale
            parts.append(inputs)
        return rows.table(np.hstack(parts), rows.constants(run // drive.runs, elapsed))


def within(instants: Instants, samples: int, period: float) -> tuple[Places, Array]:
    """Return the sample that each instant is in, counted through all runs, and the time since that began [s].

    Args:
        instants: instants of a drive.
        samples: number of samples of a run.
        period: duration of a sample [s].
    """
    sample = np.clip(np.ceil(instants.time / period).astype(int) - 1, 0, samples - 1)
    return instants.run * samples + sample, instants.time - period * sample
