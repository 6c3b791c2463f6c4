"""Limits between the points: the most that a drive exceeds them at any time, by branch and bound.

Over a stretch of a period, a limit's rows are functions of the time elapsed alone. Their values at both ends
and bounds of their slopes tell how large they can be in between [Piyavskii, 1972]; stretches that may hold
more than has been found are halved, until what is found is the most there is, to `GAP`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from oed.foundation.arrays import Array, Bools
from oed.kernel.between.excess import Excess
from oed.kernel.between.periods import NARROWEST, Periods, Stretches, periods_of
from oed.kernel.dynamics.enclosures import NotEnclosed
from oed.kernel.dynamics.rollout import FINE, Instant
from oed.kernel.dynamics.system import System
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.limit import Limit, PathLimit, Rows
from oed.kernel.problem import Problem
from oed.kernel.tightening import Tightening, UncertainSystem

GAP = 1e-6
"""Share of a limit's size to which its largest excess is found."""
SHARE = 1e-4
"""Share of the distance from a limit to which that is found."""
MANY, PARTS = 128, 32
"""Stretches that are bounded about as fast as one; parts that each of a few is cut into at most."""
PATIENCE = 200_000
"""Stretches bounded at most, besides 20 for every period, before a limit counts as checked at points only."""


@dataclass(frozen=True)
class Sight:
    """What is known of a drive before anybody looks between its points.

    Attributes:
        periods: of the nominal system.
        speeds: mean speed in every one of them [m/s], (N,).
    """

    periods: Periods
    speeds: Array

    @classmethod
    def of(cls, problem: Problem, drive: Trajectory, states: Array, speeds: Array) -> Sight:
        """What is known by the states at the samples, (N + runs, states).

        Args:
            problem: that is scored.
            drive: what is driven.
            states: at the samples, (N + runs, states).
            speeds: mean speed in every period [m/s], (N,).
        """
        nominal, (system, parts) = np.array([problem.system.nominal]), problem.system.refinement
        if parts > 1:
            return cls(periods_of(system, drive, nominal, drive.starts[None], parts=parts), speeds)
        begins = np.concatenate([run[:-1] for run in np.split(states, drive.runs)])
        return cls(Periods(drive, begins, nominal, np.zeros((len(begins), 0))), speeds)


def most_exceeded(
    problem: Problem, limit: Limit, sight: Sight, seen: Array, asked: tuple[float, float] = (-np.inf, np.inf)
) -> tuple[float, bool]:
    """The most that a drive exceeds a problem's limit at any time, given by how much each of the rows does
    that the scorer looks at, (rows,), and whether that is sure.

    Args:
        problem: whose limit it is.
        limit: one of its limits.
        sight: what is known of the drive.
        seen: by how much its rows are exceeded at the points that are scored, (rows,).
        asked: least and most; how far below the least or above the most it is, nobody asks.
    """
    found, (least, enough) = float(seen.max()), asked
    if limit.looks_at != "state":
        return found, limit.looks_at is not None
    certain, found = True, max(found, least)
    try:
        for excess, periods, stretches in _looked_at(problem, limit, sight, seen, found):
            if found > enough:
                break
            known = np.full(periods.drives, found)
            most, sure = largest(excess, periods, known, enough=enough, stretches=stretches)
            found, certain = float(most.max()), certain and bool(sure.all())
    except NotEnclosed:
        return found, False
    return found, certain


def _looked_at(
    problem: Problem, limit: Limit, sight: Sight, seen: Array, found: float
) -> Iterator[tuple[Excess, Periods, Stretches | None]]:
    # The nominal system, with its back-off; and the other systems that are to keep the limit.
    tightening, drive = problem.robust, sight.periods.trajectory
    if tightening is None or not isinstance(limit, PathLimit):
        excess = excess_of(limit, problem.system.refinement[0])
        yield excess, sight.periods, _near(excess, sight, seen, found)
        return
    scenarios = tightening.scenarios(problem.uncertain_system)
    system, parts = scenarios.system.refinement
    if tightening.backs_off:
        for run, one in enumerate(drive.each):
            parameters, start = np.array([system.nominal]), one.starts[None, :]
            nominal = periods_of(system, one, parameters, start, sensitive=True, parts=parts)
            yield _backed_off(tightening, limit, problem.uncertain_system, run), nominal, None
    else:
        scenarios = scenarios.after_nominal
    if len(scenarios.parameters):
        starts = drive.starts + scenarios.shifts
        others = periods_of(system, drive, scenarios.parameters, starts, parts=parts)
        yield excess_of(limit, system), others, None


