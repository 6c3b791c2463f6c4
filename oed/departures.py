"""How likely a robot with uncertain parameters is to leave the limits of a drive: many robots, simulated."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np
import numpy.typing as npt
import scipy

from oed.between import Periods, change_per_metre, exceeded, excess_of, largest, periods_of
from oed.enclosures import NotEnclosed
from oed.evaluation import TOLERANCE
from oed.limits.limit import PathLimit
from oed.problem import Problem
from oed.rollout import Drive, roll_out
from oed.trajectory import Trajectory

Array = npt.NDArray[np.float64]

LEVEL = 0.95
"""Of the interval of a probability."""
BATCH = 500
"""Robots simulated in one call."""
WORST = 4
"""Robots that leave farthest, kept."""
DECIDED = 0.999
"""Share of the tolerance that nobody needs to know the excess below of."""
Bools = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Leaving:
    """How often robots leave the limits that the nominal robot keeps.

    Attributes:
        probability: share of the draws that exceed a limit on the path at any time.
        interval: of that probability, 95 %, exact [Clopper and Pearson, 1934].
        draws, seed: of the simulation.
        by_limit: share of the draws that exceed each limit.
        farthest: how far the worst draws exceed a limit, as a share of the limit's size; 0 for none.
        worst: the uncertain quantities of the draws that exceed a limit most, SI, (<= 4, q).
    """

    probability: float
    interval: tuple[float, float]
    draws: int
    seed: int
    by_limit: dict[str, float]
    farthest: float
    worst: Array

    @property
    def sentence(self) -> str:
        """The probability in words."""
        return f"{self.probability:.2%} of {self.draws} simulated robots leave the limits."

    def surely_below(self, probability: float) -> bool:
        """Whether the whole interval lies below a probability."""
        return self.interval[1] <= probability


def leaving(
    problem: Problem, trajectory: Trajectory, *, draws: int = 10_000, seed: int = 0, stream: int = 0
) -> Leaving:
    """Simulate robots drawn from a problem's uncertainty on one drive.

    Args:
        problem: with an uncertainty, or a prior.
        trajectory: the drive, as commanded: all robots get the same inputs.
        draws: robots.
        seed: of the draws.
        stream: of draws that are independent of those of other streams of the same seed.

    Raises:
        ValueError: the problem says nothing of what is uncertain.
    """
    spread = problem.spread
    if spread is None:
        raise ValueError("the problem has neither an uncertainty nor a prior")
    limits = path_limits(problem)
    values = spread.draws(draws, seed, stream)
    if not limits:
        return Leaving(0.0, _interval(0, draws), draws, seed, {}, 0.0, values[:0])
    excess = _excess(problem, trajectory, values)
    # What is not a number keeps no limit.
    beyond = ~(excess <= TOLERANCE)
    any_left = beyond.any(axis=1)
    farthest = excess.max(axis=1)
    order = np.argsort(-farthest, kind="stable")[: min(WORST, int(any_left.sum()))]
    return Leaving(
        probability=float(any_left.mean()),
        interval=_interval(int(any_left.sum()), draws),
        draws=draws,
        seed=seed,
        by_limit={limit.name: float(share) for limit, share in zip(limits, beyond.mean(axis=0), strict=True)},
        farthest=max(0.0, float(farthest.max())),
        worst=values[order],
    )


def left(problem: Problem, trajectory: Trajectory, values: Array) -> npt.NDArray[np.bool_]:
    """Whether robots of uncertain quantities `values` (K, q) leave any limit, (K,)."""
    if not path_limits(problem):
        return np.zeros(len(values), dtype=bool)
    return np.asarray((~(_excess(problem, trajectory, values) <= TOLERANCE)).any(axis=1))


def paths(problem: Problem, trajectory: Trajectory, values: Array) -> Array:
    """Poses at the samples (K, N + runs, states) of robots with uncertain quantities `values` (K, q)."""
    spread = problem.spread
    assert spread is not None
    function = _poses(problem, trajectory.samples, trajectory.runs)
    starts = trajectory.starts + spread.shifts(values)
    return np.array(
        [
            np.array(function(trajectory.inputs, trajectory.period, parameters, start))
            for parameters, start in zip(spread.robots(values), starts, strict=True)
        ]
    )


def path_limits(problem: Problem) -> list[PathLimit]:
    """The limits that a robot with other parameters may leave."""
    return [limit for limit in problem.limits if isinstance(limit, PathLimit)]


def _excess(problem: Problem, trajectory: Trajectory, values: Array) -> Array:
    # By how much each draw exceeds each limit, as a share of its size: (K, limits). Between the samples only
    # where that decides: of draws that come close to a limit at the samples, and of the worst ones.
    spread = problem.spread
    assert spread is not None
    robots, starts = spread.robots(values), trajectory.starts + spread.shifts(values)
    function = _exceeded(problem, trajectory.samples, trajectory.runs)
    simulated = _simulated(function, trajectory, robots, starts)
    excess, further = simulated[:, 0::2].copy(), simulated[:, 1::2]
    undecided = (excess <= TOLERANCE) & (further > TOLERANCE)
    worst = np.argsort(-excess.max(axis=1), kind="stable")[:WORST]
    for place, limit in enumerate(path_limits(problem)):
        wanted = np.union1d(np.flatnonzero(undecided[:, place]), worst)
        for some in np.array_split(wanted, -(-len(wanted) // BATCH)):
            periods = periods_of(
                spread.robot, problem.design.integration, trajectory, robots[some], starts[some]
            )
            excess[some, place] = _between(problem, limit, periods, excess[some, place], np.isin(some, worst))
    return excess


def _between(problem: Problem, limit: PathLimit, periods: Periods, found: Array, exactly: Bools) -> Array:
    # The same of some draws at all times: of most only whether they exceed the limit.
    assert problem.spread is not None
    try:
        excess = excess_of(limit, problem.spread.robot, problem.design.integration)
    except NotEnclosed:
        return found
    floor = np.where(exactly, found, np.maximum(found, DECIDED * TOLERANCE)) * excess.size
    enough = np.where(exactly, np.inf, TOLERANCE * excess.size)
    most, _ = largest(excess, periods, floor, enough=enough)
    return np.where(most > floor, most / excess.size, found)


def _simulated(function: ca.Function, trajectory: Trajectory, robots: Array, starts: Array) -> Array:
    found = []
    for first in range(0, len(robots), BATCH):
        own = slice(first, first + BATCH)
        count = len(robots[own])
        mapped = function.map("robots", "serial", count, [0, 1], [])
        begun = starts[own].transpose(1, 0, 2).reshape(trajectory.runs, -1)
        found.append(np.array(mapped(trajectory.inputs, trajectory.period, robots[own].T, begun)).T)
    return np.concatenate(found)


def _symbols(problem: Problem, samples: int, runs: int) -> list[ca.MX]:
    assert problem.spread is not None
    model = problem.spread.robot
    return [
        ca.MX.sym("inputs", samples, len(model.inputs)),
        ca.MX.sym("period"),
        ca.MX.sym("parameters", len(model.parameters)),
        ca.MX.sym("start", runs, len(model.states)),
    ]


def _drive(problem: Problem, symbols: list[ca.MX], runs: int) -> Drive:
    inputs, period, parameters, start = symbols
    assert problem.spread is not None
    return roll_out(
        problem.spread.robot,
        problem.design.integration,
        inputs=inputs,
        start=start,
        parameters=parameters,
        period=period,
        runs=runs,
    )


@lru_cache(maxsize=8)
def _exceeded(problem: Problem, samples: int, runs: int) -> ca.Function:
    # Of every limit the excess at the samples, and what it may be between: half a step further on.
    symbols = _symbols(problem, samples, runs)
    drive = _drive(problem, symbols, runs)
    speed = ca.sqrt(drive.twist[:, 0] ** 2 + drive.twist[:, 1] ** 2)
    step = ca.mmax(speed) * drive.period
    worst = []
    for limit in path_limits(problem):
        rows = limit.rows(drive)
        excess = ca.mmax(exceeded(rows))
        change = change_per_metre(limit, drive.model, drive.integration)
        further = excess + change * step / 2 if np.isfinite(change) else np.inf
        worst += [excess / rows.size, further / rows.size]
    return ca.Function("exceeded", symbols, [ca.vertcat(*worst)])


@lru_cache(maxsize=8)
def _poses(problem: Problem, samples: int, runs: int) -> ca.Function:
    symbols = _symbols(problem, samples, runs)
    return ca.Function("poses", symbols, [_drive(problem, symbols, runs).poses])


def _interval(count: int, draws: int) -> tuple[float, float]:
    tail = (1 - LEVEL) / 2
    low = float(scipy.stats.beta.ppf(tail, count, draws - count + 1)) if count else 0.0
    high = float(scipy.stats.beta.ppf(1 - tail, count + 1, draws - count)) if count < draws else 1.0
    return low, high
