"""Limits on inputs: bounds by the inputs' names, and what a robot's steering allows."""

from __future__ import annotations

import numpy as np
import oracle
import pytest
from builders import random_drive
from driving import BY_NAME, dense_times, limit_of, limited, margin_of
from pydantic import ValidationError

from oed.robots.limits import LIMITS, SteeringAngle, WheelSpeed
from oed.robots.space import DesignSpace

KEYS = ("wheel_speed", "wheel_acceleration", "wheel_jerk", "steering_angle", "steering_rate")
UNITS = dict(zip(KEYS, ("rad/s", "rad/s^2", "rad/s^3", "rad", "rad/s"), strict=True))
SPACE = DesignSpace(duration=9)


def robot_for(key: str):
    return BY_NAME["tricycle" if key.startswith("steering") else "differential"].model


@pytest.mark.parametrize("key", KEYS)
@pytest.mark.parametrize("wrapped", [False, True])
def test_bounds_by_name(key: str, wrapped: bool):
    names = {"a": f"2 {UNITS[key]}", "b": [-1, 3], "c": 4}
    limit = limit_of(key, {"each": names} if wrapped else names)
    assert limit.bounds is None
    assert {name: limit.bounds_of(name) for name in names} == {"a": (-2, 2), "b": (-1, 3), "c": (-4, 4)}
    alike = limit_of(key, 4)
    assert alike.bounds_of("any") == (-4, 4)


@pytest.mark.parametrize("key", KEYS)
@pytest.mark.parametrize(
    ("wrong", "reason"),
    [
        ({}, "by the inputs' names"),
        ({"each": {}}, "by the inputs' names"),
        ({"bounds": 1, "each": {"a": 1}}, "by the inputs' names"),
        ({"a": 0}, "positive limit"),
        ({"a": [2, 1]}, "min below max"),
        ({"a": "1 kg"}, "of another kind|not known"),
        ({"a": {"b": 1}}, "expected"),
    ],
)
def test_wrong_bounds_by_name_are_refused(key: str, wrong, reason: str):
    with pytest.raises(ValidationError, match=reason):
        limit_of(key, wrong)


@pytest.mark.parametrize("key", KEYS)
def test_every_input_needs_bounds_by_its_name(key: str):
    model = robot_for(key)
    own = [entry.name for entry in model.inputs if entry.quantity == LIMITS[key].quantity]
    assert limit_of(key, dict.fromkeys(own, 0.5)).issues(model, SPACE) == []
    (issue,) = limit_of(key, {**dict.fromkeys(own, 0.5), "wheel_middle": 1}).issues(model, SPACE)
    assert issue.key == ("limits", key)
    assert issue.message == f"expected bounds of {', '.join(own)}; got {', '.join([*own, 'wheel_middle'])}"
    (issue,) = limit_of(key, {"another": 1}).issues(model, SPACE)
    assert issue.message.endswith("got another")
    if len(own) > 1:
        (issue,) = limit_of(key, {own[0]: 1}).issues(model, SPACE)
        assert issue.message == f"expected bounds of {', '.join(own)}; got {own[0]}"


@pytest.mark.parametrize("key", ["steering_angle", "steering_rate"])
def test_steering_limits_need_a_steered_wheel(key: str):
    (issue,) = limit_of(key, 0.5).issues(BY_NAME["differential"].model, SPACE)
    assert issue.key == ("limits", key)
    assert "differential_drive has no steering_angle; its inputs are wheel_" in issue.message


@pytest.mark.parametrize(
    ("bounds", "refused"), [("80 deg", False), ("81 deg", True), ([-1, 1.42], True), (2, True)]
)
def test_ackermann_cannot_steer_across(bounds, refused: bool):
    # Gain 1.1 and offset -0.02 rad: the wheels stand across at (90 deg - 0.02 rad) / 1.1 = 1.4098 rad.
    for value in (bounds, {"steering_angle": bounds}):
        issues = limit_of("steering_angle", value).issues(BY_NAME["ackermann"].model, SPACE)
        assert [issue.key for issue in issues] == [("limits", "steering_angle")] * refused
        assert all("steering_angle must stay below 1.41 rad" in issue.message for issue in issues)


def test_a_tricycle_may_steer_across():
    assert limit_of("steering_angle", "120 deg").issues(BY_NAME["tricycle"].model, SPACE) == []


@pytest.mark.parametrize("value", [[0.1, 0.5], {"steering_angle": [-0.5, -0.1]}])
def test_steering_that_excludes_straight_needs_a_drive_without_rest(value):
    model, limit = BY_NAME["tricycle"].model, limit_of("steering_angle", value)
    (issue,) = limit.issues(model, SPACE)
    assert "excludes 0" in issue.message
    assert limit.issues(model, DesignSpace(duration=9, rest_to_rest=False)) == []


@pytest.mark.parametrize("seed", range(3))
def test_margins_of_bounds_by_name(seed: int):
    example = BY_NAME["mecanum"]
    names = example.model.input_names
    bounds = {name: (-2.0 - place, 3.0 + 2 * place) for place, name in enumerate(names)}
    limit = WheelSpeed(each=dict(reversed(bounds.items())))
    problem = limited(example, limit)
    drive = random_drive(problem, seed)
    values = oracle.spline_values(drive, dense_times(drive))
    low, high = np.array(list(bounds.values())).T
    margin = margin_of(problem, drive, "wheel_speed")
    assert margin.margin == pytest.approx(min((high - values).min(), (values - low).min()))
    assert (margin.size, margin.unit) == (9, "rad/s")
    np.testing.assert_allclose(problem.input_bounds, np.column_stack([low, high]))


def test_which_limits_bound_inputs_and_rates():
    model = BY_NAME["tricycle"].model
    wheel, steered = model.input_names
    assert SteeringAngle(bounds=(-0.2, 0.4)).input_bounds(model) == {steered: (-0.2, 0.4)}
    assert WheelSpeed(bounds=3).input_bounds(model) == {wheel: (-3, 3)}
    assert limit_of("steering_rate", 2).rate_bounds(model) == {steered: (-2, 2)}
    assert limit_of("wheel_acceleration", 2).rate_bounds(model) == {wheel: (-2, 2)}
    assert limit_of("steering_rate", 2).input_bounds(model) == {}
    assert (
        limit_of("steering_angle", 1).rate_bounds(model) == limit_of("wheel_jerk", 1).rate_bounds(model) == {}
    )
