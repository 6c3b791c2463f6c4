"""Largest excess of a limit at any time of a drive, by branch and bound.

Over a stretch of a period, a limit's rows are functions of the elapsed time alone. Their values at both ends
and bounds of their slopes bound their values in between [Piyavskii, 1972]. Stretches that may hold more than
the largest value so far are cut, until that value is the largest of all to `GAP`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from oed.foundation.arrays import Array, Bools
from oed.kernel.between.excess import Excess
from oed.kernel.between.periods import NARROWEST, Periods, Stretches, periods_of
from oed.kernel.dynamics.rollout import FINE, Instant
from oed.kernel.dynamics.system import System
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.limit import Limit, PathLimit, Rows
from oed.kernel.problem import Problem
from oed.kernel.tightening import Tightening, UncertainSystem

GAP = 1e-6
"""Accuracy of a limit's largest excess, as a share of the limit's size."""
SHARE = 1e-4
"""Accuracy of a limit's largest excess, as a share of the distance from the limit, if that is more."""
AT_LEAST = 256
"""Stretches that are bounded about as fast as one."""
PATIENCE = 200_000
"""Stretches bounded at most, besides 20 for every period, before a limit counts as checked at points only."""


@dataclass(frozen=True)
class ScoredDrive:
    """Drive as the scorer has simulated it.

    Attributes:
        periods: periods of the nominal system.
        speeds: mean speed in every period [m/s], (N,).
    """

    periods: Periods
    speeds: Array

    @classmethod
    def of(cls, problem: Problem, drive: Trajectory, states: Array, speeds: Array) -> ScoredDrive:
        """Return the periods that begin at the states at the samples.

        Args:
            problem: problem that is scored.
            drive: drive that is scored.
            states: states at the samples, (N + runs, states).
            speeds: mean speed in every period [m/s], (N,).
        """
        nominal, (system, parts) = np.array([problem.system.nominal]), problem.system.refinement
        if parts > 1:
            return cls(periods_of(system, drive, nominal, drive.starts[None], parts=parts), speeds)
        begins = np.concatenate([run[:-1] for run in np.split(states, drive.runs)])
        return cls(Periods(drive, begins, nominal, np.zeros((len(begins), 0))), speeds)


def most_exceeded(
    problem: Problem,
    limit: Limit,
    scored_drive: ScoredDrive,
    excesses: Array,
    window: tuple[float, float] = (-np.inf, np.inf),
) -> tuple[float, bool]:
    """Return the largest excess of a problem's limit at any time of a drive, and if that is certain.

    Args:
        problem: problem whose limit it is.
        limit: one of the problem's limits.
        scored_drive: drive as the scorer has simulated it.
        excesses: excess of the limit's rows at the points that are scored, (rows,).
        window: least and most excess of interest: values beyond need not be accurate.
    """
    excess, (least, enough) = float(excesses.max()), window
    if limit.looks_at != "state":
        return excess, limit.looks_at is not None
    is_certain, largest_seen = True, max(excess, least)
    for rows, periods, stretches in _checked(problem, limit, scored_drive, excesses, largest_seen):
        if not rows.is_bounded:
            return largest_seen, False
        if largest_seen > enough:
            break
        before = np.full(periods.drives, largest_seen)
        values, certain = largest(rows, periods, before, enough=enough, stretches=stretches)
        largest_seen, is_certain = float(values.max()), is_certain and bool(certain.all())
    return largest_seen, is_certain


def _checked(
    problem: Problem, limit: Limit, scored_drive: ScoredDrive, excesses: Array, before: float
) -> Iterator[tuple[Excess, Periods, Stretches | None]]:
    # The nominal system, with its back-off, and the other systems that are to keep the limit.
    tightening, drive = problem.robust, scored_drive.periods.trajectory
    if tightening is None or not isinstance(limit, PathLimit):
        excess = excess_of(limit, problem.system.refinement[0])
        yield excess, scored_drive.periods, _near(excess, scored_drive, excesses, before)
        return
    scenarios = tightening.scenarios(problem.uncertain_system)
    system, parts = scenarios.system.refinement
    if tightening.backs_off:
        for place, run in enumerate(drive.each):
            parameters, start = np.array([system.nominal]), run.starts[None, :]
            nominal = periods_of(system, run, parameters, start, sensitive=True, parts=parts)
            yield _backed_off(tightening, limit, problem.uncertain_system, place), nominal, None
    else:
        scenarios = scenarios.after_nominal
    if len(scenarios.parameters):
        starts = drive.starts + scenarios.shifts
        scenario_periods = periods_of(system, drive, scenarios.parameters, starts, parts=parts)
        yield excess_of(limit, system), scenario_periods, None


