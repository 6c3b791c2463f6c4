"""Feasible drives of every sort, to be held against bounds."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from oed.bounds.reach import largest_rates, workspace_bounds
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.evaluation import evaluate
from oed.kernel.problem import Problem
from oed.kernel.results import Evaluation
from oed.kernel.scorer import limits_exceeded

Array = npt.NDArray[np.float64]

KINDS = ("noise", "bang_bang", "full_speed", "spin", "diagonal", "smooth")


def within_limits(problem: Problem, wanted: Array) -> Array:
    """The speeds (N, inputs) nearest in spirit to those wanted that keep the input limits."""
    space = problem.design
    low, high = problem.input_bounds.T
    step = space.period * largest_rates(problem) * (1 - 1e-9)
    speeds = np.clip(wanted, low, high)
    for index in range(1, len(speeds)):
        speeds[index] = np.clip(speeds[index], speeds[index - 1] - step, speeds[index - 1] + step)
    if space.rest_to_rest:
        times = np.minimum(np.arange(len(speeds)), np.arange(len(speeds))[::-1]) + 0.5
        reach = np.outer(times, np.where(np.isfinite(step), step, 1e9))
        speeds = np.clip(speeds, -reach, reach)
    return speeds


def wanted_speeds(problem: Problem, kind: str, rng: np.random.Generator) -> Array:
    """Speeds (N, inputs) of one of `KINDS`, whatever the accelerations and the room."""
    count = problem.design.samples
    low, high = problem.input_bounds.T
    if kind == "noise":
        return rng.uniform(low, high, (count, 2))
    if kind == "bang_bang":
        switches = rng.integers(0, 5)
        edges = np.sort(rng.integers(0, count, switches))
        levels = np.stack([rng.choice([low[0], high[0], 0.0], 6), rng.choice([low[1], high[1], 0.0], 6)])
        return levels[:, np.searchsorted(edges, np.arange(count), side="right")].T
    if kind == "full_speed":
        turn = rng.uniform(0, 1) if rng.random() < 0.7 else 0.0
        return np.tile(high, (count, 1)) * np.where(rng.random() < 0.5, [1, 1 - turn], [1 - turn, 1])
    if kind == "spin":
        return np.tile([high[0], low[1]], (count, 1))
    if kind == "diagonal":
        half = int(rng.integers(1, 6))
        forward = np.sign(np.sin(np.pi * half * (np.arange(count) + 0.5) / count))[:, None]
        return np.where(forward > 0, high, low) * np.ones((count, 2))
    knots = rng.uniform(low, high, (6, 2))
    return np.stack(
        [np.interp(np.linspace(0, 5, count), np.arange(6), knots[:, wheel]) for wheel in range(2)], axis=1
    )


def start_pose(problem: Problem, kind: str, rng: np.random.Generator) -> Array:
    """The fixed start, or a random one: a corner that faces the other for a diagonal."""
    fixed, bounds = problem.fixed_starts, workspace_bounds(problem)
    if fixed is not None:
        return fixed[0]
    if bounds is None:
        return rng.uniform(-1, 1, 3)
    x_min, x_max, y_min, y_max = bounds
    if kind == "diagonal":
        return np.array([x_min, y_min, np.arctan2(y_max - y_min, x_max - x_min)])
    return np.array([rng.uniform(x_min, x_max), rng.uniform(y_min, y_max), rng.uniform(-3, 3)])


def keep(problem: Problem, speeds: Array, start: Array) -> tuple[Array, Evaluation] | None:
    """The speeds, slowed until the room is kept, and their evaluation; None if no speed will do."""
    space = problem.design
    for _ in range(12):
        drive = Trajectory.from_samples(speeds, space.duration, start, rest_to_rest=space.rest_to_rest)
        # Of no limit here the size is more than 100, so none is exceeded by more than 1e-9 of its unit.
        if not limits_exceeded(problem, drive, 1e-11):
            return speeds, evaluate(problem, drive)
        # No slower where a limit excludes rest.
        if problem.input_bounds[:, 0].max() > 0:
            return None
        speeds = speeds * 0.75
    return None


def best_objective(problem: Problem, rng: np.random.Generator, drives: int, climbs: int) -> tuple[float, int]:
    """The best objective of so many random feasible drives, climbed from there; and how many there were."""
    best, tried = (-np.inf, np.zeros((0, 2)), np.zeros(3)), 0
    for index in range(drives + climbs):
        kind = KINDS[index % len(KINDS)]
        if index < drives or not len(best[1]):
            speeds, start = wanted_speeds(problem, kind, rng), start_pose(problem, kind, rng)
        else:
            speeds, start = _varied(problem, best[1], rng), best[2]
        kept = keep(problem, within_limits(problem, speeds), start)
        if kept is not None:
            tried += 1
            if kept[1].objective > best[0]:
                best = (kept[1].objective, kept[0], start)
    return best[0], tried


def _varied(problem: Problem, speeds: Array, rng: np.random.Generator) -> Array:
    # A stretch of one wheel's speeds moved by as much, or set to a bound.
    varied, count = speeds.copy(), len(speeds)
    first, last = np.sort(rng.integers(0, count + 1, 2))
    wheel = rng.integers(2)
    low, high = problem.input_bounds[wheel]
    if rng.random() < 0.5:
        varied[first:last, wheel] += rng.normal() * 0.2 * (high - low)
    else:
        varied[first:last, wheel] = rng.choice([low, high])
    return varied * rng.uniform(1.0, 1.15)
