"""Where a pattern is driven: from the start as it is, or from where the room lets it be largest."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from oed.foundation.arrays import Array
from oed.kernel.problem import Problem
from oed.robots.baselines.kinematics import kinematics
from oed.robots.baselines.patterns import Move, Pattern
from oed.robots.limits.workspace import Area, Rectangle, workspace_of
from oed.robots.models.model import robot_of

Pose = tuple[float, float, float]

HEADINGS = 8
"""Directions tried for a pattern; and those of the room's diagonals."""
GRID = 5
"""Places tried along each side of a room that is no plain rectangle."""
HALVINGS = 12
"""Of the largest size of a pattern in a room: to a four-thousandth."""
STEPS = 12
"""Points that stand for a move that is not in place."""
SAME = 1e-9
"""Distance [m] and angle [rad] below which two poses are one."""
ALIKE = 1.02
"""Ratio of sizes below which the simpler of two placements is preferred."""


@dataclass(frozen=True)
class Placement:
    """How a pattern lies in the room.

    Attributes:
        pattern: its moves by size [m] and lap.
        largest: size [m] beyond which it does not fit the room here.
        heading: of the pattern [rad].
        centre: of its bounding box [m]; None where it begins at the study's start, as that is.
        mirrored: whether left and right are exchanged.
        reversed: whether it is driven backwards.
    """

    pattern: Pattern
    largest: float
    heading: float
    centre: tuple[float, float] | None = None
    mirrored: bool = False
    reversed: bool = False

    def lap(self, size: float, lap: int) -> list[Move]:
        """The moves of one lap, turned round as asked."""
        sign, way = (-1 if self.mirrored else 1), (-1 if self.reversed else 1)
        return [
            Move(way * one.forward, way * sign * one.turn, way * sign * one.sideways)
            for one in self.pattern(size, lap)
        ]

    def laps(self, size: float, laps: int) -> list[Move]:
        """The moves of so many laps; those that continue one another are one."""
        return joined([move for lap in range(laps) for move in self.lap(size, lap)])

    def pose(self, size: float) -> Pose | None:
        """Where a pattern of that size [m] begins; None for the study's start."""
        if self.centre is None:
            return None
        box = _box(traced([*self.lap(size, 0), *self.lap(size, 1)], (0.0, 0.0, self.heading)))
        return (
            self.centre[0] - (box[0] + box[1]) / 2,
            self.centre[1] - (box[2] + box[3]) / 2,
            self.heading,
        )

    @property
    def opposite(self) -> Placement:
        """To the right what was to the left; what does not turn, from its other end where that is free."""
        moves = [*self.lap(1.0, 0), *self.lap(1.0, 1)]
        if any(one.turn or one.sideways for one in moves):
            return replace(self, mirrored=not self.mirrored)
        return self if self.centre is None else replace(self, heading=self.heading + math.pi)


def joined(moves: Sequence[Move]) -> list[Move]:
    """Moves without the stops between those of the same direction and curvature."""
    found: list[Move] = []
    for move in moves:
        if found and _continues(found[-1], move):
            last = found.pop()
            move = Move(last.forward + move.forward, last.turn + move.turn, last.sideways + move.sideways)
        found.append(move)
    return found


def _continues(first: Move, second: Move) -> bool:
    one, two = ((move.forward, move.turn, move.sideways) for move in (first, second))
    lengths = math.hypot(*one) * math.hypot(*two)
    return lengths > 0 and sum(a * b for a, b in zip(one, two, strict=True)) > (1 - 1e-12) * lengths


def traced(moves: Sequence[Move], start: Pose) -> Array:
    """Points (G, 2) [m] that a robot's origin passes, on exact arcs."""
    steps = [1 if one.in_place else STEPS for one in moves]
    whole = np.array([[one.forward, one.sideways, one.turn] for one in moves])
    forward, sideways, turn = np.repeat(whole / np.array(steps)[:, None], steps, axis=0).T
    after = start[2] + np.cumsum(turn)
    middle = after - turn / 2
    # The chord of an arc is shorter than the arc.
    shorter = np.sinc(turn / math.tau)
    chords = shorter * (forward + 1j * sideways) * np.exp(1j * middle)
    path = complex(start[0], start[1]) + np.concatenate([[0], np.cumsum(chords)])
    return np.column_stack([path.real, path.imag])


def approach(start: Pose, goal: Pose) -> list[Move]:
    """From one pose to another: turn to face it, drive there, turn to its heading."""
    ahead = complex(goal[0] - start[0], goal[1] - start[1])
    # Where there is no way, the rounding of its direction is none to turn to.
    distance = abs(ahead)
    facing = goal[2] if distance <= SAME else math.atan2(ahead.imag, ahead.real)
    turns = [math.remainder(angle, math.tau) for angle in (facing - start[2], goal[2] - facing)]
    moves = [Move(0.0, turns[0]), Move(distance, 0.0), Move(0.0, turns[1])]
    return [one for one in moves if abs(one.forward) > SAME or abs(one.turn) > SAME]


