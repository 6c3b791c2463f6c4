"""Limits on how far and where a drive ends, run by run; all limits' files, and what several runs share."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from builders import random_drive
from driving import BY_NAME, as_drive, fine_path, limit_of, limited, margin_of, row_values, slack
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from oed.kernel.dynamics.rollout import roll_out
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.evaluation import evaluate
from oed.robots.limits import LIMITS, EndHeading, EndPosition, PathLength
from oed.robots.space import DesignSpace, StartPose

EXAMPLES = {
    "wheel_speed": "10 rad/s",
    "wheel_acceleration": ["-10 rad/s^2", "20 rad/s^2"],
    "wheel_jerk": {"wheel_right": 200, "wheel_left": ["-1 rad/s^3", 300]},
    "steering_angle": "35 deg",
    "steering_rate": {"steering_angle": "60 deg/s"},
    "commanded_speed": ["-10 cm/s", 0.5],
    "commanded_acceleration": "1 m/s^2",
    "commanded_yaw_rate": {"omega": "90 deg/s"},
    "commanded_yaw_acceleration": "3 rad/s^2",
    "throttle": ["-50 %", 1],
    "throttle_rate": "4 1/s",
    "body_speed": ["-10 cm/s", 0.5],
    "yaw_rate": "60 deg/s",
    "lateral_acceleration": "0.5 m/s^2",
    "turning_radius": "40 cm",
    "trailer_angle": "60 deg",
    "workspace": {"kind": "polygon", "points": [["-1 m", -1], [2, -1], [2, 1], [0, 0.5], [-1, 1]]},
    "obstacles": [
        {"kind": "circle", "x": "1 m", "y": 0, "radius": "10 cm"},
        {"kind": "polygon", "points": [[0, 0.4], [0.3, 0.4], ["10 cm", 0.8]]},
    ],
    "path_length": "5 m",
    "end_position": {"at": {"x": "1 m", "y": "20 cm"}, "tolerance": "5 mm"},
    "end_heading": {"at": "start", "tolerance": "2 deg"},
}
"""Every limit as a study may give it."""

FURTHER = [
    ("workspace", {"kind": "rectangle", "x": ["-1 m", 1], "y": [-1, 1]}),
    ("workspace", {"kind": "circle", "radius": "2 m"}),
    ("wheel_speed", {"wheel_right": [0, 10], "wheel_left": 3}),
    ("end_position", "start"),
    ("end_position", {"x": 1, "y": 2}),
    ("end_heading", "90 deg"),
]
MODELS = {
    "steering_angle": "tricycle",
    "steering_rate": "ackermann",
    "commanded_speed": "unicycle",
    "commanded_acceleration": "unicycle",
    "commanded_yaw_rate": "unicycle",
    "commanded_yaw_acceleration": "unicycle",
    "throttle": "bicycle",
    "throttle_rate": "bicycle",
    "trailer_angle": "trailer",
    "body_speed": "mecanum",
    "lateral_acceleration": "omni",
}


def test_every_limit_has_an_example():
    assert set(EXAMPLES) == set(LIMITS)


def test_limits_survive_writing_and_reading():
    for key, value in (*EXAMPLES.items(), *FURTHER):
        limit = limit_of(key, value)
        assert limit.name == key
        written = limit.model_dump(mode="json", exclude_none=True)
        again = limit_of(key, written)
        assert again == limit, key
        assert again.model_dump(mode="json", exclude_none=True) == written, key
        assert TypeAdapter(LIMITS[key]).validate_json(limit.model_dump_json(exclude_none=True)) == limit, key


def for_robot(key: str, model):
    """The example, for the inputs that the robot has."""
    value = EXAMPLES[key]
    if key == "wheel_jerk":
        value = {name: 100 + 10 * place for place, name in enumerate(model.input_names)}
    return limit_of(key, value)


@pytest.mark.parametrize("key", LIMITS)
def test_rows_of_two_runs_are_those_of_each(key: str):
    example = BY_NAME[MODELS.get(key, "differential")]
    limit, model = for_robot(key, example.model), example.model
    space = DesignSpace(duration=3, samples=12, runs=2, rest_to_rest=True)
    rng = np.random.default_rng(3)
    coefficients = np.zeros((space.all_coefficients, len(model.inputs)))
    coefficients[space.free_rows] = rng.uniform(-0.5, 0.5, (len(space.free_rows), len(model.inputs)))
    starts = np.zeros((2, len(model.states)))
    starts[:, :3] = [(0.1, -0.3, 0.2), (-0.4, 0.2, 2.0)]
    both = space.trajectory(coefficients, starts)
    alone = DesignSpace(duration=3, samples=12)
    parts = [
        alone.trajectory(own, start) for own, start in zip(np.split(coefficients, 2), starts, strict=True)
    ]
    singles = [as_drive(model, part) for part in parts]
    whole = as_drive(model, both)
    assert slack(limit, whole) == pytest.approx(min(slack(limit, part) for part in singles), abs=1e-9)
    found = np.sort(row_values(limit, whole))
    expected = np.sort(np.concatenate([row_values(limit, part) for part in singles]))
    np.testing.assert_allclose(found, expected, atol=1e-9)


@pytest.mark.parametrize("samples", [7, 11, 40])
def test_jerk_of_trapezoids_in_several_runs(samples: int):
    rows, starts = np.random.default_rng(0).normal(size=(3 * samples, 2)), np.zeros((3, 3))
    whole = Trajectory.from_samples(rows, 23.1, starts, runs=3)
    model, limit = BY_NAME["differential"].model, limit_of("wheel_jerk", 100)
    parts = [Trajectory.from_samples(own, 7.7, starts[0]) for own in np.split(rows, 3)]
    expected = min(slack(limit, as_drive(model, part)) for part in parts)
    assert slack(limit, as_drive(model, whole)) == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", ["differential", "omni"])
def test_path_length_of_every_run(name: str, seed: int):
    example = BY_NAME[name]
    problem = limited(example, PathLength(bounds=1.2), runs=2)
    drive = random_drive(problem, seed)
    speeds = [np.hypot(*example.twist(row)[:2]) for row in drive.inputs]
    lengths = np.array(speeds).reshape(2, -1).sum(axis=1) * drive.period
    margin = margin_of(problem, drive, "path_length")
    assert margin.margin == pytest.approx(1.2 - lengths.max(), abs=2e-4 * 6)
    assert margin.margin <= 1.2 - lengths.max() + 1e-12
    assert (margin.size, margin.unit) == (1.2, "m")
    assert evaluate(problem, drive).path_length == pytest.approx(lengths.sum(), abs=1e-6)


@pytest.mark.parametrize(
    ("given_value", "at", "tolerance"),
    [
        ("start", "start", 0.01),
        ({"at": "start"}, "start", 0.01),
        ({"at": "start", "tolerance": "5 mm"}, "start", 0.005),
        ({"x": "1 m", "y": "-20 cm"}, (1, -0.2), 0.01),
        ({"x": 1, "y": 2, "tolerance": "5 cm"}, (1, 2), 0.05),
        ({"at": {"x": 1, "y": 2}, "tolerance": 0.05}, (1, 2), 0.05),
    ],
)
def test_forms_of_an_end_position(given_value, at, tolerance: float):
    limit = limit_of("end_position", given_value)
    assert (limit.at if limit.at == "start" else (limit.at.x, limit.at.y)) == at
    assert limit.tolerance == pytest.approx(tolerance)


@pytest.mark.parametrize(
    ("given_value", "at", "tolerance"),
    [
        ("start", "start", np.radians(1)),
        ("90 deg", np.pi / 2, np.radians(1)),
        (-1, -1.0, np.radians(1)),
        ({"at": "180 deg", "tolerance": "5 deg"}, np.pi, np.pi / 36),
        ({"at": "start", "tolerance": 0.2}, "start", 0.2),
    ],
)
def test_forms_of_an_end_heading(given_value, at, tolerance: float):
    limit = limit_of("end_heading", given_value)
    assert limit.at == (at if at == "start" else pytest.approx(at))
    assert limit.tolerance == pytest.approx(tolerance)


@pytest.mark.parametrize(
    ("key", "wrong", "reason"),
    [
        ("end_position", "finish", "start"),
        ("end_position", {"x": 1}, "y"),
        ("end_position", {"x": 1, "y": 1, "z": 1}, "z"),
        ("end_position", {"at": "start", "tolerance": 0}, "greater than 0"),
        ("end_position", {"at": "start", "tolerance": "2 deg"}, "of another kind"),
        ("end_heading", "north", "start"),
        ("end_heading", "1 m", "of another kind"),
        ("end_heading", {"at": 0, "tolerance": -1}, "greater than 0"),
        ("end_heading", {"tolerance": 1}, "at"),
    ],
)
def test_wrong_ends_are_refused(key: str, wrong, reason: str):
    with pytest.raises(ValidationError, match=reason):
        limit_of(key, wrong)


@pytest.mark.parametrize("seed", range(3))
def test_ends_of_a_drive(seed: int):
    example = BY_NAME["differential"]
    limits = (EndPosition(at={"x": 0.3, "y": -0.1}, tolerance=0.2), EndHeading(at=0.5, tolerance=0.3))
    problem = limited(example, *limits, start=StartPose(x=0.2, y=0.1, heading=1))
    drive = random_drive(problem, seed)
    x, y, heading = fine_path(example, drive)[-1]
    margin = margin_of(problem, drive, "end_position")
    assert margin.margin == pytest.approx(0.2 - np.hypot(x - 0.3, y + 0.1), abs=1e-9)
    assert (margin.size, margin.unit) == (0.2, "m")
    off = abs(np.angle(np.exp(1j * (heading - 0.5))))
    margin = margin_of(problem, drive, "end_heading")
    assert margin.margin == pytest.approx(0.3 - off, abs=1e-9)
    assert (margin.size, margin.unit) == (0.3, "rad")


@pytest.mark.parametrize(("share", "kept"), [(0.999, True), (1.002, False)])
@pytest.mark.parametrize("direction", [0.0, 0.7, 2.4])
def test_a_tolerance_is_a_distance_in_any_direction(direction: float, share: float, kept: bool):
    example = BY_NAME["differential"]
    drive = random_drive(limited(example), 1)
    x, y, _ = fine_path(example, drive)[-1]
    place = {"x": x + 0.1 * np.cos(direction) * share, "y": y + 0.1 * np.sin(direction) * share}
    problem = limited(example, EndPosition(at=place, tolerance=0.1))
    assert margin_of(problem, drive, "end_position").satisfied == kept
    assert margin_of(problem, drive, "end_position").margin == pytest.approx(0.1 - 0.1 * share, abs=1e-9)


@pytest.mark.parametrize(("share", "kept"), [(0.999, True), (1.002, False)])
@pytest.mark.parametrize("tolerance", [0.1, 2.0, 3.0])
def test_a_tolerance_is_an_angle_of_any_size(tolerance: float, share: float, kept: bool):
    example = BY_NAME["differential"]
    drive = random_drive(limited(example), 1)
    *_, heading = fine_path(example, drive)[-1]
    problem = limited(example, EndHeading(at=heading + share * tolerance, tolerance=tolerance))
    assert margin_of(problem, drive, "end_heading").satisfied == kept
    assert margin_of(problem, drive, "end_heading").margin == pytest.approx((1 - share) * tolerance, abs=1e-7)


def turning(angles, begins=None) -> Trajectory:
    """Runs of 2 s that turn on the spot by these angles."""
    runs, begins = len(angles), np.zeros(len(angles)) if begins is None else np.asarray(begins)
    speed = np.repeat(np.asarray(angles, dtype=float) / 2 * 0.09 / 0.049, 4)
    starts = np.column_stack([np.zeros((runs, 2)), begins])
    inputs = np.column_stack([speed, -speed])
    return Trajectory.from_samples(inputs, 2.0 * runs, starts, rest_to_rest=False, runs=runs)


@pytest.mark.slow
@given(
    begin=st.floats(-3, 3),
    off=st.floats(-3.1, 3.1),
    turns=st.integers(-2, 2),
    tolerance=st.floats(0.01, 3.1),
    at_start=st.booleans(),
)
def test_full_turns_do_not_count(begin: float, off: float, turns: int, tolerance: float, at_start: bool):
    limit = EndHeading(at="start" if at_start else 0.7, tolerance=tolerance)
    target = begin if at_start else 0.7
    drive = turning([target + off + 2 * np.pi * turns - begin], [begin])
    kept = slack(limit, as_drive(BY_NAME["differential"].model, drive)) >= 0
    assert kept == (abs(off) <= tolerance) or abs(abs(off) - tolerance) < 1e-9


def test_ends_of_every_run():
    model = BY_NAME["differential"].model
    drive = as_drive(model, turning([0.2, 2 * np.pi - 0.5, 0.1], [0, 1, 2]))
    np.testing.assert_allclose(
        np.abs(row_values(EndHeading(at="start"), drive)), 2 * np.sin([0.1, 0.25, 0.05]), atol=1e-9
    )
    expected = 2 * np.abs(np.sin((np.array([0.2, 0.5 + 2 * np.pi, 2.1]) - 0.5) / 2))
    np.testing.assert_allclose(np.abs(row_values(EndHeading(at=0.5), drive)), expected, atol=1e-9)
    limit = EndPosition(at="start")
    np.testing.assert_allclose(row_values(limit, drive), 0.005, atol=1e-9)
    assert limit.amount(row_values(limit, drive).max() - 0.01) == pytest.approx(-0.01)
    first, last = drive.ends_of(drive.path)
    assert first.shape == last.shape == (3, 3)
    limit = EndPosition(at={"x": 1, "y": -2})
    away = [limit.amount(value - 0.01) + 0.01 for value in row_values(limit, drive)]
    np.testing.assert_allclose(away, np.sqrt(5))


@pytest.mark.parametrize("key", ["end_position", "path_length", "turning_radius", "body_speed"])
def test_slopes_at_rest_are_finite(key: str):
    model = BY_NAME["mecanum" if key == "body_speed" else "differential"].model
    space = DesignSpace(duration=3, samples=6)
    inputs = ca.SX.sym("inputs", space.samples, len(model.inputs))
    drive = roll_out(
        model,
        inputs=inputs,
        start=ca.DM.zeros(1, 3),
        parameters=ca.DM(model.nominal),
        period=ca.DM(space.period),
    )
    rows, flat = limit_of(key, EXAMPLES[key]).rows(drive).expression, ca.vec(inputs)
    slopes = ca.jacobian(rows, flat)
    curvatures = ca.jacobian(ca.sum1(slopes), flat)
    function = ca.Function("slopes", [inputs], [slopes, curvatures])
    for table in function(np.zeros(inputs.shape)):
        assert np.all(np.isfinite(np.array(table)))
