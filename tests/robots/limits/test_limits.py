"""Limits: the forms they are given in, their rows, and what makes them impossible."""

from __future__ import annotations

import numpy as np
import pytest
from builders import problem_of
from driving import limit_of
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.evaluation import evaluate
from oed.kernel.results import TOLERANCE, Margin
from oed.robots.limits import Rectangle, WheelAcceleration, WheelSpeed
from oed.robots.space import DesignSpace, StartPose

BOUNDED = {"wheel_speed": "rad/s", "wheel_acceleration": "rad/s^2"}
two_sided = pytest.mark.parametrize("key", BOUNDED)


def margin_of(problem, drive: Trajectory, name: str) -> Margin:
    (margin,) = [margin for margin in evaluate(problem, drive).margins if margin.name == name]
    return margin


def constant_drive(right: float, left: float, duration: float = 10.0, start=(0, 0, 0)) -> Trajectory:
    return Trajectory.from_samples(np.tile([right, left], (40, 1)), duration, start, rest_to_rest=False)


@two_sided
@pytest.mark.parametrize(
    ("given_value", "expected"),
    [
        (5, (-5, 5)),
        (5.5, (-5.5, 5.5)),
        ("5 {unit}", (-5, 5)),
        ([-1, 5], (-1, 5)),
        (["-1 {unit}", "5 {unit}"], (-1, 5)),
        (("0 {unit}", 5), (0, 5)),
        ({"bounds": "5 {unit}"}, (-5, 5)),
        ({"bounds": [-1, 5]}, (-1, 5)),
    ],
)
def test_forms_of_a_two_sided_limit(key: str, given_value, expected):
    def with_unit(value):
        if isinstance(value, str):
            return value.format(unit=BOUNDED[key])
        if isinstance(value, dict):
            return {name: with_unit(entry) for name, entry in value.items()}
        return type(value)(map(with_unit, value)) if isinstance(value, list | tuple) else value

    limit = limit_of(key, with_unit(given_value))
    assert limit.bounds == pytest.approx(expected)
    assert limit.name == key


def test_other_units_of_speed():
    assert limit_of("wheel_speed", "60 rpm").bounds == pytest.approx((-2 * np.pi, 2 * np.pi))


@two_sided
@pytest.mark.parametrize(
    ("wrong", "reason"),
    [
        (0, "positive limit"),
        (-5, "positive limit"),
        ([5, 1], "min below max"),
        ([5, 5], "min below max"),
        ([1, 2, 3], "got 3 values"),
        ([1], "got 1 values"),
        ("5 m", "of another kind"),
        ("fast", "expected"),
        (None, "expected"),
        ([0, float("inf")], "finite"),
        ({"bounds": 5, "wheels": 2}, "wheels"),
        ({}, "bounds"),
    ],
)
def test_wrong_values_are_refused(key: str, wrong, reason: str):
    with pytest.raises(ValidationError, match=reason):
        limit_of(key, wrong)


def test_forms_of_a_rectangle():
    box = limit_of("workspace", {"kind": "rectangle", "x": ["-1 m", "1 m"], "y": ["-50 cm", 2]})
    assert box.extent == pytest.approx((-1, 1, -0.5, 2))
    ready = Rectangle(x=(0, 1), y=(0, 1))
    assert limit_of("workspace", ready) is ready


@pytest.mark.parametrize(
    ("wrong", "reason"),
    [
        ({"kind": "rectangle", "x": [1, -1], "y": [0, 1]}, "min below max"),
        ({"kind": "rectangle", "x": [-1, 1], "y": [1, 1]}, "min below max"),
        ({"kind": "rectangle", "x": [-1, 1]}, "y"),
        ({"kind": "rectangle", "x": ["-1 rad", 1], "y": [0, 1]}, "of another kind"),
        ({"kind": "hexagon", "x": [-1, 1], "y": [0, 1]}, "rectangle"),
        (3, "rectangle|Rectangle|dict"),
    ],
)
def test_wrong_workspaces_are_refused(wrong, reason: str):
    with pytest.raises(ValidationError, match=reason):
        limit_of("workspace", wrong)


@pytest.mark.slow
@given(
    right=st.floats(-20, 20),
    left=st.floats(-20, 20),
    bounds=st.tuples(st.floats(-10, -0.1), st.floats(0.1, 10)),
)
def test_speed_margin_is_the_distance_to_the_nearer_bound(right, left, bounds):
    problem = problem_of(limits=(WheelSpeed(bounds=bounds),))
    margin = margin_of(problem, constant_drive(right, left), "wheel_speed")
    low, high = bounds
    assert margin.margin == pytest.approx(min(high - max(right, left), min(right, left) - low), abs=1e-12)
    assert (margin.size, margin.unit) == (pytest.approx(max(-low, high)), "rad/s")


