"""The paths people drive today, made to fit a study: what a design is compared with.

A pattern is a list of moves (straights, arcs, spins), each driven from rest to rest. It is made as large
as the limits allow and stretched in time to the study's duration; a second variant has the path length of
a given design, as the paper's comparison has.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, get_args

import casadi as ca
import numpy as np
import numpy.typing as npt

from oed.errors import Flaw, ProblemError
from oed.evaluation import Evaluation, evaluate
from oed.limits.workspace import Workspace
from oed.models.model import Model
from oed.problem import Problem
from oed.solution import Solution, Status
from oed.trajectory import Trajectory

Array = npt.NDArray[np.float64]

BISECTIONS = 20
MOST_LAPS = 50
STREAM = 17
FULL_TURN = 2 * math.pi


@dataclass(frozen=True)
class Move:
    """One move from rest to rest at a constant ratio of turning to driving: distance [m], turn [rad]."""

    forward: float
    turn: float


Pattern = Callable[[float, int], list[Move]]
"""The moves of one lap: its size [m] and its number, from 0."""


def straight(size: float, lap: int) -> list[Move]:
    """There; on the next lap, back."""
    return [Move(-size if lap % 2 else size, 0.0)]


def circle(size: float, lap: int) -> list[Move]:
    """A full circle of diameter `size`, to the left."""
    return [Move(math.pi * size, FULL_TURN)]


def square(size: float, lap: int) -> list[Move]:
    """A square in both directions, spinning at the corners [Borenstein and Feng, UMBmark, 1995]."""
    left = [Move(size, 0.0), Move(0.0, FULL_TURN / 4)] * 4
    right = [Move(size, 0.0), Move(0.0, -FULL_TURN / 4)] * 4
    return left + right


def figure_eight(size: float, lap: int) -> list[Move]:
    """A circle to the left, then one to the right, of diameter `size` each."""
    return [Move(math.pi * size, FULL_TURN), Move(math.pi * size, -FULL_TURN)]


def straight_and_spin(size: float, lap: int) -> list[Move]:
    """There, a full turn on the spot, back, and the turn undone."""
    return [Move(size, 0.0), Move(0.0, FULL_TURN), Move(-size, 0.0), Move(0.0, -FULL_TURN)]


PATTERNS: dict[str, Pattern] = {
    "straight": straight,
    "circle": circle,
    "square": square,
    "figure_eight": figure_eight,
    "straight_and_spin": straight_and_spin,
}
BaselineName = Literal["straight", "circle", "square", "figure_eight", "straight_and_spin", "random"]
NAMES: tuple[str, ...] = get_args(BaselineName)
RANDOM = "random"


def baselines(problem: Problem, name: str, *, length: float | None = None, seed: int = 0) -> list[Solution]:
    """One everyday path as large as the limits allow, and where asked again with a given length, scored.

    Args:
        problem: whose limits, duration and start it is made for.
        name: one of `NAMES`.
        length: path length [m] of the second variant; None for none.
        seed: of the random path.

    Raises:
        ProblemError: an unknown name.
    """
    if name not in NAMES:
        text = f"expected one of {', '.join(NAMES)}, got {name!r}"
        raise ProblemError([Flaw(("baselines",), text)])
    shape = _random_shape(problem, seed) if name == RANDOM else _pattern_shape(problem, PATTERNS[name])
    largest = _largest(problem, shape)
    scored = [_scored(problem, name, largest, seed)]
    if length is not None:
        most = scored[0].evaluation.path_length if scored[0].evaluation else 0.0
        fitted = _of_length(problem, shape, length, most)
        scored.append(_scored(problem, f"{name}_same_length", fitted, seed))
    return scored


def _scored(problem: Problem, name: str, trajectory: Trajectory, seed: int) -> Solution:
    evaluation = evaluate(problem, trajectory)
    return Solution(
        name=name,
        kind="baseline",
        trajectory=trajectory,
        evaluation=evaluation,
        status=Status.SCORED,
        seed=seed,
        detail=_limits_exceeded(evaluation),
    )


def _limits_exceeded(evaluation: Evaluation) -> str:
    if evaluation.feasible:
        return ""
    return f"It cannot be driven here: it exceeds {', '.join(evaluation.violations)}."


@dataclass(frozen=True)
class _Shape:
    """A family of drives of one form: `drive(size, laps)`."""

    drive: Callable[[float, int], Trajectory]
    largest: float


def _pattern_shape(problem: Problem, pattern: Pattern) -> _Shape:
    def drive(size: float, laps: int) -> Trajectory:
        return _stretched(problem, [move for lap in range(laps) for move in pattern(size, lap)])

    extents = [limit.extent for limit in problem.limits if isinstance(limit, Workspace)]
    room = max(extents[0][1] - extents[0][0], extents[0][3] - extents[0][2]) if extents else math.inf
    reach = float(np.abs(problem.input_bounds).max()) * problem.design.duration
    return _Shape(drive, min(room, reach))


def _random_shape(problem: Problem, seed: int) -> _Shape:
    space = problem.design
    bounds, count = problem.input_bounds, space.all_coefficients
    rest = np.clip(0.0, bounds[:, 0], bounds[:, 1])
    draws = np.random.default_rng([seed, STREAM]).uniform(bounds[:, 0], bounds[:, 1], (count, len(bounds)))
    held = np.zeros(count, dtype=bool)
    held[space.free_rows] = True

    def drive(size: float, laps: int) -> Trajectory:
        table = rest + size * (draws - rest)
        return space.trajectory(np.where(held[:, None], table, 0.0), _starts(problem))

    return _Shape(drive, 1.0)


def _largest(problem: Problem, shape: _Shape) -> Trajectory:
    # The largest size that keeps every limit; where none does, the smallest, whose violations say why.
    low, high = 0.0, shape.largest
    if _kept(problem, shape.drive(high, 1)):
        return shape.drive(high, 1)
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        low, high = (middle, high) if _kept(problem, shape.drive(middle, 1)) else (low, middle)
    return shape.drive(low if low > 0 else shape.largest / 4, 1)


def _kept(problem: Problem, trajectory: Trajectory) -> bool:
    # Without the tolerance of `feasible`, which a bisection would use up.
    margins = evaluate(problem, trajectory).margins
    return all(margin.violation <= 1e-9 * margin.size for margin in margins)


def _of_length(problem: Problem, shape: _Shape, length: float, most: float) -> Trajectory:
    # As few laps as the largest size, of length `most`, needs; at the size that gives the length.
    laps = min(MOST_LAPS, max(1, math.ceil(length / most - 1e-6))) if most > 0 else 1
    low, high = 0.0, shape.largest
    while evaluate(problem, shape.drive(high, laps)).path_length < length and high < 1e3 * shape.largest:
        high *= 2
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        shorter = evaluate(problem, shape.drive(middle, laps)).path_length < length
        low, high = (middle, high) if shorter else (low, middle)
    return shape.drive((low + high) / 2, laps)


def _starts(problem: Problem) -> Array:
    # Where the study says, or in the middle of the room.
    if problem.fixed_starts is not None:
        return problem.fixed_starts
    extents = [limit.extent for limit in problem.limits if isinstance(limit, Workspace)]
    x_min, x_max, y_min, y_max = extents[0] if extents else (0.0, 0.0, 0.0, 0.0)
    middle = ((x_min + x_max) / 2, (y_min + y_max) / 2, 0.0)
    return problem.start_states([middle] * problem.design.runs)


def _stretched(problem: Problem, moves: Sequence[Move]) -> Trajectory:
    # Every move at the limits of speed and acceleration, then all slowed (or hurried) to the duration.
    space, model = problem.design, problem.model
    inverse = _inverse(model)
    directions = inverse(np.array([[move.forward, move.turn] for move in moves]))
    profiles = [_Trapezoid.fastest(problem, direction) for direction in directions]
    total = sum(profile.duration for profile in profiles)
    stretch = space.duration / total
    edges = np.linspace(0.0, space.duration, space.samples + 1) / stretch
    twists, began = np.zeros((space.samples, 2)), 0.0
    for move, profile in zip(moves, profiles, strict=True):
        # The mean rate of each period: held sample by sample, every move still goes its whole way.
        rates = np.diff(profile.progress(edges - began)) / space.period
        twists += rates[:, None] * np.array([move.forward, move.turn])
        began += profile.duration
    # Every run drives the same.
    return Trajectory.from_samples(
        np.tile(inverse(twists), (space.runs, 1)),
        space.whole_duration,
        _starts(problem),
        rest_to_rest=space.rest_to_rest,
        runs=space.runs,
    )


@dataclass(frozen=True)
class _Trapezoid:
    """Progress 0 to 1 with constant acceleration, constant speed, constant deceleration."""

    duration: float
    ramp: float

    @classmethod
    def fastest(cls, problem: Problem, direction: Array) -> _Trapezoid:
        """The fastest progress along inputs `direction` (inputs,) that speed and acceleration allow."""
        speeds = problem.input_bounds
        speed = min(_most(value, low, high) for value, (low, high) in zip(direction, speeds, strict=True))
        rates = _rate_bounds(problem)
        rate = min(
            min(_most(value, low, high), _most(-value, low, high))
            for value, (low, high) in zip(direction, rates, strict=True)
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


def _most(value: float, low: float, high: float) -> float:
    # The largest factor for which factor * value stays in [low, high]; a forbidden sign is as if allowed,
    # so that the drive exists and its evaluation names the limit.
    bound = (high if value > 0 else -low) or max(abs(low), abs(high))
    return math.inf if value == 0 else abs(bound / value)


def _rate_bounds(problem: Problem) -> Array:
    bounds = np.tile([-np.inf, np.inf], (len(problem.model.inputs), 1))
    for limit in problem.limits:
        for name, pair in limit.rate_bounds(problem.model).items():
            bounds[problem.model.input_names.index(name)] = pair
    return bounds


@lru_cache(maxsize=16)
def _inverse(model: Model) -> Callable[[Array], Array]:
    """The function (K, 2) forward speeds and yaw rates -> (K, inputs) that give them, by Newton's method."""
    inputs = ca.SX.sym("inputs", len(model.inputs))
    twist = model.twist(inputs, ca.DM(model.nominal))
    wanted = ca.SX.sym("wanted", 2)
    residual = ca.vertcat(twist[0], twist[2]) - wanted
    newton = inputs - ca.pinv(ca.jacobian(residual, inputs)) @ residual
    function = ca.Function("newton", [inputs, wanted], [newton])

    mapped = lru_cache(maxsize=64)(function.map)

    def invert(twists: Array) -> Array:
        values = np.zeros((len(model.inputs), len(twists)))
        step = mapped(len(twists))
        for _ in range(8):
            values = np.array(step(values, twists.T))
        return values.T

    return invert
