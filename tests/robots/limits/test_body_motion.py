"""Limits on the motion: of body, wheels and trailer, against the example robots' own twists."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import oracle
import pytest
from builders import problem_of, random_drive
from driving import BY_NAME, FINER, as_drive, fine_path, fine_times, fine_twists, limited, margin_of, slack
from pydantic import TypeAdapter, ValidationError
from sample_robots import CORE, ROBOTS, Example, draw_inputs

from oed.kernel.dynamics.rollout import Drive
from oed.kernel.dynamics.space import Spline
from oed.kernel.dynamics.trajectory import Trajectory, bounding_values, middles
from oed.kernel.evaluation import evaluate
from oed.robots.limits import (
    LIMITS,
    BodySpeed,
    LateralAcceleration,
    SteeringAngle,
    SteeringRate,
    TrailerAngle,
    TurningRadius,
    WheelJerk,
    WheelSpeed,
    YawRate,
)
from oed.robots.models import DifferentialDrive
from oed.robots.space import DesignSpace, StartPose

SIDEWAYS = {"mecanum", "mecanum_unequal", "omni", "omni_unequal", "icr", "slip", "slip_with_lag"}
SIDEWAYS |= {"bicycle", "bicycle_all_effects"}
SMOOTH = [example for example in ROBOTS if example.name != "skid_slip"]
"""All but the one whose slip jumps where its sides change roles."""
SORTS = (*CORE, "icr", "slip_with_lag", "tricycle", "unicycle_with_lags", "bicycle_all_effects")
"""One that moves of every sort: limits on the motion see a robot by its twist alone."""
every_robot = pytest.mark.parametrize(
    "example", [one for one in SMOOTH if one.name in SORTS], ids=lambda example: example.name
)


def any_drive(example: Example, seed: int = 0, degree: int = 3) -> Trajectory:
    rng = np.random.default_rng(seed)
    space = DesignSpace(
        duration=6, samples=24, spline=Spline(degree=degree, coefficients=8), rest_to_rest=False
    )
    coefficients = draw_inputs(rng, 8, example.model)
    return space.trajectory(coefficients, np.zeros((1, len(example.model.states))))


@cache
def any_motion(example: Example) -> tuple[Drive, np.ndarray]:
    """Such a drive in numbers, and its twists by the oracle."""
    drive = any_drive(example)
    return as_drive(example.model, drive), fine_twists(example, drive)


def two_sided(values: np.ndarray, low: float, high: float) -> float:
    return float(min((high - values).min(), (values - low).min()))


@every_robot
def test_body_speed(example: Example):
    values, twists = any_motion(example)
    forward, lateral, _ = twists.T
    expected = two_sided(forward, -0.2, 0.3)
    if example.name in SIDEWAYS:
        expected = min(expected, 0.3 - np.hypot(forward, lateral).max())
    found = slack(BodySpeed(bounds=(-0.2, 0.3)), values)
    assert found == pytest.approx(expected, abs=3e-4 if example.name in SIDEWAYS else 1e-9)


@every_robot
def test_yaw_rate(example: Example):
    values, twists = any_motion(example)
    yaw_rates = twists[:, 2]
    found = slack(YawRate(bounds=(-0.5, 0.8)), values)
    assert found == pytest.approx(two_sided(yaw_rates, -0.5, 0.8))


@every_robot
def test_lateral_acceleration(example: Example):
    values, twists = any_motion(example)
    forward, lateral, yaw_rate = twists.T
    expected = 0.4 - (np.hypot(forward, lateral) * np.abs(yaw_rate)).max()
    found = slack(LateralAcceleration(bounds=0.4), values)
    tolerance = 4e-4 if example.name in SIDEWAYS else 1e-9
    assert found == pytest.approx(expected, abs=tolerance)


@pytest.mark.parametrize("name", sorted(SIDEWAYS))
def test_magnitudes_are_exact_at_their_bounds(name: str):
    values, twists = any_motion(BY_NAME[name])
    forward, lateral, yaw_rate = twists.T
    speed = np.hypot(forward, lateral)
    assert slack(BodySpeed(bounds=speed.max()), values) == pytest.approx(0, abs=1e-12)
    largest = (speed * np.abs(yaw_rate)).max()
    assert slack(LateralAcceleration(bounds=largest), values) == pytest.approx(0, abs=1e-12)


@every_robot
def test_turning_radius(example: Example):
    values, twists = any_motion(example)
    forward, lateral, yaw_rate = twists.T
    speed, needed = forward**2 + lateral**2, (0.3 * yaw_rate) ** 2
    found = slack(TurningRadius(bounds=0.3), values)
    at_rest = 2 * (2e-3 * 0.3) ** 2
    assert found == pytest.approx((0.3 * (speed - needed) / (speed + needed + at_rest)).min())


@pytest.mark.parametrize("yaw_rate", [0.05, -1.0, 4.0])
@pytest.mark.parametrize("radius", [0.05, 0.4, 3.0])
def test_turning_radius_is_exact_on_a_circle(radius: float, yaw_rate: float):
    wheels = yaw_rate * np.array([radius + 0.09, radius - 0.09]) / 0.049
    drive = Trajectory.from_samples(np.tile(wheels, (8, 1)), 2.0, (0, 0, 0), rest_to_rest=False)
    values = as_drive(BY_NAME["differential"].model, drive)
    assert slack(TurningRadius(bounds=radius), values) == pytest.approx(0, abs=1e-12)
    for share in (0.99, 1.01):
        # Close to the limit the margin is how much wider than it the robot turns, in metres.
        found = slack(TurningRadius(bounds=share * radius), values)
        assert found == pytest.approx((1 - share) * radius, rel=0.02, abs=1e-12)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 30.0])
@pytest.mark.parametrize(("share", "kept"), [(0.9995, True), (1.003, False)])
def test_turning_radius_is_tolerated_by_a_share_of_itself(scale: float, share: float, kept: bool):
    # A robot of millimetres as one with wheels of 1.5 m, at the same yaw rate.
    radius, track = 0.4 * scale, 0.18 * scale
    wheels = 0.5 * np.array([radius + track / 2, radius - track / 2]) / (0.049 * scale)
    model = DifferentialDrive(wheel_radius=0.049 * scale, track=track)
    limits = (WheelSpeed(bounds=100), TurningRadius(bounds=share * radius))
    problem = problem_of(
        model=model,
        design=DesignSpace(duration=2, samples=8, rest_to_rest=False),
        limits=limits,
    )
    drive = Trajectory.from_samples(np.tile(wheels, (8, 1)), 2.0, (0, 0, 0), rest_to_rest=False)
    assert evaluate(problem, drive).feasible == kept


@pytest.mark.parametrize(
    ("yaw_rate", "kept"), [(2e-3, False), (1e-3, False), (9.5e-5, False), (8.5e-5, True)]
)
def test_turning_on_the_spot_is_rest_only_where_it_is_next_to_none(yaw_rate: float, kept: bool):
    limit = TurningRadius(bounds=0.4)
    problem = limited(BY_NAME["differential"], limit, duration=2.0, samples=8, rest_to_rest=False)
    wheels = yaw_rate * np.array([0.09, -0.09]) / 0.049
    drive = Trajectory.from_samples(np.tile(wheels, (8, 1)), 2.0, (0, 0, 0), rest_to_rest=False)
    expected = -0.4 * yaw_rate**2 / (yaw_rate**2 + 2 * 2e-3**2)
    assert margin_of(problem, drive, "turning_radius").margin == pytest.approx(expected, rel=1e-3)
    assert ("turning_radius" not in evaluate(problem, drive).violations) == kept


def test_rest_is_no_turn():
    still = Trajectory.from_samples(np.zeros((8, 2)), 2.0, (0, 0, 0))
    values = as_drive(BY_NAME["differential"].model, still)
    for limit in (TurningRadius(bounds=1), BodySpeed(bounds=1), LateralAcceleration(bounds=1)):
        assert slack(limit, values) >= 0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["differential", "ackermann", "omni"])
def test_margins_of_the_motion_are_between_the_samples_too(name: str):
    example = BY_NAME[name]
    limits = (BodySpeed(bounds=0.2), YawRate(bounds=0.9), LateralAcceleration(bounds=0.3))
    problem = limited(example, *limits)
    drive = random_drive(problem, 5, amplitude=0.4 if name == "ackermann" else 6.0)
    forward, lateral, yaw_rate = fine_twists(example, drive, dense=True).T
    speed = np.hypot(forward, lateral)
    expected = {
        "body_speed": (0.2 - speed.max(), "m/s"),
        "yaw_rate": (0.9 - np.abs(yaw_rate).max(), "rad/s"),
        "lateral_acceleration": (0.3 - (speed * np.abs(yaw_rate)).max(), "m/s^2"),
    }
    for key, (value, unit) in expected.items():
        margin = margin_of(problem, drive, key)
        assert margin.margin == pytest.approx(value, abs=3e-4)
        assert margin.unit == unit


@pytest.mark.parametrize("limit", [BodySpeed(bounds=(0.1, 0.5)), YawRate(bounds=(-2, -1))])
def test_motion_that_excludes_rest_needs_a_drive_without_it(limit):
    model = BY_NAME["differential"].model
    (issue,) = limit.issues(model, DesignSpace(duration=9))
    assert issue.key == ("limits", limit.name)
    assert "excludes 0" in issue.message
    assert limit.issues(model, DesignSpace(duration=9, rest_to_rest=False)) == []


@pytest.mark.parametrize("limit", ["lateral_acceleration", "turning_radius", "path_length"])
@pytest.mark.parametrize(
    ("wrong", "reason"), [(0, "greater than 0"), (-1, "greater than 0"), ("1 rad", "kind")]
)
def test_sizes_must_be_positive(limit: str, wrong, reason: str):
    with pytest.raises(ValidationError, match=reason):
        TypeAdapter(LIMITS[limit]).validate_python(wrong)


@pytest.mark.parametrize("degree", [2, 3, 5])
def test_wheel_jerk_of_a_spline(degree: int):
    example = BY_NAME["differential"]
    drive = any_drive(example, degree, degree)
    jerks = oracle.spline_values(drive, fine_times(drive), order=2)
    found = slack(WheelJerk(bounds=(-50, 70)), as_drive(example.model, drive))
    assert found == pytest.approx(two_sided(jerks, -50, 70))


def test_wheel_jerk_of_each_wheel():
    example, drive = BY_NAME["differential"], any_drive(BY_NAME["differential"], 2)
    names, bounds = example.model.input_names, (20.0, 60.0)
    jerks = oracle.spline_values(drive, fine_times(drive), order=2)
    limit = WheelJerk(each=dict(zip(reversed(names), [(-60, 60), (-20, 20)], strict=True)))
    expected = min(bound - np.abs(column).max() for bound, column in zip(bounds, jerks.T, strict=True))
    assert slack(limit, as_drive(example.model, drive)) == pytest.approx(expected)


def test_wheel_jerk_of_trapezoids_is_their_jumps_over_a_period():
    rows = np.cumsum(np.random.default_rng(0).normal(size=(20, 2)), axis=0)
    drive = Trajectory.from_samples(rows, 5.0, (0, 0, 0))
    # From rest and to rest in half a period each.
    ends = np.vstack([np.zeros(2), rows, np.zeros(2)])
    periods = np.concatenate([[0.125], np.full(19, 0.25), [0.125]])
    jumps = np.diff(np.diff(ends, axis=0) / periods[:, None], axis=0) / 0.25
    found = slack(WheelJerk(bounds=100), as_drive(BY_NAME["differential"].model, drive))
    assert found == pytest.approx(100 - np.abs(jumps).max())


def polygon(rows: np.ndarray) -> Trajectory:
    return Trajectory.from_samples(rows, 10.0, (0, 0, 0))


def spline_of(degree: int) -> Callable[[np.ndarray], Trajectory]:
    """Drives of 10 samples with these coefficients, at rest at both ends."""

    def drive(rows: np.ndarray) -> Trajectory:
        table = np.vstack([np.zeros(2), rows, np.zeros(2)])
        space = DesignSpace(duration=10, samples=10, spline=Spline(degree=degree, coefficients=len(table)))
        return space.trajectory(table, np.zeros(3))

    return drive


@pytest.mark.parametrize("count", [4, 9, 37])
@pytest.mark.parametrize("build", [polygon, spline_of(1), spline_of(0)], ids=["samples", "lines", "steps"])
def test_wheel_jerk_of_a_drive_is_that_of_its_reverse(build: Callable[[np.ndarray], Trajectory], count: int):
    # All at once from rest, then gently back to it; and the other way round.
    rows = np.linspace(4, 0, count + 1)[:-1, None] * np.array([1.0, 0.8])
    problem = limited(BY_NAME["differential"], WheelJerk(bounds=5), duration=10.0, samples=10)
    drives = [build(rows), build(rows[::-1])]
    first, second = (margin_of(problem, drive, "wheel_jerk") for drive in drives)
    assert first.margin == pytest.approx(second.margin, abs=1e-9)
    # The kinks of the lines from rest through what is held and back to rest.
    times = [0.0, *middles(10.0, drives[0].samples), 10.0]
    slopes = np.diff(np.concatenate([[0.0], drives[0].inputs[:, 0], [0.0]])) / np.diff(times)
    assert first.margin == pytest.approx(5 - np.abs(np.diff(slopes)).max() / drives[0].period)


@pytest.mark.parametrize("degree", [2, 3, 4])
@pytest.mark.parametrize("samples", [1, 2, 7, 50])
def test_the_lines_through_a_smooth_drive_have_no_more_jerk_than_it(degree: int, samples: int):
    # So that a design that keeps to the limit keeps to it as a file too.
    space = DesignSpace(duration=4, samples=samples, spline=Spline(degree=degree, coefficients=9))
    for seed in range(5):
        table = np.zeros((9, 2))
        table[1:-1] = np.random.default_rng(seed).normal(size=(7, 2))
        drive = space.trajectory(table, np.zeros(3))
        lines = Trajectory.from_samples(drive.inputs, 4.0, np.zeros(3))
        assert np.all(np.abs(lines.extremes(2)).max(axis=0) <= np.abs(drive.extremes(2)).max(axis=0) + 1e-9)


@pytest.mark.parametrize("degree", [0, 1])
@pytest.mark.parametrize("count", [3, 8, 31])
def test_what_a_limit_sees_of_jerks_is_what_the_scorer_sees(degree: int, count: int):
    space = DesignSpace(
        duration=4, samples=8, runs=2, spline=Spline(degree=degree, coefficients=count), rest_to_rest=False
    )
    table = np.random.default_rng(count).normal(size=(2 * count, 2))
    drive = space.trajectory(table, np.zeros((2, 3)))
    assert drive.extremes(2).shape == (16, 2)
    jerks = [bounding_values(run.knots, degree, run.coefficients, run.samples, 2) for run in drive.each]
    np.testing.assert_allclose(np.vstack(jerks), drive.extremes(2), atol=1e-9)


@pytest.mark.parametrize(("degree", "refused"), [(0, True), (1, True), (2, False), (3, False)])
def test_wheel_jerk_needs_accelerations_without_jumps(degree: int, refused: bool):
    space = DesignSpace(duration=9, spline=Spline(degree=degree, coefficients=8))
    issues = WheelJerk(bounds=100).issues(BY_NAME["differential"].model, space)
    assert [issue.key for issue in issues] == [("limits", "wheel_jerk")] * refused
    assert all("spline.degree 2 or more" in issue.message for issue in issues)


@pytest.mark.parametrize("name", ["tricycle", "ackermann"])
def test_steering_of_a_spline(name: str):
    example, drive = BY_NAME[name], any_drive(BY_NAME[name], 3)
    values, rates = (oracle.spline_values(drive, fine_times(drive), order)[:, 1] for order in (0, 1))
    numbers = as_drive(example.model, drive)
    assert slack(SteeringAngle(bounds=(-0.4, 0.3)), numbers) == pytest.approx(two_sided(values, -0.4, 0.3))
    assert slack(SteeringRate(bounds=0.7), numbers) == pytest.approx(0.7 - np.abs(rates).max())
    named = SteeringRate(each={"steering_angle": (-0.7, 0.7)})
    assert slack(named, numbers) == pytest.approx(0.7 - np.abs(rates).max())


@pytest.mark.slow
@pytest.mark.parametrize("name", ["trailer", "trailer_on_axle"])
def test_trailer_angle(name: str):
    example = BY_NAME[name]
    problem = limited(example, TrailerAngle(bounds=(-1, 1.2)))
    drive = random_drive(problem, 4)
    middles = (np.arange(drive.samples) + 0.5) * drive.period
    state, angles, parameters = np.zeros(4), [0.0], np.array(example.model.nominal)
    for twist in (example.twist(row) for row in oracle.spline_values(drive, middles)):
        angles += [
            float(example.internal(state, twist, drive.period * part / FINER, parameters, steps=40)[0])
            for part in range(1, FINER + 1)
        ]
        state = np.append(oracle.advance(state, twist, drive.period, "arc"), angles[-1])
    assert np.abs(state[:3] - fine_path(example, drive)[-1]).max() < 1e-9
    margin = margin_of(problem, drive, "trailer_angle")
    assert margin.margin == pytest.approx(two_sided(np.array(angles), -1, 1.2), abs=2e-3)
    assert (margin.size, margin.unit) == (1.2, "rad")


@pytest.mark.parametrize("start", [StartPose(), "free"])
def test_trailer_angle_needs_a_trailer_that_may_be_straight(start):
    space = DesignSpace(duration=9, start=start)
    (issue,) = TrailerAngle(bounds=1).issues(BY_NAME["differential"].model, space)
    assert (issue.key, issue.message) == (("limits", "trailer_angle"), "differential_drive has no trailer")
    assert TrailerAngle(bounds=1).issues(BY_NAME["trailer"].model, space) == []
    (issue,) = TrailerAngle(bounds=(0.1, 1)).issues(BY_NAME["trailer"].model, space)
    assert "excludes 0" in issue.message