def _near(excess: Excess, scored_drive: ScoredDrive, excesses: Array, before: float) -> Stretches | None:
    # Parts of a path between its points that may hold more than the excess before, as far as systems move
    # between points; None if the rows' change with that is not bounded.
    if not np.isfinite(excess.per_metre):
        return None
    drive = scored_drive.periods.trajectory
    # The most exceeded row at each point of each run, (runs, points).
    points = excesses.reshape(-1, drive.runs, FINE * (drive.samples // drive.runs) + 1).max(axis=0)
    reach = excess.per_metre * np.repeat(scored_drive.speeds, FINE) * drive.period / (2 * FINE)
    bounds = np.maximum(points[:, :-1], points[:, 1:]).ravel() + reach
    places = np.flatnonzero(~(bounds <= _ceiling(excess, np.array([before]))))
    return Stretches(places // FINE, places % FINE / FINE, (places % FINE + 1) / FINE)


@lru_cache(maxsize=128)
def excess_of(limit: Limit, system: System) -> Excess:
    """Return a limit's excess on a system."""
    change = change_per_metre(limit, system) if isinstance(limit, PathLimit) else np.inf
    return Excess(limit.rows, system, per_metre=change)


@lru_cache(maxsize=32)
def _backed_off(tightening: Tightening, limit: PathLimit, uncertain: UncertainSystem, run: int) -> Excess:
    # The same object for all problems that are tightened alike.

    def rows(instant: Instant) -> Rows:
        return tightening.backed_off(limit, instant, uncertain)

    system, _ = tightening.scenarios(uncertain).system.refinement
    return Excess(rows, system, sensitive=True, run=run)


def largest(
    excess: Excess,
    periods: Periods,
    before: Array,
    *,
    enough: Array | float = np.inf,
    stretches: Stretches | None = None,
) -> tuple[Array, Bools]:
    """Return the largest excess of each drive at any time, (drives,), and if it is certain to `GAP`.

    Args:
        excess: excess of a limit.
        periods: periods of the drives.
        before: excess of each drive that is known before, (drives,).
        enough: excess from which a drive's is not searched any further.
        stretches: parts that may hold more than `before`; all periods by default.
    """
    values = np.array(before, dtype=float)
    is_certain = np.ones(len(values), dtype=bool)
    if (most := excess.exact_most(periods)) is not None:
        return np.maximum(values, most), is_certain
    remaining = PATIENCE + 20 * len(periods.states)
    stretches = excess.everywhere(periods) if stretches is None else stretches
    while len(stretches):
        drives = periods.drive_of(stretches.row)
        ends, bounds = excess.over(periods, stretches, _ceiling(excess, values)[drives])
        np.maximum.at(values, drives, ends)
        remaining -= len(stretches)
        is_closed = (bounds <= _ceiling(excess, values)[drives]) | (values > enough)[drives]
        is_closed |= stretches.end - stretches.begin < NARROWEST
        stretches = stretches.chosen(~is_closed)
        if remaining < 0:
            is_certain[drives[~is_closed]] = False
            break
        stretches = stretches.cut(max(AT_LEAST // max(len(stretches), 1), 2))
    return values, is_certain


def _ceiling(excess: Excess, values: Array) -> Array:
    # Bounds up to here close a stretch.
    return values + np.maximum(GAP * excess.size, SHARE * np.abs(values))


def change_per_metre(limit: PathLimit, system: System) -> float:
    """Return the most that a limit's rows change per metre of way at the mean speed of a period.

    Infinite for systems that may go farther within a period than their mean velocity says.
    """
    return limit.per_metre if system.as_far_as_velocity else np.inf
