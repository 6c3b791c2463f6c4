"""Probability that a robot with uncertain parameters violates limits on a drive, by simulation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from oed.foundation.arguments import typed
from oed.foundation.arrays import Array, Bools
from oed.kernel.between import change_per_metre, exceeded, excess_of, largest, periods_of
from oed.kernel.dynamics.direct_call import mapped
from oed.kernel.dynamics.rollout import FINE, any_drive
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.limit import PathLimit
from oed.kernel.problem import Problem
from oed.kernel.results import TOLERANCE
from oed.kernel.solution import TAIL, Violation
from oed.uncertainty.uncertainty import UncertainQuantities, require_spread

BATCH = 500
"""Number of robots simulated in one call."""
WORST = 4
"""Number of robots with the largest violations that a result holds."""
DECIDED = 0.999
"""Share of the tolerance below which the exact excess does not matter."""
DRAWS = 1000
"""Number of robots simulated on every designed drive."""
MOSTLY = 95.0
"""Reported percentile of the distances of robots outside."""


@dataclass(frozen=True)
class Departures:
    """Robots that leave the workspace or hit an obstacle on a drive by more than the scoring tolerance.

    Attributes:
        share: share of the simulated robots.
        interval: exact 95 % interval of the probability [Clopper and Pearson, 1934].
        distance: 95th percentile, among these robots, of the distance outside the workspace or inside an
            obstacle at the samples [m]; 0 without such robots, infinite if a path has NaN.
        limits: names of the limits.
        draws: number of simulated robots.
        seed: seed of the draws.
        spread: uncertain quantities and their ranges.
    """

    share: float
    interval: tuple[float, float]
    distance: float
    limits: tuple[str, ...]
    draws: int
    seed: int
    spread: UncertainQuantities


@dataclass(frozen=True)
class _Robots:
    """Robots with parameters (K, p) on a drive, from starts (K, runs, states)."""

    trajectory: Trajectory
    parameters: Array
    starts: Array

    def chosen(self, index: Any) -> _Robots:
        """Return the robots at an index."""
        return _Robots(self.trajectory, self.parameters[index], self.starts[index])


@typed
def violation_probability(
    problem: Problem,
    trajectory: Trajectory,
    *,
    draws: int = 10_000,
    seed: int = 0,
    stream: int = 0,
    drives: int = 1,
) -> Violation:
    """Simulate robots drawn from a problem's uncertainty on one drive.

    Args:
        problem: problem with an uncertainty or a prior.
        trajectory: commanded drive: all robots get the same inputs.
        draws: number of robots.
        seed: seed of the draws.
        stream: stream of the draws; streams of a seed are independent.
        drives: number of drives among which the draws select: the interval holds for all of them together.

    Raises:
        ValueError: the problem has neither an uncertainty nor a prior.
    """
    limits = path_limits(problem)
    values = require_spread(problem.uncertain_system).draws(draws, seed, stream)
    if not limits:
        return Violation(0.0, interval_of(0, draws, drives), draws, seed, {}, 0.0, values[:0])
    excess, is_proved = _excess(problem, limits, trajectory, values)
    beyond = excess > TOLERANCE
    any_violated = beyond.any(axis=1)
    farthest = excess.max(axis=1)
    order = np.argsort(-farthest, kind="stable")[: min(WORST, int(any_violated.sum()))]
    return Violation(
        probability=float(any_violated.mean()),
        interval=interval_of(int(any_violated.sum()), draws, drives),
        draws=draws,
        seed=seed,
        by_limit={limit.name: float(share) for limit, share in zip(limits, beyond.mean(axis=0), strict=True)},
        farthest=max(0.0, float(farthest.max())),
        worst=values[order],
        checked_at_points=tuple(
            limit.name for limit, sure in zip(limits, is_proved, strict=True) if not sure
        ),
    )


@typed
def departures(
    problem: Problem, trajectory: Trajectory, *, draws: int = DRAWS, seed: int = 0
) -> Departures | None:
    """Simulate robots drawn from a problem's uncertainty on a drive, and count those that leave its
    workspace.

    Args:
        problem: problem with an uncertainty or a prior.
        trajectory: commanded drive: all robots get the same inputs.
        draws: number of robots.
        seed: seed of the draws.

    Returns:
        Robots that leave; None if the problem has no limit on positions.

    Raises:
        ValueError: the problem has neither an uncertainty nor a prior.
    """
    limits = position_limits(problem)
    if not limits:
        return None
    spread = require_spread(problem.uncertain_system)
    excess, _ = _excess(problem, limits, trajectory, spread.draws(draws, seed))
    leaves = (excess > TOLERANCE).any(axis=1)
    distances = (excess * _sizes(problem, limits)).max(axis=1)[leaves]
    # Interpolation between neighbours would fail for infinite distances.
    distance = float(np.percentile(distances, MOSTLY, method="higher")) if len(distances) else 0.0
    return Departures(
        share=float(leaves.mean()),
        interval=interval_of(int(leaves.sum()), draws),
        distance=distance,
        limits=tuple(limit.name for limit in limits),
        draws=draws,
        seed=seed,
        spread=spread,
    )


def violated(
    problem: Problem, trajectory: Trajectory, values: Array, limits: Sequence[PathLimit] | None = None
) -> Bools:
    """Return True for robots that violate any limit, (K,).

    Args:
        problem: problem with path limits.
        trajectory: commanded drive.
        values: values of the uncertain quantities, (K, q).
        limits: limits to be checked; all path limits by default.
    """
    chosen = path_limits(problem) if limits is None else list(limits)
    if not chosen:
        return np.zeros(len(values), dtype=bool)
    excess, _ = _excess(problem, chosen, trajectory, values)
    return np.asarray((excess > TOLERANCE).any(axis=1))


def paths(problem: Problem, trajectory: Trajectory, values: Array) -> Array:
    """Return the poses of robots at the samples, (K, N + runs, states).

    Args:
        problem: problem of the robots.
        trajectory: commanded drive.
        values: values of the uncertain quantities, (K, q).
    """
    spread = require_spread(problem.uncertain_system)
    function = _poses(problem, trajectory.samples, trajectory.runs)
    starts = trajectory.starts + spread.shifts(values)
    return np.array(
        [
            np.array(function(trajectory.inputs, start, parameters, trajectory.period))
            for parameters, start in zip(spread.parameter_values(values), starts, strict=True)
        ]
    )


def path_limits(problem: Problem) -> list[PathLimit]:
    """Return the limits on the path, which robots with different parameters may violate."""
    return [limit for limit in problem.limits if isinstance(limit, PathLimit)]


def position_limits(problem: Problem) -> list[PathLimit]:
    """Return the limits on where a system may be: the workspace and obstacles."""
    return [limit for limit in path_limits(problem) if np.isfinite(limit.per_metre)]


def _sizes(problem: Problem, limits: Sequence[PathLimit]) -> Array:
    # Sizes of limits [m], (limits,).
    system = require_spread(problem.uncertain_system).system
    origin = ca.DM.zeros(1, len(system.states))
    return np.array([limit.rows_at(origin, system).size for limit in limits])


def _excess(
    problem: Problem, limits: Sequence[PathLimit], trajectory: Trajectory, values: Array
) -> tuple[Array, Bools]:
    # Excess of each draw over each limit, as a share of the limit's size, (K, limits), and True for limits
    # with a proved excess. Between the samples it is computed only where it decides: for draws that come
    # close to a limit at the samples, and for the worst draws.
    spread = require_spread(problem.uncertain_system)
    robots = _Robots(trajectory, spread.parameter_values(values), trajectory.starts + spread.shifts(values))
    excess, between = _at_points(problem, tuple(limits), robots)
    is_undecided = (excess <= TOLERANCE) & (between > TOLERANCE)
    worst = np.argsort(-excess.max(axis=1), kind="stable")[:WORST]
    is_proved = np.ones(len(limits), dtype=bool)
    for place, limit in enumerate(limits):
        draws = np.union1d(np.flatnonzero(is_undecided[:, place]), worst)
        for batch in np.array_split(draws, -(-len(draws) // BATCH)):
            selected, at_samples = robots.chosen(batch), excess[batch, place]
            excess[batch, place], sure = _between(problem, limit, selected, at_samples, np.isin(batch, worst))
            is_proved[place] &= sure
    return excess, is_proved


def _between(
    problem: Problem, limit: PathLimit, robots: _Robots, at_samples: Array, exactly: Bools
) -> tuple[Array, bool]:
    # Excess of some draws over a limit at all times, (K,), exact for the chosen ones, for others only
    # compared with the tolerance; and True if it is proved.
    system, parts = require_spread(problem.uncertain_system).system.refinement
    excess = excess_of(limit, system) if limit.looks_at == "state" else None
    if excess is None or not excess.is_bounded:
        closer, _ = _at_points(problem, (limit,), robots, FINE)
        return closer[:, 0], limit.looks_at is not None and limit.looks_at != "state"
    periods = periods_of(system, robots.trajectory, robots.parameters, robots.starts, parts=parts)
    floor = np.where(exactly, at_samples, np.maximum(at_samples, DECIDED * TOLERANCE)) * excess.size
    enough = np.where(exactly, np.inf, TOLERANCE * excess.size)
    most, sure = largest(excess, periods, floor, enough=enough)
    return np.where(most > floor, most / excess.size, at_samples), bool(sure.all())


def _at_points(
    problem: Problem, limits: tuple[PathLimit, ...], robots: _Robots, refine: int = 1
) -> tuple[Array, Array]:
    # Excess of each draw over each limit at `refine` points per sample, and its upper bound in between,
    # (K, limits) each.
    trajectory = robots.trajectory
    function = _exceeded(problem, limits, trajectory.samples, trajectory.runs, refine)
    batches = []
    for first in range(0, len(robots.parameters), BATCH):
        batch = robots.chosen(slice(first, first + BATCH))
        starts, period = batch.starts.transpose(0, 2, 1), np.array(trajectory.period)
        (excess,) = mapped(function, len(starts), 0, 3)(trajectory.inputs.T, starts, batch.parameters, period)
        batches.append(excess.reshape(len(starts), -1))
    simulated = np.concatenate(batches)
    return simulated[:, 0::2].copy(), simulated[:, 1::2]


@lru_cache(maxsize=8)
def _exceeded(
    problem: Problem, limits: tuple[PathLimit, ...], samples: int, runs: int, refine: int
) -> ca.Function:
    # Excess over every limit at the points, and its upper bound in between: half a step further on.
    system = require_spread(problem.uncertain_system).system
    symbols, drive = any_drive(system, samples, runs, refine=refine)
    step = ca.mmax(drive.speeds) * drive.period / refine
    worst = []
    for limit in limits:
        rows = limit.rows(drive)
        excess = _greatest(exceeded(rows), drive.path)
        change = change_per_metre(limit, drive.system)
        further = excess + change * step / 2 if np.isfinite(change) else np.inf
        worst += [excess / rows.size, further / rows.size]
    return ca.Function("exceeded", symbols, [ca.vertcat(*worst)])


def _greatest(values: ca.MX, path: ca.MX) -> ca.MX:
    # Largest of all values, infinite with NaN among them, which `mmax` ignores.
    numbers = ca.logic_and(ca.mmin(values <= np.inf), ca.mmin(ca.fabs(path) < np.inf))
    return ca.if_else(numbers, ca.mmax(values), np.inf)


@lru_cache(maxsize=8)
def _poses(problem: Problem, samples: int, runs: int) -> ca.Function:
    symbols, drive = any_drive(require_spread(problem.uncertain_system).system, samples, runs)
    return ca.Function("poses", symbols, [drive.states])


def interval_of(count: int, draws: int, drives: int = 1) -> tuple[float, float]:
    """Return the 95 % interval of a probability [Clopper and Pearson, 1934].

    For several drives it holds for all of them together [Bonferroni].

    Args:
        count: number of events.
        draws: number of trials.
        drives: number of drives among which the trials select.
    """
    # Imported here to keep other imports fast; `scipy.stats` would take seconds.
    from scipy.special import betaincinv

    tail = TAIL / drives
    low = float(betaincinv(count, draws - count + 1, tail)) if count else 0.0
    high = float(betaincinv(count + 1, draws - count, 1 - tail)) if count < draws else 1.0
    return low, high
