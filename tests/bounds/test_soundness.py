"""No feasible drive scores above a certificate, whatever the robot, the limits and the measurement."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from builders import RADIUS, TRACK, problem_of
from drives import best_objective

from oed.bounds import bound
from oed.kernel.criteria import E
from oed.kernel.measurement.prior import Prior
from oed.kernel.problem import Problem
from oed.robots.limits import Circle as CircularRoom
from oed.robots.limits import Polygon, Rectangle, WheelAcceleration, WheelSpeed
from oed.robots.models import DifferentialDrive, OffsetDrive, SkidSteer, SkidSteerIcr, TractorTrailer
from oed.robots.sensors import Displacements, Poses, Ranges, YawRate
from oed.robots.sensors.displacements import PoseNoise
from oed.robots.sensors.mounting import LeverArm
from oed.robots.sensors.poses import AbsoluteNoise
from oed.robots.sensors.prior import PosePrior
from oed.robots.sensors.several import Several
from oed.robots.space import DesignSpace, StartPose

SPEEDS = [10, 3, (0, 10), (-3, 8), (-8, 3), (-1, 12)]
ACCELERATIONS = [20, 7.3, 3, (-30, 10)]
COEFFICIENTS = ("c11", "c12", "c21", "c22")
LENGTHS = ("wheel_radius_right", "wheel_radius_left", "track")


def draw(rng: np.random.Generator, options: list[Any]) -> Any:
    return options[int(rng.integers(len(options)))]


def random_robot(rng: np.random.Generator) -> Any:
    radii = draw(rng, [{"wheel_radius": RADIUS}, {"wheel_radius_right": 0.08, "wheel_radius_left": 0.03}])
    # Slips of both sides away from 0, so that inputs act with less or more than themselves.
    slips = draw(rng, [(0.1, 0.2), (0.3, -0.2), (0.05, 0.05)])
    if rng.random() < 0.3:
        return SkidSteer(**radii, track=TRACK, slip_outer=slips[0], slip_inner=slips[1])
    return DifferentialDrive(**radii, track=draw(rng, [TRACK, 0.5]))


def random_space(rng: np.random.Generator, samples: int) -> tuple[DesignSpace, tuple[Any, ...]]:
    x, y = draw(rng, [((-1, 1), (-1, 1)), ((-0.2, 0.3), (-0.1, 0.4)), ((-3, 1), (0, 2)), ((-9, 9), (-9, 9))])
    space = DesignSpace(
        duration=draw(rng, [2.0, 5.0, 10.0]),
        samples=samples,
        start=draw(rng, ["free", StartPose(), StartPose(x=x[0], y=y[1], heading=-0.7)]),
        rest_to_rest=bool(rng.random() < 0.6),
        integration=draw(rng, ["arc", "arc", "midpoint"]),
    )
    limits: tuple[Any, ...] = (WheelSpeed(bounds=draw(rng, SPEEDS)),)
    if rng.random() < 0.8:
        limits += (WheelAcceleration(bounds=draw(rng, ACCELERATIONS)),)
    return space, (*limits, Rectangle(x=x, y=y)) if rng.random() < 0.8 else limits


def random_regression(rng: np.random.Generator) -> Problem:
    samples = int(rng.integers(8, 40))
    space, limits = random_space(rng, samples)
    regressor = draw(rng, ["position", "heading", "both"])
    scaling = draw(rng, ["none", "relative", {"c11": 0.1, "c12": 0.3, "c21": 0.01, "c22": 0.02}])
    needed = scaling != "none" or rng.random() < 0.5
    noise = PoseNoise(position=0.02, heading=0.05) if needed else PoseNoise()
    names = {"position": COEFFICIENTS[2:], "heading": COEFFICIENTS[:2], "both": COEFFICIENTS}[regressor]
    if isinstance(scaling, dict):
        scaling = {name: scaling[name] for name in names}
    prior = None
    if scaling != "none" and noise.position and rng.random() < 0.3:
        prior = Prior(standard_deviations={names[0]: "20 %"})
    return problem_of(
        model=random_robot(rng),
        design=space,
        limits=limits,
        measurement=Displacements(segments=draw(rng, ["samples", 2, 4, 7]), regressor=regressor, noise=noise),
        criterion=E(scaling=scaling),
        prior=prior,
    )


def random_sensor(rng: np.random.Generator, initial_pose: Any) -> Any:
    every = draw(rng, [1, 1, 2, 5])
    arm = draw(rng, [LeverArm(), LeverArm(x=0.2, y=-0.1), LeverArm(x=0.1, known=False)])
    if rng.random() < 0.25:
        beacons = ((2.0, 0.0), (-1.0, 3.0), (-2.0, -2.0))[: int(rng.integers(1, 4))]
        return Ranges(beacons=beacons, noise=0.05, every=every, initial_pose=initial_pose, lever_arm=arm)
    covariance = ((4e-4, 1e-4, 1e-4), (1e-4, 1e-4, 0.0), (1e-4, 0.0, 1e-3))
    noise = draw(
        rng,
        [
            AbsoluteNoise(position=0.01, heading=0.02),
            AbsoluteNoise(x=0.01, y=0.03, heading=0.1),
            AbsoluteNoise(position=0.01, heading=0.02, position_per_speed=0.05),
            AbsoluteNoise(covariance=covariance),
        ],
    )
    quantities = ("x", "y", "heading")
    if noise.covariance is None and rng.random() < 0.3:
        quantities = draw(rng, [("x", "y"), ("x",)])
    return Poses(quantities=quantities, noise=noise, every=every, initial_pose=initial_pose, lever_arm=arm)


def random_joint(rng: np.random.Generator) -> Problem:
    samples = int(rng.integers(8, 28))
    space, limits = random_space(rng, samples)
    pose = draw(rng, ["unknown", "unknown", "known", PosePrior(position=0.02, heading=0.05)])
    measurement = random_sensor(rng, pose)
    if rng.random() < 0.35:
        second = YawRate(noise=0.05) if rng.random() < 0.5 else random_sensor(rng, pose)
        measurement = Several(sensors=(measurement, second))
    # Slips and radii cannot be told apart, so only the lengths are asked for.
    names = draw(rng, [COEFFICIENTS, LENGTHS, COEFFICIENTS[2:]])
    scaling = draw(rng, ["none", "relative", {name: 0.01 + 0.1 * rng.random() for name in names}])
    subset = names[1:] if not isinstance(scaling, dict) and rng.random() < 0.2 else None
    return problem_of(
        model=random_robot(rng),
        design=space,
        limits=limits,
        measurement=measurement,
        criterion=E(scaling=scaling, subset=subset),
        estimate=names,
        prior=Prior(standard_deviations={names[0]: "20 %"}) if rng.random() < 0.2 else None,
    )


def check(problem: Problem, rng: np.random.Generator, drives: int, climbs: int) -> int:
    """Hold the bound of a problem against drives; how many were feasible."""
    certificate = bound(problem, nodes=6)
    best, tried = best_objective(problem, rng, drives, climbs)
    for one in certificate.bounds:
        assert best <= one.value, (one.method, best / one.value - 1, problem)
    assert best <= certificate.upper_bound
    return tried


# Of forty problems some whose bounds are less than twice what drives reach.
@pytest.mark.parametrize("seed", [4, 10, 16, 36])
@pytest.mark.slow
def test_no_drive_beats_the_bound_of_a_regression(seed: int) -> None:
    rng = np.random.default_rng(seed)
    assert check(random_regression(rng), rng, 18, 12) > 20


# And one by positions within top speed, which few drives come near.
@pytest.mark.parametrize("seed", [6, 8, 16, 35])
@pytest.mark.slow
def test_no_drive_beats_the_bound_of_sensors(seed: int) -> None:
    rng = np.random.default_rng(1000 + seed)
    assert check(random_joint(rng), rng, 18, 12) > 20


BODY = {"body_radius": 0.15, "wheel_radius": RADIUS}
OTHERS = {
    "offset": OffsetDrive(**BODY, track=TRACK, sensor_offset=0.06),
    "icr": SkidSteerIcr(**BODY, y_icr_left=0.2, y_icr_right=-0.15, x_icr=-0.03, alpha_left=0.9),
    "trailer": TractorTrailer(**BODY, track=TRACK, hitch_offset=0.1, trailer_length=0.3),
    "body": DifferentialDrive(**BODY, track=TRACK),
}
ROOMS = {
    "circle": CircularRoom(radius=0.9),
    "polygon": Polygon(points=((-1, -1), (1, -1), (1, 0.5), (0.3, 0.5), (0.3, 1), (-1, 1))),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("measured", "robot", "room"),
    [
        *(("segments", robot, "circle") for robot in ("offset", "icr")),
        *(("samples", robot, "circle") for robot in ("trailer", "icr")),
        # Where positions are read, the room is the bound; of other robots there is none then.
        *(("poses", "body", room) for room in ROOMS),
        ("poses", "offset", "polygon"),
    ],
)
def test_other_robots_and_rooms(robot: str, room: str, measured: str) -> None:
    # Lengths of the robots whose lengths scale the whole path; coefficients of the others.
    model = OTHERS[robot]
    poses = Poses(noise=AbsoluteNoise(position=0.01, heading=0.02))
    segments = {"segments": 4, "samples": "samples"}.get(measured, 1)
    estimate = None
    if measured == "poses":
        estimate = LENGTHS if robot in ("trailer", "body") else tuple(sum(model.coefficient_names, ()))
    problem = problem_of(
        model=model,
        design=DesignSpace(duration=5, samples=24, rest_to_rest=False),
        limits=(WheelSpeed(bounds=10), WheelAcceleration(bounds=20), ROOMS[room]),
        measurement=poses if measured == "poses" else Displacements(segments=segments),
        estimate=estimate,
    )
    assert check(problem, np.random.default_rng(1), 15, 10) > 10


@pytest.mark.parametrize("slips", [(0.0, 0.9), (0.9, 0.0)], ids=["inner", "outer"])
@pytest.mark.slow
def test_slip_of_one_side_alone_keeps_the_bound(slips: tuple[float, float]) -> None:
    """Slip passes from side to side faster than a wheel can change its speed."""
    problem = problem_of(
        model=SkidSteer(wheel_radius=RADIUS, track=TRACK, slip_outer=slips[0], slip_inner=slips[1]),
        design=DesignSpace(duration=2, samples=20),
        measurement=Displacements(segments="samples"),
        limits=(WheelSpeed(bounds=(0, 10)), WheelAcceleration(bounds=20)),
    )
    check(problem, np.random.default_rng(0), 20, 150)
