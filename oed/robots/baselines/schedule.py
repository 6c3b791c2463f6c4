"""Moves in time: each as fast as the inputs' limits allow, all stretched to the study's duration."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from oed.foundation.arrays import Array, Places
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.problem import Problem
from oed.robots.baselines.kinematics import Kinematics, kinematics
from oed.robots.baselines.patterns import Move
from oed.robots.baselines.placing import Pose, start_of
from oed.robots.baselines.rolling import Roll, steering, stretches
from oed.robots.limits.body_motion import LateralAcceleration, MotionLimit

STEERING_TIME = 0.25
"""Time of a change of steering angle [s] where nothing limits its rate."""


def starts(problem: Problem, poses: Sequence[Pose | None]) -> Array:
    """Start states (runs, states): where the study says, or at each run's pose (x, y, heading) where it is
    free; None for the middle of the room.
    """
    if problem.fixed_starts is not None:
        return problem.fixed_starts
    return problem.start_states([pose or start_of(problem) for pose in poses])


def stretched(
    problem: Problem, moves: Sequence[Sequence[Move]], poses: Sequence[Pose | None], *, rolls: bool = True
) -> Trajectory:
    """The drive of these moves, in runs that take turns to drive them.

    Every move is at the limits of speed and acceleration, then all are slowed (or hurried) to the duration.

    Args:
        problem: with the limits, the duration and the start.
        moves: of the first run, one after the other; of the second, and so on, then again.
        poses: where a free start of each of these is; None for the middle of the room.
        rolls: whether a car steers while it rolls, where it can.
    """
    space = problem.design
    inputs = [_inputs(problem, one, rolls) for one in moves]
    turns = [run % len(moves) for run in range(space.runs)]
    return Trajectory.from_samples(
        np.vstack([inputs[turn] for turn in turns]),
        space.whole_duration,
        starts(problem, [poses[turn] for turn in turns]),
        rest_to_rest=space.rest_to_rest,
        runs=space.runs,
    )


def least_samples(problem: Problem, moves: Sequence[Move], *, rolls: bool = True) -> int:
    """Samples that a drive of these moves needs at least, where the robot stops to steer.

    Args:
        problem: with the limits.
        moves: one after the other.
        rolls: whether a car steers while it rolls, where it can.
    """
    if not kinematics(problem.model).steers:
        return 1
    parts = _parts(problem, moves, rolls)
    return len(parts) + sum(change.least for change in _changes(problem, parts))


def least_seconds(problem: Problem, moves: Sequence[Move], *, rolls: bool = True) -> float:
    """The time [s] that a drive of these moves takes at the limits of speed and acceleration.

    Args:
        problem: with the limits.
        moves: one after the other.
        rolls: whether a car steers while it rolls, where it can.
    """
    inverse = kinematics(problem.model)
    if not inverse.steers:
        directions, _ = inverse.directions(moves, problem.input_bounds)
        return sum(profile.duration for profile in _profiles(problem, moves, directions))
    parts = _parts(problem, moves, rolls)
    standing = sum(change.fastest for change in _changes(problem, parts))
    return problem.design.period * float(_moving(problem, parts).sum() + standing)


def _profiles(problem: Problem, moves: Sequence[Move], directions: Array) -> list[Trapezoid]:
    # Laps repeat their moves.
    known: dict[Move, Trapezoid] = {}
    for move, direction in zip(moves, directions, strict=True):
        if move not in known:
            known[move] = Trapezoid.fastest(problem, direction, move)
    return [known[move] for move in moves]


def _moving(problem: Problem, parts: Sequence[_Part]) -> Places:
    # Whole periods that each part takes at least.
    durations = np.array([part.profile.duration for part in parts])
    return np.maximum(np.ceil(durations / problem.design.period - 1e-9), 1).astype(np.int64)


def _inputs(problem: Problem, moves: Sequence[Move], rolls: bool) -> Array:
    # Inputs (N, inputs) of one run.
    inverse = kinematics(problem.model)
    if not inverse.steers:
        return _unsteered(problem, moves, inverse)
    return _steered(problem, _parts(problem, moves, rolls), inverse)


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


def _steered(problem: Problem, parts: Sequence[_Part], inverse: Kinematics) -> Array:
    # Inputs (N, inputs): whole periods for each part and for each change of steering between them, because
    # a period that two parts share would need two steering angles.
    changes = _changes(problem, parts)
    moving, standing = _periods(problem, parts, changes)
    angles, twists = [], []
    for index, change in enumerate(changes):
        angles.append(change.angles(int(standing[index])))
        twists.append(np.zeros((standing[index], len(inverse.rows))))
        if index < len(parts):
            held, wanted = parts[index].driven(problem, int(moving[index]))
            angles.append(held)
            twists.append(wanted)
    return inverse.inputs(np.vstack(twists), np.vstack(angles))


@dataclass(frozen=True)
class _Part:
    """What a car drives between two stops.

    Attributes:
        profile: of its progress.
        before, after: steering angles (steers,) [rad] that it begins and ends with.
        wanted: the whole twist (rows,), where it is one move.
        roll: the arcs, where there are several.
        changing: time [s] that a change of steering between these takes.
    """

    profile: Trapezoid
    before: Array
    after: Array
    wanted: Array
    roll: Roll | None = None
    changing: float = 0.0

    def driven(self, problem: Problem, periods: int) -> tuple[Array, Array]:
        """Steering angles (periods, steers) and twists (periods, rows), held period by period."""
        shares = self.profile.progress(np.linspace(0.0, self.profile.duration, periods + 1))
        period = problem.design.period
        if self.roll is None:
            rates = np.diff(shares) / period
            return np.tile(self.before, (periods, 1)), rates[:, None] * self.wanted
        steered = steering(problem)
        assert steered is not None
        top = np.diff(shares).max() * self.roll.length / period
        lengths, turns = self.roll.steps(shares, top * self.changing)
        angles = steered.angles_of(self.roll.way * turns / lengths)
        return angles[:, None], np.column_stack([self.roll.way * lengths, turns]) / period


def _parts(problem: Problem, moves: Sequence[Move], rolls: bool) -> list[_Part]:
    inverse = kinematics(problem.model)
    directions, _ = inverse.directions(moves, problem.input_bounds)
    profiles, wanted = _profiles(problem, moves, directions), inverse.wanted(moves)
    held, found, first = directions[:, inverse.steers], list[_Part](), 0
    for one in stretches(problem, moves) if rolls else [(move,) for move in moves]:
        last = first + len(one) - 1
        profile, roll, changing = profiles[first], None, 0.0
        if len(one) > 1:
            roll = Roll.of(one)
            profile, changing = _rolling(problem, roll, profiles[first : last + 1])
        found.append(_Part(profile, held[first], held[last], wanted[first], roll, changing))
        first = last + 1
    return found


def _rolling(problem: Problem, roll: Roll, profiles: Sequence[Trapezoid]) -> tuple[Trapezoid, float]:
    # The progress along arcs as fast as the slowest of them allows, and the time that a change of steering
    # takes: no longer than the shortest arc.
    steered, inverse = steering(problem), kinematics(problem.model)
    assert steered is not None
    rate = float(np.abs(problem.rate_bounds[inverse.steers]).min())
    changing = steered.seconds(roll.curvatures, rate) if math.isfinite(rate) else STEERING_TIME
    shares = roll.lengths / roll.length
    speed = min(profile.speed * share for profile, share in zip(profiles, shares, strict=True))
    speed = min(speed, float(shares.min()) / changing) if changing > 0 else speed
    rate = min(profile.rate * share for profile, share in zip(profiles, shares, strict=True))
    return Trapezoid.within(speed, rate), changing


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


def _changes(problem: Problem, parts: Sequence[_Part]) -> list[_Change]:
    # Before, between and after the parts of a drive.
    space, steers = problem.design, kinematics(problem.model).steers
    rest = np.zeros(len(steers))
    begin, end = (rest, rest) if space.rest_to_rest else (parts[0].before, parts[-1].after)
    befores = [begin, *(part.after for part in parts)]
    afters = [*(part.before for part in parts), end]
    bounds, changes = problem.rate_bounds[steers], []
    for index, (before, after) in enumerate(zip(befores, afters, strict=True)):
        first, last = index == 0, index == len(parts)
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


def _periods(problem: Problem, parts: Sequence[_Part], changes: Sequence[_Change]) -> tuple[Places, Places]:
    # Periods of every part and every change, the whole run together; changes wait only where all must hurry.
    space = problem.design
    durations = np.array([part.profile.duration for part in parts])
    moving = _moving(problem, parts)
    standing = np.array([change.fastest for change in changes])
    spare = space.samples - int(moving.sum() + standing.sum())
    if spare >= 0:
        return moving + _shared(spare, durations), standing
    least = np.array([1] * len(parts) + [change.least for change in changes])
    wanted = np.concatenate([moving, standing])
    counts = least + _shared(space.samples - int(least.sum()), (wanted - least).astype(float))
    return counts[: len(parts)], counts[len(parts) :]


def _shared(total: int, weights: Array) -> Places:
    # Whole numbers in proportion to `weights` whose sum is `total`.
    exact = total * weights / weights.sum()
    shares: Places = np.floor(exact).astype(np.int64)
    largest = np.argsort(shares - exact, kind="stable")[: total - int(shares.sum())]
    shares[largest] += 1
    return shares


@dataclass(frozen=True)
class Trapezoid:
    """Progress 0 to 1 with constant acceleration, constant speed, constant deceleration; times in s.

    Attributes:
        speed, rate: the largest speed [1/s] and acceleration [1/s^2] allowed.
        duration, ramp: of the whole, and of its acceleration.
    """

    speed: float
    rate: float
    duration: float
    ramp: float

    @classmethod
    def within(cls, speed: float, rate: float) -> Trapezoid:
        """The fastest progress within a speed and an acceleration, which may be infinite."""
        if not math.isfinite(rate):
            return cls(speed, rate, 1.0 / speed, 0.0)
        if speed * speed / rate >= 1.0:
            ramp = 1.0 / math.sqrt(rate)
            return cls(speed, rate, 2 * ramp, ramp)
        ramp = speed / rate
        return cls(speed, rate, ramp + 1.0 / speed, ramp)

    @classmethod
    def fastest(cls, problem: Problem, direction: Array, move: Move) -> Trapezoid:
        """The fastest progress along a move that the limits of speed and acceleration allow.

        Args:
            problem: with the limits.
            direction: inputs (inputs,) that make the move in one second.
            move: what is driven.
        """
        drives = kinematics(problem.model).drives
        speeds, rates, values = problem.input_bounds[drives], problem.rate_bounds[drives], direction[drives]
        speed = min(most(value, low, high) for value, (low, high) in zip(values, speeds, strict=True))
        rate = min(
            min(most(value, low, high), most(-value, low, high))
            for value, (low, high) in zip(values, rates, strict=True)
        )
        return cls.within(min(speed, _body_speed(problem, move)), rate)

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


def _body_speed(problem: Problem, move: Move) -> float:
    # Moves in a second at most, by the limits of the body's speeds.
    twist, speed = (move.forward, move.sideways, move.turn), math.inf
    for limit in problem.limits:
        bounds = limit.motion_bounds() if isinstance(limit, MotionLimit) else {}
        speed = min([speed, *(most(twist[place], low, high) for place, (low, high) in bounds.items())])
        across = math.hypot(move.forward, move.sideways) * abs(move.turn)
        if isinstance(limit, LateralAcceleration) and across > 0:
            speed = min(speed, math.sqrt(limit.bounds / across))
    return speed


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
