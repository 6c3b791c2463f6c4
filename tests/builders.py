"""One valid problem, and drives for it, to be varied in tests."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from oed.kernel.criteria import E
from oed.kernel.dynamics.space import Spline
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.problem import Problem
from oed.kernel.solution import Solution, scored
from oed.robots.baselines.fitting import largest
from oed.robots.baselines.paths import largest_size, placed
from oed.robots.baselines.patterns import PATTERNS
from oed.robots.baselines.placing import Placement, start_of
from oed.robots.limits import (
    CommandedSpeed,
    CommandedYawRate,
    Rectangle,
    SteeringAngle,
    Throttle,
    WheelAcceleration,
    WheelSpeed,
)
from oed.robots.models import DifferentialDrive
from oed.robots.sensors import Displacements
from oed.robots.space import DesignSpace
from oed.simulation.checks import Check, Tally, check_tally
from oed.uncertainty.uncertainty import Uncertainty

RADIUS, TRACK = 0.049, 0.18

SPEED = WheelSpeed(bounds=10)
STEERING = SteeringAngle(bounds=0.6)
LIMIT_OF = {
    "wheel_speed": SPEED,
    "steering_angle": STEERING,
    "commanded_speed": CommandedSpeed(bounds=0.5),
    "commanded_yaw_rate": CommandedYawRate(bounds=2.0),
    "throttle": Throttle(bounds=1.0),
}
"""What bounds inputs, by their quantity."""
ACCELERATION = WheelAcceleration(bounds=20)
BOX = Rectangle(x=(-1, 1), y=(-1, 1))


def problem_of(**parts: Any) -> Problem:
    """The paper's robot with small numbers (10 s, 40 samples, 4 segments), parts replaced at will; for parts
    that were lately asked for, the same problem, with all that it has written out since.

    Args:
        parts: of the problem; beside them those of its design space (`samples`, `runs`, `start`, ...), unless
            there is a `design`, and
            limits: may be a function of the robot.
            also: limits besides these.
            within: how far the robot may be from its parameters.
            period: of the samples [s], instead of the duration.
            coefficients: of each spline.
    """
    try:
        hash(tuple(parts.values()))
    except TypeError:
        return new_problem_of(**parts)
    return _known(**parts)


def new_problem_of(**parts: Any) -> Problem:
    """The same, made anew: for what is asked of two problems that are alike."""
    given: dict[str, Any] = {
        "model": DifferentialDrive(wheel_radius=RADIUS, track=TRACK),
        "measurement": Displacements(segments=4),
        "limits": (SPEED, ACCELERATION, BOX),
        "criterion": E(scaling="none"),
        **parts,
    }
    if callable(given["limits"]):
        given["limits"] = given["limits"](given["model"])
    given["limits"] = (*given["limits"], *given.pop("also", ()))
    if "within" in given:
        given["uncertainty"] = Uncertainty.model_validate(given.pop("within"))
    return Problem(**{"design": design_space(given), **given})


_known = lru_cache(maxsize=64, typed=True)(new_problem_of)


def forget_problems() -> None:
    """Let the next ones be made anew."""
    _known.cache_clear()


def design_space(given: dict[str, Any]) -> DesignSpace:
    """The design space of a problem's parts, whose keys are taken out of them."""
    own = {name: given.pop(name) for name in DesignSpace.model_fields if name in given}
    spline = Spline(coefficients=given.pop("coefficients", 8))
    space = {"duration": 10, "samples": 40, "spline": spline, **own}
    if "period" in given:
        space["duration"] = given.pop("period") * space["samples"]
    return DesignSpace(**space)


def input_limits(model) -> tuple:
    """Limits that bound a robot's inputs, and no more."""
    return tuple(LIMIT_OF[quantity] for quantity in dict.fromkeys(entry.quantity for entry in model.inputs))


def make_flagship(**overrides: Any) -> Problem:
    """The paper's robot at full size: 20 s, 200 samples, 10 segments, a 2 m box."""
    usual = {"design": DesignSpace(duration=20), "measurement": Displacements(segments=10)}
    return problem_of(**{**usual, **overrides})


def random_drive(problem: Problem, seed: int, amplitude: float = 8.0) -> Trajectory:
    """A drive of the problem's space with uniform random coefficients, at rest where rest is asked."""
    rng, space = np.random.default_rng(seed), problem.design
    coefficients = np.zeros((space.all_coefficients, len(problem.model.inputs)))
    shape = (len(space.free_rows), len(problem.model.inputs))
    coefficients[space.free_rows] = rng.uniform(-amplitude, amplitude, shape)
    start = problem.fixed_starts
    if start is None:
        start = problem.start_states(rng.uniform(-1, 1, (space.runs, 3)))
    return space.trajectory(coefficients, start)


def upper_bound(segments: int, radius: float = RADIUS, track: float = TRACK) -> float:
    """The largest lambda_min(W'W) of the position regressor with P segments: 2 P (B / r)^2."""
    return 2 * segments * (track / radius) ** 2


def check_all(errors: np.ndarray, covariance: np.ndarray, alpha: float) -> tuple[Check, ...]:
    """All tests of errors (R, p) against the covariance (p, p) that was predicted of them."""
    return check_tally(Tally.of(errors, covariance), alpha)


def driven_once(problem: Problem, name: str) -> Solution:
    """A baseline's pattern driven once from the study's start as it is, as large as the limits allow."""
    heading = start_of(problem)[2]
    shape = placed(problem, Placement(PATTERNS[name], largest_size(problem), heading))
    return scored(problem, shape.drive(largest(problem, shape), 1), name)
