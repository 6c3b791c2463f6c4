"""Limits between the points: the most that a drive exceeds them at any time, by branch and bound.

Over a stretch of a period, a limit's rows are functions of the time elapsed alone. Their values at both ends
and bounds of their slopes tell how large they can be in between [Piyavskii, 1972]; stretches that may hold
more than has been found are halved, until what is found is the most there is, to `GAP`.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from oed.between.excess import NARROWEST, Excess
from oed.between.periods import Periods, periods_of
from oed.enclosures import NotEnclosed
from oed.limits.limit import Limit, PathLimit, Rows
from oed.models.model import Integration, Model, follows_state
from oed.problem import Problem
from oed.robust import reserved
from oed.rollout import Moment
from oed.trajectory import Trajectory

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

GAP = 1e-6
"""Share of a limit's size to which its largest excess is found."""
INSIDE = 1e-4
"""Share of the distance to a limit to which that is found, of drives that keep it."""
PARTS, FEW = 8, 64
"""Parts that each of a few stretches is cut into; many are halved."""
PATIENCE = 200_000
"""Stretches bounded at most, besides 20 for every period, before a limit counts as checked at points only."""


def most_exceeded(
    problem: Problem, limit: Limit, drive: Trajectory, poses: Array, found: float
) -> tuple[float, bool]:
    """The most that a drive exceeds a problem's limit at any time, given its states at the samples (N + runs,
    states) and what it does at some times, and whether that is sure.
    """
    if limit.looks_at != "state":
        return found, limit.looks_at is not None
    certain = True
    try:
        for excess, periods in _looked_at(problem, limit, drive, poses):
            (found,), (sure,) = largest(excess, periods, np.array([found]))
            certain = certain and bool(sure)
    except NotEnclosed:
        return found, False
    return float(found), certain


def _looked_at(
    problem: Problem, limit: Limit, drive: Trajectory, poses: Array
) -> Iterator[tuple[Excess, Periods]]:
    # The nominal robot, with what is kept in reserve; and the other robots that are to keep the limit.
    robust, spread, rule = problem.robust, problem.spread, problem.design.integration
    if robust is None or spread is None or not isinstance(limit, PathLimit):
        begins = np.concatenate([run[:-1] for run in np.split(poses, drive.runs)])
        own = Periods(drive, begins, np.array([problem.robot.nominal]), np.zeros((len(begins), 0)))
        yield excess_of(limit, problem.robot, rule), own
        return
    robot = spread.robot
    if robust.kind != "scenarios":
        for run, one in enumerate(drive.each):
            nominal = _of_one(robot, rule, one, np.array(robot.nominal), one.starts, sensitive=True)
            yield _reserved(problem, limit, run), nominal
    values = robust.scenarios(spread)
    if robust.kind == "scenarios":
        values = np.vstack([spread.nominal, values])
    starts = drive.starts + spread.shifts(values)
    for parameters, start in zip(spread.robots(values), starts, strict=True):
        other = _of_one(robot, rule, drive, parameters, start)
        yield excess_of(limit, robot, rule), other


def _of_one(
    robot: Model,
    rule: Integration,
    drive: Trajectory,
    parameters: Array,
    starts: Array,
    *,
    sensitive: bool = False,
) -> Periods:
    return periods_of(robot, rule, drive, parameters[None, :], starts[None, :], sensitive=sensitive)


@lru_cache(maxsize=128)
def excess_of(limit: Limit, robot: Model, rule: Integration) -> Excess:
    """A limit's excess as it stands."""
    change = change_per_metre(limit, robot, rule) if isinstance(limit, PathLimit) else np.inf
    return Excess(limit.rows, robot, rule, per_metre=change)


@lru_cache(maxsize=32)
def _reserved(problem: Problem, limit: PathLimit, run: int) -> Excess:
    spread, robust = problem.spread, problem.robust
    assert spread is not None
    assert robust is not None

    def rows(instant: Moment) -> Rows:
        return reserved(limit, instant, spread, robust)

    return Excess(rows, spread.robot, problem.design.integration, sensitive=True, run=run)


def largest(
    excess: Excess,
    periods: Periods,
    found: Array,
    *,
    enough: Array | float = np.inf,
) -> tuple[Array, Bools]:
    """The largest excess of each drive at any time, (drives,), and whether it is sure, to `GAP`.

    Args:
        excess: of a limit.
        periods: of the drives.
        found: excess found before, (drives,): stretches that cannot hold more are left alone.
        enough: excess above which a drive's is not looked for any further.
    """
    found = np.array(found, dtype=float)
    sure = np.ones(len(found), dtype=bool)
    left = PATIENCE + 20 * len(periods.states)
    stretches = excess.whole(periods)
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
        stretches = stretches.cut(PARTS if len(stretches) < FEW else 2)
    return found, sure


def gap_of(size: float, found: Array) -> Array:
    """How closely the largest excess is found: to a share of the limit's size, or of the distance to it."""
    return np.maximum(GAP * size, -INSIDE * found)


def change_per_metre(limit: PathLimit, robot: Model, rule: Integration) -> float:
    """What a limit's rows change by at most per metre that the robot's mean speed tells of a period.

    Infinite for robots whose twist changes within a period, and for the midpoint rule, whose paths bend away
    from its chords: there a part of the path may be longer than the speed tells.
    """
    return limit.per_metre if rule == "arc" and not follows_state(robot) else np.inf
