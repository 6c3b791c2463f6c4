"""What wheels do between two poses: whatever their rate, estimates of logs without drift have no bias, and
95 % intervals hold the truth.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from simulated import (
    ROBOT,
    TRUTH,
    course,
    fit_of,
    log_of,
    logged_problem,
    options,
    several,
    truth_of,
    unknowns_of,
)

from oed.estimation import calibrate
from oed.estimation.prediction.layout import cut
from oed.estimation.prediction.logged_readings import LoggedReadings
from oed.estimation.prediction.segments import nuisances_of
from oed.logs.log import Log
from oed.robots.models import Mecanum, Model, Tricycle
from oed.robots.sensors.biased import YawRate
from oed.robots.sensors.mounting import PLACE

PERIOD, SECONDS = 0.02, 20.0
"""Time between readings of the wheels, and of a drive [s]."""
RATES = (10, 5, 2, 1)
"""Poses a second."""
COUNT = 12
"""Logs of each robot."""
LEAST, BIAS = 0.9, 0.75
"""Share of 95 % intervals that has to hold the truth, and most standard errors that errors are on average."""
KEYS: dict[str, dict[str, Any]] = {
    "joint": {"segment": "log", "noise": "specified"},
    "likelihood": {"method": "likelihood"},
}
"""Options of the calibration by its method; of the unknowns the robot's alone, so that errors are small."""
SETTINGS = [
    *(("joint", robot, rate) for robot in ("differential", "tricycle", "mecanum") for rate in RATES),
    *(("likelihood", robot, rate) for robot in ("differential", "tricycle", "mecanum") for rate in (2, 1)),
]
ROBOTS: dict[str, tuple[Model, dict[str, float]]] = {
    "differential": (ROBOT, TRUTH),
    "tricycle": (Tricycle(wheel_radius=0.05, wheelbase=0.3), {}),
    "mecanum": (Mecanum(wheel_radius=0.05, half_wheelbase_plus_half_track=0.3), {}),
}


def lively(model: Model, seed: int) -> np.ndarray:
    """Inputs (N, inputs) of waves up to 0.35 Hz, as a robot has that turns often between two poses."""
    rng, times = np.random.default_rng([seed, 7]), PERIOD * (np.arange(round(SECONDS / PERIOD)) + 0.5)
    columns = []
    for entry in model.inputs:
        waves = 2 * np.pi * (rng.uniform(0.03, 0.35, 4)[:, None] * times + rng.uniform(0, 1, 4)[:, None])
        sizes = rng.normal(size=4)
        swing = (sizes / np.abs(sizes).sum()) @ np.sin(waves)
        columns.append(3 + 6 * swing if entry.quantity == "wheel_speed" else 0.5 * swing)
    return np.column_stack(columns)


@cache
def drive(robot: str, seed: int):
    model, truth = ROBOTS[robot]
    return course(
        model,
        truth_of(model, **truth),
        seconds=SECONDS,
        period=PERIOD,
        seed=seed,
        inputs=lively(model, seed),
    )


def log_at(robot: str, rate: int, seed: int) -> Log:
    return log_of(drive(robot, seed), every=round(1 / rate / PERIOD), noise=(0.002, 0.005), seed=seed)


def errors_of(method: str, robot: str, rate: int) -> tuple[np.ndarray, np.ndarray]:
    """Errors in standard errors, and half the widths of 95 % intervals in these, (COUNT, p)."""
    model, truth = ROBOTS[robot]
    problem, true, errors, widths = logged_problem(model=model), truth_of(model, **truth), [], []
    keys = options(clock_offset=False, sensor_place=(), **KEYS[method])
    for seed in range(COUNT):
        done = calibrate(problem, [log_at(robot, rate, seed)], keys)
        errors.append((done.values - true) / np.sqrt(np.diag(done.covariance)))
        widths.append(np.full(len(true), done.covariances[0].half_width))
    return np.array(errors), np.array(widths)


@pytest.mark.slow
@pytest.mark.parametrize(("method", "robot", "rate"), SETTINGS)
def test_intervals_hold_the_truth_where_the_robot_does_not_drift(method: str, robot: str, rate: int):
    errors, widths = errors_of(method, robot, rate)
    assert np.mean(np.abs(errors) <= widths) >= LEAST
    assert np.abs(errors.mean(axis=0)).max() < BIAS


@pytest.mark.parametrize("rate", RATES)
def test_steps_between_poses_span_no_more_than_the_time_between_two_readings_of_the_wheels(rate: int):
    layout = cut([log_at("differential", rate, 0)], 4.0, [0.0])
    finer = layout.in_small_steps
    assert layout.steps.max() == pytest.approx(1 / rate)
    assert finer.steps.max() == pytest.approx(PERIOD)
    assert finer.times[:, :: layout.parts_of_steps] == pytest.approx(layout.times)


def test_wheels_logged_as_often_as_poses_are_driven_from_pose_to_pose():
    layout = cut(several(1, seconds=4.0), np.inf, [0.0])
    assert layout.in_small_steps is layout


def test_what_wheels_do_in_the_seconds_between_two_poses_is_followed_exactly():
    log = log_of(drive("differential", 0), every=100)
    fit = fit_of([log])
    assert fit.values == pytest.approx(list(TRUTH.values()), rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [0.5, 2.0])
def test_readings_of_periods_are_the_means_of_what_is_driven_in_them(seconds: float):
    """A gyroscope's mean over a period is that of the turn, however the period is divided."""
    log = log_of(drive("differential", 0), every=round(seconds / PERIOD))
    layout = cut([log], np.inf, [0.0], (("gyro", YawRate(noise=0.01)),))
    bias = nuisances_of(layout.sensors)
    constants = {**PLACE, **{constant.name: constant.unit for constant in bias}}
    unknowns = replace(unknowns_of(), constants=constants, sits=(0.0,) * len(constants))
    readings = LoggedReadings.of(layout, unknowns, np.zeros(1))(truth_of(ROBOT, **TRUTH), log.poses[:1])
    turned = np.cumsum(readings[0, :-1, 3] * layout.steps[0])
    assert turned == pytest.approx(readings[0, 1:, 2] - readings[0, 0, 2], abs=1e-9)
