"""A problem's parts fit together, or every reason why not is listed."""

from __future__ import annotations

import pickle
from typing import ClassVar, Literal

import casadi as ca
import numpy as np
import pytest
from builders import ACCELERATION, BOX, RADIUS, SPEED, TRACK, make_problem, random_drive

from oed.criteria import E
from oed.errors import ProblemError, UserMistake
from oed.evaluation import evaluate
from oed.limits import WheelSpeed
from oed.measurements import Displacements
from oed.models import DifferentialDrive, Input, Model, Parameter
from oed.trajectory import DesignSpace, Spline, StartPose


class Unicycle(Model):
    """A user's own robot: speed and yaw rate are the inputs themselves."""

    kind: Literal["unicycle"] = "unicycle"
    inputs: ClassVar[tuple[Input, ...]] = (Input("speed", "speed", "m/s"), Input("yaw_rate", "turn", "rad/s"))

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("gain", 1.0, ""),)

    def twist(self, inputs, parameters):
        return ca.vertcat(parameters[0] * inputs[0], 0, inputs[1])


class MotorSpeed(WheelSpeed):
    """A user's own limit, which bounds the same inputs as another."""

    name: ClassVar[str] = "motor_speed"


def flaws_of(**overrides) -> dict[str, str]:
    with pytest.raises(ProblemError) as caught:
        make_problem(**overrides)
    return {".".join(map(str, flaw.key)): flaw.message for flaw in caught.value.flaws}


def test_the_builders_problem_is_valid():
    problem = make_problem()
    np.testing.assert_array_equal(problem.input_bounds, [[-10, 10], [-10, 10]])


@pytest.mark.parametrize("order", [1, -1])
def test_limits_on_the_same_inputs_bound_them_together(order: int):
    limits = (WheelSpeed(bounds=(-2, 8)), MotorSpeed(bounds=(-5, 5)))[::order]
    np.testing.assert_array_equal(make_problem(limits=limits).input_bounds, [[-2, 5], [-2, 5]])


BREACHES = {
    "few coefficients": (
        {"design": DesignSpace(duration=10, samples=40, spline=Spline(coefficients=5))},
        "trajectory.spline.coefficients",
        "at rest at both ends needs at least 6 coefficients, got 5",
    ),
    "few coefficients without rest": (
        {"design": DesignSpace(duration=10, samples=40, spline=Spline(coefficients=3), rest_to_rest=False)},
        "trajectory.spline.coefficients",
        "needs at least 4 coefficients, got 3",
    ),
    "limit twice": ({"limits": (SPEED, SPEED)}, "limits.wheel_speed", "given twice"),
    "start outside": (
        {"design": DesignSpace(duration=10, start=StartPose(x=2))},
        "limits.workspace",
        "lies outside the workspace",
    ),
    "no rest possible": ({"limits": (WheelSpeed(bounds=(1, 2)),)}, "limits.wheel_speed", "excludes 0"),
    "unbounded wheels": ({"limits": (BOX, ACCELERATION)}, "limits", "nothing bounds wheel_speed"),
    "no limits": ({"limits": ()}, "limits", "nothing bounds wheel_speed"),
    "many segments": (
        {"measurement": Displacements(segments=41)},
        "measurement.segments",
        "at most as many segments as there are samples (40), got 41",
    ),
    "one heading": (
        {"measurement": Displacements(segments=1, regressor="heading")},
        "measurement.segments",
        "expected at least 2 segments, got 1",
    ),
    "one heading of both": (
        {"measurement": Displacements(segments=1, regressor="both")},
        "measurement.segments",
        "expected at least 2 segments, got 1",
    ),
    "no noise": ({"criterion": E()}, "measurement.noise", "position noise is needed"),
    "unknown scale": (
        {
            "criterion": E(scaling={"c21": 1.0, "c22": 1.0, "c11": 1.0}),
            "measurement": Displacements(segments=4, noise={"position": 0.1}),
        },
        "criterion.scaling.c11",
        "the parameters are c21, c22",
    ),
    "robot without coefficients": (
        {"model": Unicycle()},
        "measurement.kind",
        "unicycle is not",
    ),
    "robot without wheels": ({"model": Unicycle()}, "limits.wheel_speed", "its inputs are speed, yaw_rate"),
}


@pytest.mark.parametrize(("overrides", "key", "message"), BREACHES.values(), ids=BREACHES.keys())
def test_every_breach_of_a_valid_problem_is_named(overrides, key, message):
    assert message in flaws_of(**overrides)[key]


def test_all_flaws_are_listed_at_once():
    found = flaws_of(
        design=DesignSpace(duration=10, samples=40, spline=Spline(coefficients=4), start=StartPose(x=3)),
        measurement=Displacements(segments=50),
        limits=(BOX, ACCELERATION),
    )
    assert set(found) == {
        "trajectory.spline.coefficients",
        "limits.workspace",
        "limits",
        "measurement.segments",
    }


def test_a_flawed_problem_is_the_users_mistake():
    with pytest.raises(UserMistake, match="limits: nothing bounds wheel_speed_left; add wheel_speed"):
        make_problem(limits=())


def test_one_segment_is_enough_for_positions():
    assert make_problem(measurement=Displacements(segments=1)).measurement.segment_count(40) == 1


def test_a_problem_is_copied_to_workers_whole():
    problem = make_problem(model=DifferentialDrive(wheel_radius=RADIUS, track=TRACK), name="copied")
    drive = random_drive(problem, 0)
    before = evaluate(problem, drive)
    copy = pickle.loads(pickle.dumps(problem))
    assert copy.name == "copied"
    assert (copy.model, copy.design, copy.limits) == (problem.model, problem.design, problem.limits)
    assert evaluate(copy, drive).objective == before.objective


def test_limits_may_come_as_a_list():
    assert make_problem(limits=[SPEED, BOX]).limits == (SPEED, BOX)