def _near(excess: Excess, sight: Sight, seen: Array, known: float) -> Stretches | None:
    # The parts of a path between points where more may be than is known, as far as systems move between
    # them; None where nobody knows how far rows change with that.
    if not np.isfinite(excess.per_metre):
        return None
    found, drive = np.array([known]), sight.periods.trajectory
    # Of every run all points, (runs, points); at each its most exceeded row.
    points = seen.reshape(-1, drive.runs, FINE * (drive.samples // drive.runs) + 1).max(axis=0)
    reach = excess.per_metre * np.repeat(sight.speeds, FINE) * drive.period / (2 * FINE)
    bounds = np.maximum(points[:, :-1], points[:, 1:]).ravel() + reach
    places = np.flatnonzero(~(bounds <= found + gap_of(excess.size, found)))
    return Stretches(places // FINE, places % FINE / FINE, (places % FINE + 1) / FINE)


@lru_cache(maxsize=128)
def excess_of(limit: Limit, system: System) -> Excess:
    """A limit's excess as it stands."""
    change = change_per_metre(limit, system) if isinstance(limit, PathLimit) else np.inf
    return Excess(limit.rows, system, per_metre=change)


@lru_cache(maxsize=32)
def _backed_off(tightening: Tightening, limit: PathLimit, uncertain: UncertainSystem, run: int) -> Excess:
    # One and the same for all problems that are tightened alike.

    def rows(instant: Instant) -> Rows:
        return tightening.backed_off(limit, instant, uncertain)

    system, _ = tightening.scenarios(uncertain).system.refinement
    return Excess(rows, system, sensitive=True, run=run)


def largest(
    excess: Excess,
    periods: Periods,
    found: Array,
    *,
    enough: Array | float = np.inf,
    stretches: Stretches | None = None,
) -> tuple[Array, Bools]:
    """The largest excess of each drive at any time, (drives,), and whether it is sure, to `GAP`.

    Args:
        excess: of a limit.
        periods: of the drives.
        found: excess found before, (drives,): stretches that cannot hold more are left alone.
        enough: excess above which a drive's is not looked for any further.
        stretches: outside of which no more than `found` can be; all periods by default.
    """
    found = np.array(found, dtype=float)
    sure = np.ones(len(found), dtype=bool)
    if (most := excess.exactly(periods)) is not None:
        return np.maximum(found, most), sure
    left = PATIENCE + 20 * len(periods.states)
    stretches = excess.everywhere(periods) if stretches is None else stretches
    while len(stretches):
        drives = periods.drive_of(stretches.row)
        ceiling = (found + gap_of(excess.size, found))[drives]
        values, bounds = excess.over(periods, stretches, ceiling)
        np.maximum.at(found, drives, values)
        left -= len(stretches)
        ceiling = (found + gap_of(excess.size, found))[drives]
        closed = (bounds <= ceiling) | (found > enough)[drives]
        closed |= stretches.end - stretches.begin < NARROWEST
        stretches = stretches.chosen(~closed)
        if left < 0:
            sure[drives[~closed]] = False
            break
        stretches = stretches.cut(min(max(MANY // max(len(stretches), 1), 2), PARTS))
    return found, sure


def gap_of(size: float, found: Array) -> Array:
    """How closely the largest excess is found: to a share of the limit's size, or of the distance from it."""
    return np.maximum(GAP * size, SHARE * np.abs(found))


def change_per_metre(limit: PathLimit, system: System) -> float:
    """What a limit's rows change by at most per metre that the system's mean speed says of a period.

    Infinite for systems that may go farther within a period than their mean velocity says.
    """
    return limit.per_metre if system.as_far_as_velocity else np.inf
