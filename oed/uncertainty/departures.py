"""How likely a robot with uncertain parameters is to violate limits on a drive: many robots, simulated."""

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
from oed.uncertainty.uncertainty import Spread, given_spread

BATCH = 500
"""Robots simulated in one call."""
WORST = 4
"""Robots whose violations are largest, kept."""
DECIDED = 0.999
"""Share of the tolerance that nobody needs to know the excess below of."""
DRAWS = 1000
"""Robots simulated on every designed drive."""
MOSTLY = 95.0
"""Percentile of the distances of robots outside that is reported."""


@dataclass(frozen=True)
class Departures:
    """Robots that leave the workspace or hit an obstacle on a drive, by more than scoring tolerates.

    Attributes:
        share: of the robots drawn.
        interval: of the probability, 95 %, exact [Clopper and Pearson, 1934].
        distance: 95th percentile, among the robots that do, of how far they get outside or inside an obstacle
            at the samples [m]; 0 where no robot does, infinite where a path is not a number.
        limits: names of the limits that were looked at.
        draws, seed: of the simulation.
        spread: quantities and ranges that robots are drawn from.
    """

    share: float
    interval: tuple[float, float]
    distance: float
    limits: tuple[str, ...]
    draws: int
    seed: int
    spread: Spread


@dataclass(frozen=True)
class _Robots:
    """Robots with parameters (K, p) on one drive, from starts (K, runs, states)."""

    trajectory: Trajectory
    parameters: Array
    starts: Array

    def chosen(self, which: Any) -> _Robots:
        """Some of them."""
        return _Robots(self.trajectory, self.parameters[which], self.starts[which])


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
        problem: with an uncertainty, or a prior.
        trajectory: the drive, as commanded: all robots get the same inputs.
        draws: robots.
        seed: of the draws.
        stream: of draws that are independent of those of other streams of the same seed.
        drives: of which one is chosen by what these draws say: the interval is for all of them together.

    Raises:
        ValueError: the problem says nothing of what is uncertain.
    """
    limits = path_limits(problem)
    values = given_spread(problem.uncertain_system).draws(draws, seed, stream)
    if not limits:
        return Violation(0.0, interval_of(0, draws, drives), draws, seed, {}, 0.0, values[:0])
    excess, certain = _excess(problem, limits, trajectory, values)
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
        checked_at_points=tuple(limit.name for limit, sure in zip(limits, certain, strict=True) if not sure),
    )


@typed
def departures(
    problem: Problem, trajectory: Trajectory, *, draws: int = DRAWS, seed: int = 0
) -> Departures | None:
    """Simulate robots drawn from a problem's uncertainty on a drive: how many leave where they may be.

    Args:
        problem: with an uncertainty, or a prior.
        trajectory: the drive, as commanded: all robots get the same inputs.
        draws: robots.
        seed: of the draws.

    Returns:
        Robots that leave; None where the problem has no limit on positions.

    Raises:
        ValueError: the problem says nothing of what is uncertain.
    """
    limits = position_limits(problem)
    if not limits:
        return None
    spread = given_spread(problem.uncertain_system)
    excess, _ = _excess(problem, limits, trajectory, spread.draws(draws, seed))
    leaves = (excess > TOLERANCE).any(axis=1)
    distances = (excess * _sizes(problem, limits)).max(axis=1)[leaves]
    # Between neighbours nothing is interpolated: infinite distances have no mean.
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
    """Tell of robots of uncertain quantities `values` (K, q) which violate any limit, (K,).

    Args:
        problem: with path limits.
        trajectory: the drive, as commanded.
        values: of the uncertain quantities, (K, q).
        limits: that are looked at; all path limits by default.
    """
    chosen = path_limits(problem) if limits is None else list(limits)
    if not chosen:
        return np.zeros(len(values), dtype=bool)
    excess, _ = _excess(problem, chosen, trajectory, values)
    return np.asarray((excess > TOLERANCE).any(axis=1))


def paths(problem: Problem, trajectory: Trajectory, values: Array) -> Array:
    """Poses at the samples (K, N + runs, states) of robots with uncertain quantities `values` (K, q).

    Args:
        problem: whose robots drive.
        trajectory: the drive, as commanded.
        values: of the uncertain quantities, (K, q).
    """
    spread = given_spread(problem.uncertain_system)
    function = _poses(problem, trajectory.samples, trajectory.runs)
    starts = trajectory.starts + spread.shifts(values)
    return np.array(
        [
            np.array(function(trajectory.inputs, start, parameters, trajectory.period))
            for parameters, start in zip(spread.parameter_values(values), starts, strict=True)
        ]
    )


def path_limits(problem: Problem) -> list[PathLimit]:
    """The limits that a robot with other parameters may violate."""
    return [limit for limit in problem.limits if isinstance(limit, PathLimit)]


def position_limits(problem: Problem) -> list[PathLimit]:
    """Return the limits on where a system may be: the workspace and obstacles."""
    return [limit for limit in path_limits(problem) if np.isfinite(limit.per_metre)]


def _sizes(problem: Problem, limits: Sequence[PathLimit]) -> Array:
    # Sizes of limits [m], (limits,).
    system = given_spread(problem.uncertain_system).system
    origin = ca.DM.zeros(1, len(system.states))
    return np.array([limit.rows_at(origin, system).size for limit in limits])


def _excess(
    problem: Problem, limits: Sequence[PathLimit], trajectory: Trajectory, values: Array
) -> tuple[Array, Bools]:
    # By how much each draw exceeds each limit, as a share of its size, (K, limits), and of which limits that
    # is sure. Between the samples only where it decides: of draws that come close to a limit at the samples,
    # and of the worst ones.
    spread = given_spread(problem.uncertain_system)
    robots = _Robots(trajectory, spread.parameter_values(values), trajectory.starts + spread.shifts(values))
    excess, further = _at_points(problem, tuple(limits), robots)
    undecided = (excess <= TOLERANCE) & (further > TOLERANCE)
    worst = np.argsort(-excess.max(axis=1), kind="stable")[:WORST]
    certain = np.ones(len(limits), dtype=bool)
    for place, limit in enumerate(limits):
        wanted = np.union1d(np.flatnonzero(undecided[:, place]), worst)
        for some in np.array_split(wanted, -(-len(wanted) // BATCH)):
            own, found = robots.chosen(some), excess[some, place]
            excess[some, place], sure = _between(problem, limit, own, found, np.isin(some, worst))
            certain[place] &= sure
    return excess, certain


def _between(
    problem: Problem, limit: PathLimit, robots: _Robots, found: Array, exactly: Bools
) -> tuple[Array, bool]:
    # The same of some draws at all times, of most only whether they exceed the limit; and whether it is sure.
    system, parts = given_spread(problem.uncertain_system).system.refinement
    excess = excess_of(limit, system) if limit.looks_at == "state" else None
    if excess is None or not excess.is_bounded:
        closer, _ = _at_points(problem, (limit,), robots, FINE)
        return closer[:, 0], limit.looks_at is not None and limit.looks_at != "state"
    periods = periods_of(system, robots.trajectory, robots.parameters, robots.starts, parts=parts)
    floor = np.where(exactly, found, np.maximum(found, DECIDED * TOLERANCE)) * excess.size
    enough = np.where(exactly, np.inf, TOLERANCE * excess.size)
    most, sure = largest(excess, periods, floor, enough=enough)
    return np.where(most > floor, most / excess.size, found), bool(sure.all())


def _at_points(
    problem: Problem, limits: tuple[PathLimit, ...], robots: _Robots, refine: int = 1
) -> tuple[Array, Array]:
    # Each draw's excess of each limit at so many points per sample, and what it may be between, (K, limits).
    trajectory = robots.trajectory
    function = _exceeded(problem, limits, trajectory.samples, trajectory.runs, refine)
    found = []
    for first in range(0, len(robots.parameters), BATCH):
        own = robots.chosen(slice(first, first + BATCH))
        begun, period = own.starts.transpose(0, 2, 1), np.array(trajectory.period)
        (each,) = mapped(function, len(begun), 0, 3)(trajectory.inputs.T, begun, own.parameters, period)
        found.append(each.reshape(len(begun), -1))
    simulated = np.concatenate(found)
    return simulated[:, 0::2].copy(), simulated[:, 1::2]


@lru_cache(maxsize=8)
def _exceeded(
    problem: Problem, limits: tuple[PathLimit, ...], samples: int, runs: int, refine: int
) -> ca.Function:
    # Of every limit the excess at the points, and what it may be between: half a step further on.
    system = given_spread(problem.uncertain_system).system
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
    # Of all values. `mmax` ignores what is no number: one anywhere satisfies no limit.
    numbers = ca.logic_and(ca.mmin(values <= np.inf), ca.mmin(ca.fabs(path) < np.inf))
    return ca.if_else(numbers, ca.mmax(values), np.inf)


@lru_cache(maxsize=8)
def _poses(problem: Problem, samples: int, runs: int) -> ca.Function:
    symbols, drive = any_drive(given_spread(problem.uncertain_system).system, samples, runs)
    return ca.Function("poses", symbols, [drive.states])


def interval_of(count: int, draws: int, drives: int = 1) -> tuple[float, float]:
    """Interval of a probability [Clopper and Pearson, 1934], 95 % for all of several drives together
    [Bonferroni].

    Args:
        count: how often it happened.
        draws: of how many.
        drives: of which one is chosen by what is found here.
    """
    # Loaded by those who ask; `scipy.stats` takes seconds to load.
    from scipy.special import betaincinv

    tail = TAIL / drives
    low = float(betaincinv(count, draws - count + 1, tail)) if count else 0.0
    high = float(betaincinv(count + 1, draws - count, 1 - tail)) if count < draws else 1.0
    return low, high