@pytest.mark.parametrize("sign", [1, -1])
def test_acceleration_margin_of_a_ramp(sign: int):
    problem = problem_of(limits=(WheelSpeed(bounds=10), WheelAcceleration(bounds=(-1, 2))))
    ramp = sign * np.outer((np.arange(40) + 0.5) * 0.25, [0.5, 0.25])
    drive = Trajectory.from_samples(ramp, 10.0, (0, 0, 0), rest_to_rest=False)
    margin = margin_of(problem, drive, "wheel_acceleration")
    # A ramp of 0.5 rad/s^2 on one wheel and 0.25 on the other, flat in the outer half periods.
    assert margin.margin == pytest.approx(1.0 if sign > 0 else 0.5)
    assert (margin.size, margin.unit) == (2, "rad/s^2")


@pytest.mark.parametrize(("speed", "expected"), [(2.0, 0.02), (2.5, -0.225), (-1.0, 0.01), (-4.0, -1.46)])
def test_workspace_margin_of_a_straight(speed: float, expected: float):
    # 10 s at r w = 0.049 w m/s along x, in a box that is 1 m ahead and 0.5 m behind.
    problem = problem_of(limits=(WheelSpeed(bounds=10), Rectangle(x=(-0.5, 1), y=(-1, 1))))
    margin = margin_of(problem, constant_drive(speed, speed), "workspace")
    assert margin.margin == pytest.approx(expected)
    assert (margin.size, margin.unit) == (0.75, "m")
    assert margin.violation == pytest.approx(max(0, -expected))


def test_workspace_is_looked_at_between_the_samples():
    # One circle per period: the samples all lie at the start, the path does not.
    speed = 2 * np.pi * 0.18 / (0.049 * 0.25)
    problem = problem_of(limits=(WheelSpeed(bounds=100), Rectangle(x=(-1, 1), y=(-0.05, 0.05))))
    evaluation = evaluate(problem, constant_drive(speed, 0.0))
    np.testing.assert_allclose(evaluation.states[:, :2], 0, atol=1e-9)
    margin = margin_of(problem, constant_drive(speed, 0.0), "workspace")
    assert margin.margin == pytest.approx(0.05 - 0.18, abs=1e-6)
    assert margin.certain


@pytest.mark.parametrize(
    ("margin", "active", "kept"),
    [(1.0, False, True), (0.5 * TOLERANCE, True, True), (-0.5 * TOLERANCE, True, True), (-1.0, True, False)],
)
def test_what_is_active_and_what_is_kept(margin: float, active: bool, kept: bool):
    found = Margin("wheel_speed", 10 * margin, 10.0, "rad/s")
    assert (found.active, found.satisfied) == (active, kept)
    assert found.violation == max(0.0, -10 * margin)


@pytest.mark.parametrize(("x", "y"), [(1.5, 0), (0, -1.5), (-2, 2)])
def test_a_start_outside_the_workspace_is_an_issue(x: float, y: float):
    model, box = problem_of().model, Rectangle(x=(-1, 1), y=(-1, 1))
    (issue,) = box.issues(model, DesignSpace(duration=10, start=StartPose(x=x, y=y)))
    assert issue.key == ("limits", "workspace")
    assert f"({x:g} m, {y:g} m) lies outside the workspace" in issue.message
    assert box.issues(model, DesignSpace(duration=10, start=StartPose(x=1, y=-1))) == []
    assert box.issues(model, DesignSpace(duration=10, start="free")) == []


@pytest.mark.parametrize("bounds", [(3, 10), (-10, -3)])
def test_a_least_speed_needs_a_drive_without_rest(bounds):
    model, limit = problem_of().model, WheelSpeed(bounds=bounds)
    (issue,) = limit.issues(model, DesignSpace(duration=10))
    assert issue.key == ("limits", "wheel_speed")
    assert "excludes 0" in issue.message
    assert limit.issues(model, DesignSpace(duration=10, rest_to_rest=False)) == []


def test_speeds_bound_the_inputs_and_accelerations_do_not():
    model = problem_of().model
    assert WheelSpeed(bounds=(0, 4)).input_bounds(model) == dict.fromkeys(model.input_names, (0, 4))
    assert WheelAcceleration(bounds=4).input_bounds(model) == {}
