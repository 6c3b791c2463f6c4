"""Steering readings that leave what a robot can do, and zeros that are far off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from simulated import course, log_of, logged_problem, options, truth_of

from oed.estimation import Calibration, calibrate
from oed.estimation.preprocessing.steering_checks import steered_beyond
from oed.foundation.errors import LogError
from oed.kernel.problem import Problem
from oed.logs.log import Log
from oed.robots.limits import SteeringAngle
from oed.robots.models import Ackermann, Model, Tricycle

CAR, TRUCK = Ackermann(wheel_radius=0.05, wheelbase=0.4), Tricycle(wheel_radius=0.05, wheelbase=0.4)


def steered(model: Model, off: float, clock: float = 0.0, seconds: float = 30.0) -> Log:
    """A log whose steering encoder shows `off` [deg] straight ahead."""
    inputs = course(model, truth_of(model), seconds=seconds).inputs * [1.0, 1.5]
    drive = course(model, truth_of(model), seconds=seconds, inputs=inputs)
    log = log_of(drive, noise=(0.002, 0.003), offset=clock)
    turned = np.outer(log.input_times - log.input_times[0], [0.0, np.radians(off)])
    return replace(log, integrals=log.integrals + turned)


def estimated(problem: Problem, log: Log) -> Calibration:
    """Of segments whose length is not looked for."""
    return calibrate(problem, [log], options(segment=3.0))


def doubted(model: Model, off: float, seconds: float = 30.0) -> dict[str, str]:
    """What an estimate from such a log is doubted for, or the log refused."""
    try:
        found = estimated(logged_problem(model=model), steered(model, off, seconds=seconds))
    except LogError as error:
        return {issue.key: issue.message for issue in error.issues}
    doubts = {one.parameter: one.message for one in found.doubts}
    return doubts | {one.name: one.message for log in found.logs for one in log.findings if one.doubtful}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("model", "off", "key"),
    [
        (CAR, -45.0, "steering_angle"),
        (CAR, 30.0, "steering_angle"),
        (TRUCK, 30.0, "steering_angle"),
        (TRUCK, 180.0, "steering_angle"),
        # Of this the nominal sizes explain enough for a fit, which finds the offset.
        (TRUCK, -135.0, "poorly_explained"),
    ],
)
def test_a_missing_zero_is_named(model: Model, off: float, key: str):
    found = doubted(model, off)
    assert "`zero`" in found[key]
    said = float(found[key].partition("its zero seems to be ")[2].partition(" deg")[0])
    assert said == pytest.approx(off, abs=2) or abs(said) == pytest.approx(abs(off), abs=2) == 180
    if key == "poorly_explained":
        assert "say in the log's `zero`" in found["steering_offset"]


@pytest.mark.slow
def test_half_a_turn_is_the_same_to_a_car_but_beyond_what_it_steers():
    assert "`zero`" in doubted(CAR, 180.0, seconds=15.0)["steered_beyond"]


@pytest.mark.slow
def test_a_missing_zero_is_named_where_clocks_are_apart():
    with pytest.raises(LogError, match=r"steering_angle: its zero seems to be \S+ deg off straight ahead"):
        estimated(logged_problem(model=TRUCK), steered(TRUCK, 60.0, clock=0.4, seconds=15.0))


@pytest.mark.slow
@pytest.mark.parametrize(("model", "off"), [(CAR, -3.0), (TRUCK, -3.0), (CAR, 0.0)])
def test_a_small_one_is_what_is_estimated(model: Model, off: float):
    found = estimated(logged_problem(model=model), steered(model, off, seconds=12.0))
    place = found.parameters.index("steering_offset")
    error = np.sqrt(found.covariance[place, place])
    assert abs(found.values[place] + np.radians(off)) < 4 * error + 1e-3
    assert not [one for log in found.logs for one in log.findings if one.doubtful]


@pytest.mark.parametrize(
    ("model", "most", "off", "beyond"),
    [
        (TRUCK, 40.0, 0.0, False),
        (TRUCK, 40.0, 60.0, True),
        (TRUCK, None, 120.0, False),
        (CAR, None, 0.0, False),
        (CAR, None, 180.0, True),
        (CAR, 40.0, 80.0, True),
        (CAR, 5.0, 0.0, True),
    ],
)
def test_angles_beyond_what_the_robot_steers(model: Model, most: float | None, off: float, beyond: bool):
    limits = [] if most is None else [SteeringAngle(bounds=f"{most} deg")]
    findings = steered_beyond(steered(model, off, seconds=15.0), model, limits).findings
    assert [(one.name, one.doubtful) for one in findings] == [("steered_beyond", True)] * beyond
    assert all("steering_angle is beyond the robot's" in one.message for one in findings)


@pytest.mark.slow
def test_angles_beyond_them_are_said_with_the_estimate():
    problem = logged_problem(model=CAR)
    limits = (*(one for one in problem.limits if one.name != "steering_angle"), SteeringAngle(bounds="4 deg"))
    (log,) = estimated(replace(problem, limits=limits), steered(CAR, 0.0, seconds=12.0)).logs
    assert "steered_beyond" in {one.name for one in log.findings}
