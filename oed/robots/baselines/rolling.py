"""Arcs that a car drives without a stop: it steers from each to the next while it rolls."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np

from oed.foundation.arrays import Array
from oed.kernel.problem import Problem
from oed.robots.baselines.kinematics import kinematics
from oed.robots.baselines.patterns import Move, Pattern
from oed.robots.limits.body_motion import TurningRadius

ANGLES = 2001
"""Steering angles of which the curvature is known; between them it is interpolated."""
TIGHTER = 1.001
"""Ratio of the radius of the tightest arcs driven to the smallest allowed: rounding must not exceed it."""
WIDEST = 64.0
"""Size of a pattern in radii of its tightest arc at most."""
HALVINGS = 40
"""Of the smallest size of a pattern: to rounding."""
KNOWN = 1e-4
"""Error of a curvature [1/m] at most that the robot's steering has to make."""


@dataclass(frozen=True)
class Steering:
    """A single steered wheel's angles [rad] and the curvatures [1/m] that they make, both increasing."""

    angles: Array
    curvatures: Array

    @property
    def tightest(self) -> float:
        """The radius [m] of the tightest arc that can be driven to either side."""
        least = min(-self.curvatures[0], self.curvatures[-1])
        return TIGHTER / float(least) if least > 0 else math.inf

    def makes(self, moves: Sequence[Move]) -> bool:
        """Whether angles within the limits make moves that all are arcs or straights."""
        low, high = self.curvatures[[0, -1]]
        return all(low - KNOWN < move.turn / move.forward < high + KNOWN for move in moves)

    def angles_of(self, curvatures: Array) -> Array:
        """The steering angles [rad] that make curvatures [1/m]."""
        return np.interp(curvatures, self.curvatures, self.angles)

    def seconds(self, curvatures: Array, rate: float) -> float:
        """The longest time [s] of the changes between consecutive curvatures [1/m], each linear in the
        distance, at a steering `rate` [rad/s] at most.
        """
        slopes = np.diff(self.angles) / np.diff(self.curvatures)
        longest = 0.0
        for one, other in pairwise(curvatures):
            low, high = min(one, other), max(one, other)
            passed = slopes[(self.curvatures[1:] >= low) & (self.curvatures[:-1] <= high)]
            longest = max(longest, (high - low) * float(passed.max(initial=0.0)) / rate)
        return longest


@lru_cache(maxsize=16)
def steering(problem: Problem) -> Steering | None:
    """How a robot of one driven and one steered wheel steers within its limits; None for others."""
    inverse = kinematics(problem.model)
    if len(inverse.steers) != 1 or len(inverse.drives) != 1 or len(inverse.rows) != 2:
        return None
    (low, high), reach = problem.input_bounds[inverse.steers[0]], inverse.reach[0]
    angles = np.linspace(max(low, -reach), min(high, reach), ANGLES)
    forward, turn = inverse.twists(np.ones(ANGLES), angles).T
    ahead = forward > KNOWN * np.abs(forward).max()
    # The stretch around the angle that turns least: beyond it a wheel across drives the other way.
    least = int(np.argmin(np.where(ahead, np.abs(turn), np.inf)))
    first = least - int(np.argmin(np.append(ahead[: least + 1][::-1], False))) + 1
    last = least + int(np.argmin(np.append(ahead[least:], False)))
    curvatures = turn[first:last] / forward[first:last]
    if not (np.diff(curvatures) > 0).all() or len(curvatures) < 2:
        return None
    return Steering(angles[first:last], curvatures)


@lru_cache(maxsize=16)
def tightest(problem: Problem) -> float:
    """The radius [m] of the tightest arcs that a robot's steering and its limit of turning allow; 0 where
    nothing bounds them.
    """
    limits = [one.bounds for one in problem.limits if isinstance(one, TurningRadius)]
    steered = steering(problem)
    own = 0.0 if steered is None or math.isinf(steered.tightest) else steered.tightest
    return max([own, *(TIGHTER * float(one) for one in limits)])


def smallest_size(problem: Problem, pattern: Pattern) -> float:
    """The size [m] below which a pattern has arcs that the robot cannot turn tightly enough for.

    Args:
        problem: with the robot's limits of turning.
        pattern: whose arcs are no wider in a smaller size.
    """
    radius, low, high = tightest(problem), 0.0, WIDEST * tightest(problem)
    for _ in range(HALVINGS if radius > 0 else 0):
        middle = (low + high) / 2
        arcs = [abs(move.forward / move.turn) for move in pattern(middle, 0) if move.forward and move.turn]
        low, high = (low, middle) if min(arcs, default=radius) >= radius else (middle, high)
    return high


@dataclass(frozen=True)
class Roll:
    """Moves forward, or all backward, along one another's ends, between two stops.

    Attributes:
        lengths: of the arcs [m].
        curvatures: of the arcs [1/m], to the left of the robot positive.
        way: 1 forward, -1 backward.
    """

    lengths: Array
    curvatures: Array
    way: float

    @classmethod
    def of(cls, moves: Sequence[Move]) -> Roll:
        """The moves as arcs."""
        forward = np.array([move.forward for move in moves])
        turns = np.array([move.turn for move in moves])
        return cls(np.abs(forward), turns / forward, math.copysign(1.0, forward[0]))

    @property
    def length(self) -> float:
        """Of the whole [m]."""
        return float(self.lengths.sum())

    def steps(self, shares: Array, changed: float) -> tuple[Array, Array]:
        """How far the robot rolls [m] and turns [rad] between `shares` (K + 1,) of the way, (K,) each.

        Args:
            shares: of the way, from 0 to 1.
            changed: distance [m] along which the steering changes between two arcs, half before and half
                after their ends meet.
        """
        ends = np.concatenate([[0.0], np.cumsum(self.lengths)])
        places = shares * ends[-1]
        # The curvature is averaged over the distance of a change: the turns of all arcs stay what they are.
        half = max(min(changed, float(self.lengths.min())), 1e-9 * self.length) / 2
        headings = (self._integral(ends, places + half) - self._integral(ends, places - half)) / (2 * half)
        return np.diff(places), np.diff(headings)

    def _integral(self, ends: Array, places: Array) -> Array:
        # Of the heading over the distance; the outer arcs go on beyond their ends.
        turned = self.way * self.curvatures
        headings = np.concatenate([[0.0], np.cumsum(self.lengths * turned)])
        areas = np.concatenate([[0.0], np.cumsum((headings[1:] + headings[:-1]) / 2 * self.lengths)])
        index = np.clip(np.searchsorted(ends, places) - 1, 0, len(self.lengths) - 1)
        beyond = places - ends[index]
        return np.asarray(areas[index] + beyond * (headings[index] + beyond * turned[index] / 2))


def stretches(problem: Problem, moves: Sequence[Move]) -> list[tuple[Move, ...]]:
    """The moves between one stop and the next: one by one for a robot that cannot steer while it rolls."""
    steered, found = steering(problem), [moves[:1]]
    for last, move in pairwise(moves):
        rolls = steered is not None and last.forward * move.forward > 0 and steered.makes((last, move))
        found = [*found[:-1], (*found[-1], move)] if rolls else [*found, (move,)]
    return [tuple(one) for one in found]
