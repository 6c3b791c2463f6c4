"""Moves in time: each as fast as the inputs' limits allow, all stretched to the study's duration."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from oed.foundation.arrays import Array, Places
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.problem import Problem
from oed.robots.baselines.kinematics import Kinematics, kinematics
from oed.robots.baselines.patterns import Move
from oed.robots.baselines.placing import Pose, start_of

STEERING_TIME = 0.25
"""Time of a change of steering angle [s] where nothing limits its rate."""


def starts(problem: Problem, pose: Pose | None = None) -> Array:
    """Start states (runs, states): where the study says, or at a pose (x, y, heading) where it is free."""
    if problem.fixed_starts is not None:
        return problem.fixed_starts
    return problem.start_states([pose or start_of(problem)] * problem.design.runs)


def stretched(problem: Problem, moves: Sequence[Move], pose: Pose | None = None) -> Trajectory:
    """The drive of these moves, in every run the same.

    Every move is at the limits of speed and acceleration, then all are slowed (or hurried) to the duration.

    Args:
        problem: with the limits, the duration and the start.
        moves: one after the other.
        pose: where a free start is; None for the middle of the room.
    """
    space, inverse = problem.design, kinematics(problem.model)
    inputs = _steered(problem, moves, inverse) if inverse.steers else _unsteered(problem, moves, inverse)
    return Trajectory.from_samples(
        np.tile(inputs, (space.runs, 1)),
        space.whole_duration,
        starts(problem, pose),
        rest_to_rest=space.rest_to_rest,
        runs=space.runs,
    )


def least_samples(problem: Problem, moves: Sequence[Move]) -> int:
    """Samples that a drive of these moves needs at least, where the robot stops to steer."""
    inverse = kinematics(problem.model)
    if not inverse.steers:
        return 1
    directions, _ = inverse.directions(moves, problem.input_bounds)
    changes = _changes(problem, directions[:, inverse.steers])
    return len(moves) + sum(change.least for change in changes)


def least_seconds(problem: Problem, moves: Sequence[Move]) -> float:
    """The time [s] that a drive of these moves takes at the limits of speed and acceleration."""
    inverse = kinematics(problem.model)
    directions, _ = inverse.directions(moves, problem.input_bounds)
    profiles = _profiles(problem, moves, directions)
    if not inverse.steers:
        return sum(profile.duration for profile in profiles)
    moving = _moving(problem, profiles)
    return problem.design.period * float(
        moving.sum() + sum(change.fastest for change in _changes(problem, directions[:, inverse.steers]))
    )


def _profiles(problem: Problem, moves: Sequence[Move], directions: Array) -> list[Trapezoid]:
    # Laps repeat their moves.
    known: dict[Move, Trapezoid] = {}
    for move, direction in zip(moves, directions, strict=True):
        if move not in known:
            known[move] = Trapezoid.fastest(problem, direction)
    return [known[move] for move in moves]


def _moving(problem: Problem, profiles: Sequence[Trapezoid]) -> Places:
    # Whole periods that each move takes at least.
    durations = np.array([profile.duration for profile in profiles])
    return np.maximum(np.ceil(durations / problem.design.period - 1e-9), 1).astype(np.int64)


def _unsteered(problem: Problem, moves: Sequence[Move], inverse: Kinematics) -> Array:
    # Inputs (N, inputs): the moves one straight after the other.
    space = problem.design
    directions, _ = inverse.directions(moves, problem.input_bounds)
    profiles = _profiles(problem, moves, directions)
    total = sum(profile.duration for profile in profiles)
    edges = np.linspace(0.0, space.duration, space.samples + 1) * (total / space.duration)
    wanted = inverse.wanted(moves)
    twists, began = np.zeros((space.samples, wanted.shape[1])), 0.0
    for move, profile in zip(wanted, profiles, strict=True):
        # The mean rate of each period: held sample by sample, every move still goes its whole way.
        rates = np.diff(profile.progress(edges - began)) / space.period
        twists += rates[:, None] * move
        began += profile.duration
    return inverse.inputs(twists, np.zeros((space.samples, 0)))


def _steered(problem: Problem, moves: Sequence[Move], inverse: Kinematics) -> Array:
    # Inputs (N, inputs): whole periods for each move and for each change of steering between them, because
    # a period that two moves share would need two steering angles.
    space = problem.design
    directions, _ = inverse.directions(moves, problem.input_bounds)
    held, wanted = directions[:, inverse.steers], inverse.wanted(moves)
    profiles = _profiles(problem, moves, directions)
    changes = _changes(problem, held)
    moving, standing = _periods(problem, profiles, changes)
    angles, twists = [], []
    for index, change in enumerate(changes):
        angles.append(change.angles(int(standing[index])))
        twists.append(np.zeros((standing[index], wanted.shape[1])))
        if index < len(moves):
            edges = np.linspace(0.0, profiles[index].duration, moving[index] + 1)
            rates = np.diff(profiles[index].progress(edges)) / space.period
            angles.append(np.tile(held[index], (moving[index], 1)))
            twists.append(rates[:, None] * wanted[index])
    return inverse.inputs(np.vstack(twists), np.vstack(angles))


@dataclass(frozen=True)
class _Change:
    """A change of steering at a standstill, from `before` to `after` (steers,) [rad].

    Attributes:
        least: periods it takes at least.
        fastest: periods it takes at its rate limit.
        first, last: whether the drive begins or ends with it, in its middle of a period.
    """

    before: Array
    after: Array
    least: int
    fastest: int
    first: bool
    last: bool

    def angles(self, periods: int) -> Array:
        """Angles (periods, steers) in the middles of the periods; the robot rolls before and after them, so
        that the outermost are those of its moves.
        """
        places = np.arange(periods) + (0.5 if self.first else 0.0)
        shares = places / (periods - (0.5 if self.first or self.last else 1.0)) if periods else places
        return np.asarray(self.before + shares[:, None] * (self.after - self.before))


def _changes(problem: Problem, held: Array) -> list[_Change]:
    # Before, between and after moves at steering angles `held` (moves, steers).
    space, steers = problem.design, kinematics(problem.model).steers
    rest = np.zeros((1, held.shape[1]))
    ends = (rest, rest) if space.rest_to_rest else (held[:1], held[-1:])
    via = np.vstack([ends[0], held, ends[1]])
    bounds, changes = problem.rate_bounds[steers], []
    for index, (before, after) in enumerate(pairwise(via)):
        first, last = index == 0, index == len(held)
        seconds = _steering_time(after - before, bounds)
        least = 0 if seconds == 0 else 1 if first or last else 2
        idle = 0.5 if first or last else 1.0
        fastest = math.ceil(seconds / space.period + idle - 1e-10) if seconds > 0 else 0
        changes.append(_Change(before, after, least, max(least, fastest), first, last))
    return changes


def _steering_time(turned: Array, bounds: Array) -> float:
    # Of a change of angles (steers,) [rad] at rates within `bounds` (steers, 2).
    if np.abs(turned).max() < 1e-9:
        return 0.0
    shares = [most(value, low, high) for value, (low, high) in zip(turned, bounds, strict=True)]
    fastest = min(shares)
    return 1.0 / fastest if math.isfinite(fastest) else STEERING_TIME


def _periods(
    problem: Problem, profiles: Sequence[Trapezoid], changes: Sequence[_Change]
) -> tuple[Places, Places]:
    # Periods of every move and every change, the whole run together; changes wait only where all must hurry.
    space = problem.design
    durations = np.array([profile.duration for profile in profiles])
    moving = _moving(problem, profiles)
    standing = np.array([change.fastest for change in changes])
    spare = space.samples - int(moving.sum() + standing.sum())
    if spare >= 0:
        return moving + _shared(spare, durations), standing
    least = np.array([1] * len(profiles) + [change.least for change in changes])
    wanted = np.concatenate([moving, standing])
    counts = least + _shared(space.samples - int(least.sum()), (wanted - least).astype(float))
    return counts[: len(profiles)], counts[len(profiles) :]


def _shared(total: int, weights: Array) -> Places:
    # Whole numbers in proportion to `weights` whose sum is `total`.
    exact = total * weights / weights.sum()
    shares: Places = np.floor(exact).astype(np.int64)
    largest = np.argsort(shares - exact, kind="stable")[: total - int(shares.sum())]
    shares[largest] += 1
    return shares


@dataclass(frozen=True)
class Trapezoid:
    """Progress 0 to 1 with constant acceleration, constant speed, constant deceleration; times in s."""

    duration: float
    ramp: float

    @classmethod
    def fastest(cls, problem: Problem, direction: Array) -> Trapezoid:
        """The fastest progress along inputs `direction` (inputs,) that speed and acceleration allow."""
        drives = kinematics(problem.model).drives
        speeds, rates, values = problem.input_bounds[drives], problem.rate_bounds[drives], direction[drives]
        speed = min(most(value, low, high) for value, (low, high) in zip(values, speeds, strict=True))
        rate = min(
            min(most(value, low, high), most(-value, low, high))
            for value, (low, high) in zip(values, rates, strict=True)
        )
        if not math.isfinite(rate):
            return cls(1.0 / speed, 0.0)
        if speed * speed / rate >= 1.0:
            ramp = 1.0 / math.sqrt(rate)
            return cls(2 * ramp, ramp)
        ramp = speed / rate
        return cls(ramp + 1.0 / speed, ramp)

    def progress(self, times: Array) -> Array:
        """Progress at `times` [s] since the move began: 0 before it, 1 after it."""
        top = 1.0 / (self.duration - self.ramp)
        inside = np.clip(times, 0.0, self.duration)
        left = self.duration - inside
        steady = top * (inside - self.ramp / 2)
        if self.ramp == 0:
            return steady
        rising, falling = top * inside**2 / (2 * self.ramp), 1.0 - top * left**2 / (2 * self.ramp)
        return np.where(inside < self.ramp, rising, np.where(left < self.ramp, falling, steady))


def most(value: float, low: float, high: float) -> float:
    """The largest factor for which factor * value stays in [low, high].

    A forbidden sign is as if allowed, so that the drive exists and its evaluation names the limit.

    Args:
        value: what is scaled.
        low: least value allowed.
        high: largest value allowed.
    """
    bound = (high if value > 0 else -low) or max(abs(low), abs(high))
    return math.inf if value == 0 else abs(bound / value)
