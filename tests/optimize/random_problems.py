"""Small random problems, cheap to solve: tight rooms, few samples, limits that stand in each other's way."""

from __future__ import annotations

from typing import Any

import numpy as np
from builders import RADIUS, TRACK, problem_of

from oed.kernel.criteria import A, D, E
from oed.kernel.dynamics.space import Spline
from oed.kernel.problem import Problem
from oed.robots.limits import (
    BodySpeed,
    Circle,
    CircularObstacle,
    EndHeading,
    EndPosition,
    LateralAcceleration,
    Obstacles,
    PathLength,
    Polygon,
    Rectangle,
    TurningRadius,
    WheelAcceleration,
    WheelJerk,
    WheelSpeed,
    YawRate,
)
from oed.robots.models import DifferentialDrive, SkidSteer
from oed.robots.sensors import Displacements, Poses
from oed.robots.sensors.poses import AbsoluteNoise
from oed.robots.space import DesignSpace

NOISE = {"position": 0.01, "heading": 0.02}


def random_problem(seed: int) -> Problem:
    """The problem of a seed."""
    rng = np.random.default_rng(seed)
    size = float(10 ** rng.uniform(-1, 1))
    return problem_of(
        model=_robot(rng),
        design=_space(rng),
        measurement=_measurement(rng),
        limits=(*_input_limits(rng), _room(rng, size), *_others(rng, size)),
        criterion=(E, D, A)[int(rng.choice(3, p=[0.6, 0.2, 0.2]))](),
    )


def _robot(rng: np.random.Generator) -> Any:
    sizes = {"wheel_radius": RADIUS, "track": TRACK, "body_radius": float(rng.choice([0.0, 0.02]))}
    if rng.random() < 0.2:
        return SkidSteer(**sizes, slip_outer=0.1, slip_inner=-0.05)
    return DifferentialDrive(**sizes)


def _space(rng: np.random.Generator) -> DesignSpace:
    degree = int(rng.choice([2, 3]))
    coefficients = int(rng.integers(degree + 4, 12))
    return DesignSpace(
        duration=float(rng.choice([3.0, 8.0, 20.0])),
        samples=int(rng.choice([8, 12, 24, 40])),
        spline=Spline(degree=degree, coefficients=coefficients),
        rest_to_rest=bool(rng.random() < 0.7),
    )


def _measurement(rng: np.random.Generator) -> Any:
    if rng.random() < 0.3:
        return Poses(noise=AbsoluteNoise(**NOISE))
    regressor = str(rng.choice(["position", "heading", "both"], p=[0.6, 0.2, 0.2]))
    return Displacements(segments=int(rng.choice([2, 4])), regressor=regressor, noise=NOISE)


def _input_limits(rng: np.random.Generator) -> list[Any]:
    speed = float(10 ** rng.uniform(0, 1.5))
    found: list[Any] = [WheelSpeed(bounds=speed)]
    if rng.random() < 0.7:
        found.append(WheelAcceleration(bounds=speed * float(10 ** rng.uniform(-0.5, 1))))
    if rng.random() < 0.3:
        found.append(WheelJerk(bounds=speed * float(10 ** rng.uniform(0, 2))))
    return found


def _room(rng: np.random.Generator, size: float) -> Any:
    kind = int(rng.integers(4))
    if kind == 0:
        return Circle(radius=size)
    if kind == 1:
        # An L around the start.
        corners = ((-1, -1), (1, -1), (1, 0.3), (0.3, 0.3), (0.3, 1), (-1, 1))
        return Polygon(points=tuple((size * x, size * y) for x, y in corners))
    x, y = size * rng.uniform(0.3, 1, 2)
    return Rectangle(x=(-x, x), y=(-y, y))


def _others(rng: np.random.Generator, size: float) -> list[Any]:
    angle = rng.uniform(0, 2 * np.pi)
    post = CircularObstacle(x=0.5 * size * np.cos(angle), y=0.5 * size * np.sin(angle), radius=0.1 * size)
    choices: list[Any] = [
        BodySpeed(bounds=float(10 ** rng.uniform(-1, 0))),
        YawRate(bounds=float(10 ** rng.uniform(-0.5, 1))),
        LateralAcceleration(bounds=float(10 ** rng.uniform(-1.5, 0))),
        PathLength(bounds=size * float(10 ** rng.uniform(-0.5, 1))),
        EndPosition(at="start", tolerance=0.05 * size),
        EndHeading(at=float(rng.choice([0.0, np.pi])), tolerance=0.05),
        TurningRadius(bounds=0.2 * size),
        Obstacles(shapes=(post,)),
    ]
    chances = rng.random(len(choices))
    return [one for one, chance in zip(choices, chances, strict=True) if chance < 0.2]