def placements(problem: Problem, pattern: Pattern, most: float) -> list[Placement]:
    """The largest placement from the study's start as it is, and the largest anywhere in the room where that
    is larger: of a free start, or one that the robot can leave by turning in place.

    Args:
        problem: with the start and the room.
        pattern: to be placed.
        most: size [m] that no placement exceeds.
    """
    anchored = _anchored(problem, pattern, most)
    found = [anchored]
    if problem.fixed_starts is None or _can_leave(problem):
        found += [
            one for one in [_anywhere(problem, pattern, most)] if one.largest > ALIKE * anchored.largest
        ]
    return found if problem.fixed_starts is not None else found[-1:]


def _can_leave(problem: Problem) -> bool:
    starts = problem.fixed_starts
    # Runs that begin apart would each need a way of its own.
    if starts is None or len(np.unique(starts, axis=0)) > 1:
        return False
    bounds, inverse = problem.input_bounds, kinematics(problem.model)
    values, made = inverse.directions([Move(0.0, 1.0), Move(0.0, -1.0), Move(1.0, 0.0)], bounds)
    allowed = (values <= 0) | (bounds[:, 1] > 0), (values >= 0) | (bounds[:, 0] < 0)
    return bool(made.all() and all(one[:, inverse.drives].all() for one in allowed))


def _anchored(problem: Problem, pattern: Pattern, most: float) -> Placement:
    x, y, heading = start_of(problem)
    plain = Placement(pattern, most, heading)
    drives = problem.input_bounds[kinematics(problem.model).drives]
    ways = (False, True) if np.all(drives[:, 0] < 0) else (False,)
    best: Placement | None = None
    for mirrored, backwards in itertools.product((False, True), ways):
        one = replace(plain, mirrored=mirrored, reversed=backwards)
        one = replace(one, largest=_largest(problem, one, (x, y, heading), most))
        if best is None or one.largest > ALIKE * best.largest:
            best = one
    assert best is not None
    return best


def _anywhere(problem: Problem, pattern: Pattern, most: float) -> Placement:
    best: Placement | None = None
    for centre, heading in itertools.product(_centres(problem), _headings(problem)):
        one = Placement(pattern, most, heading, centre)
        # Only what is larger than the best so far is looked at closely.
        if best is not None and not _fits(problem, one, None, min(most, ALIKE * best.largest)):
            continue
        one = replace(one, largest=_largest(problem, one, None, most))
        if best is None or one.largest > ALIKE * best.largest:
            best = one
    assert best is not None
    return best


def start_of(problem: Problem) -> Pose:
    """The first run's start pose: where the study says, or in the middle of the room."""
    if problem.fixed_starts is not None:
        x, y, heading = problem.fixed_starts[0][:3]
        return float(x), float(y), float(heading)
    room = workspace_of(problem.limits)
    x, y = (0.0, 0.0) if room is None else room.middle
    return x, y, 0.0


def _centres(problem: Problem) -> Iterator[tuple[float, float]]:
    room = workspace_of(problem.limits)
    if room is None:
        yield start_of(problem)[:2]
        return
    yield room.middle
    areas = [one for one in problem.limits if isinstance(one, Area)]
    if len(areas) == 1 and isinstance(room, Rectangle):
        return
    x_min, x_max, y_min, y_max = room.extent
    shares = (np.arange(GRID) + 0.5) / GRID
    for across, along in itertools.product(shares, shares):
        yield x_min + across * (x_max - x_min), y_min + along * (y_max - y_min)


def _headings(problem: Problem) -> list[float]:
    plain = [math.tau * place / HEADINGS for place in range(HEADINGS)]
    room = workspace_of(problem.limits)
    if room is None:
        return [start_of(problem)[2]]
    x_min, x_max, y_min, y_max = room.extent
    diagonal = math.atan2(y_max - y_min, x_max - x_min)
    return [*plain, diagonal, -diagonal]


def _largest(problem: Problem, one: Placement, start: Pose | None, most: float) -> float:
    # Of the sizes whose path stays inside, the largest, to one in 2^HALVINGS of `most`.
    if _fits(problem, one, start, most):
        return most
    low, high = 0.0, most
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if _fits(problem, one, start, middle) else (low, middle)
    # A little more than what was found: the limits themselves decide.
    return high


def _fits(problem: Problem, one: Placement, start: Pose | None, size: float) -> bool:
    pose = start or one.pose(size)
    assert pose is not None
    path = traced([*one.lap(size, 0), *one.lap(size, 1)], pose)
    radius = robot_of(problem.system).body_radius
    return all(area.allow(path, radius) for area in problem.limits if isinstance(area, Area))


def _box(points: Array) -> tuple[float, float, float, float]:
    low, high = points.min(axis=0), points.max(axis=0)
    return float(low[0]), float(high[0]), float(low[1]), float(high[1])
