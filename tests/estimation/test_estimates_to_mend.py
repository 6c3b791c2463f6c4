"""Logs whose standard errors, or estimates, are known to be wrong: what a sound estimator makes of them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from simulated import (
    Course,
    arcs,
    course,
    lasting,
    log_of,
    logged_problem,
    options,
    truth_of,
)

from oed.estimation import Calibration, calibrate
from oed.estimation.assessment.cautions import DRIVES_CONTRADICT, OF_LAGS, TURNS_IN_SHORT_SEGMENTS
from oed.robots.models import Mecanum, TractorTrailer, Unicycle

LAGGING = Unicycle(lag_v=0.15, lag_omega=0.25)
LAGS = truth_of(LAGGING, gain_v=0.97, gain_omega=1.04, lag_v=0.16, lag_omega=0.23)


def commands(seed: int, seconds: float = 20.0, period: float = 0.05) -> np.ndarray:
    """Speed and yaw rate (N, 2) of waves of up to 0.35 Hz."""
    rng, times = np.random.default_rng(seed), period * np.arange(round(seconds / period))
    columns = []
    for mean, size in ((0.1, 0.35), (0.0, 1.8)):
        frequencies, phases = rng.uniform(0.03, 0.35, 6), rng.uniform(0, 2 * np.pi, 6)
        parts = rng.normal(size=6)
        waves = np.sin(2 * np.pi * frequencies[:, None] * times + phases[:, None])
        columns.append(mean + size * (parts / np.abs(parts).sum()) @ waves)
    return np.column_stack(columns)


@pytest.mark.slow
@pytest.mark.xfail(
    strict=True,
    raises=AssertionError,
    reason="issue 54: usual drift is assumed of robots with states of their own",
)
def test_errors_of_a_lagging_robot_without_drift_are_as_large_as_its_standard_errors():
    squares = []
    for seed in range(4):
        drive = course(LAGGING, LAGS, seconds=20.0, period=0.05, inputs=commands(seed))
        log = log_of(drive, noise=(0.002, 0.005), every=2, seed=seed)
        calibration = calibrate(logged_problem(model=LAGGING), [log], options(clock_offset=False))
        deviations = np.sqrt(np.diag(calibration.covariance))[: len(LAGS)]
        squares.append(((calibration.values[: len(LAGS)] - LAGS) / deviations) ** 2)
    assert 0.6 < np.sqrt(np.mean(squares)) < 1.5


@cache
def satellite_calibration() -> Calibration:
    """Four drives, two of them straight, by odometry with play and positions with errors that last."""
    robot, period, seconds = Unicycle(omega_per_v=0.0), 0.1, 40.0
    count, logs = round(seconds / period), []
    for drive_number, size in enumerate((0.02, 0.02, 0.08, 0.12)):
        rng = np.random.default_rng([1, drive_number, 9])
        waves = 2 * np.pi * period * np.arange(count) / (13 + 4 * drive_number) + rng.uniform(0, 6)
        inputs = np.column_stack([np.full(count, 0.8), size * np.sin(waves)])
        parameters = truth_of(robot, gain_v=0.957, gain_omega=1.03)
        drive = course(robot, parameters, seconds=seconds, period=period, inputs=inputs)
        seed, name = 10 + drive_number, f"drive {drive_number}"
        log = log_of(drive, noise=(0.003, 0.0), quantities=("x", "y"), seed=seed, name=name)
        log = lasting(log, 0.02, 10.0, seed)
        play, keep = np.zeros(count + 1), np.exp(-period / 0.3)
        for step in range(count):
            play[step + 1] = keep * play[step] + 0.1 * np.sqrt(1 - keep**2) * rng.normal()
        logs.append(replace(log, integrals=log.integrals + np.column_stack([0 * play, play])))
    return calibrate(logged_problem(model=robot), logs, options(clock_offset=False))


@pytest.mark.slow
def test_positions_in_short_segments_identify_no_turning_of_odometry_with_play():
    calibration = satellite_calibration()
    place = calibration.parameters.index("gain_omega")
    reach = calibration.covariances[0].half_width * calibration.standard_deviations["gain_omega"]
    assert abs(calibration.values[place] - 1.03) < reach
    assert any("do not identify gain_omega" in sentence for sentence in calibration.weak_directions)
    assert TURNS_IN_SHORT_SEGMENTS in calibration.notes


@pytest.mark.slow
@pytest.mark.xfail(
    strict=True,
    raises=AssertionError,
    reason="issue 54: segments are not asked to be long enough to show turns",
)
def test_positions_are_cut_into_segments_that_show_turns():
    assert satellite_calibration().standard_deviations["gain_omega"] < 0.1


@cache
def mecanum_calibration(short: float) -> Calibration:
    """Circles driven ahead and sideways, whose sideways motion is `short` of what the wheels say."""
    robot = Mecanum(wheel_radius=0.03, half_wheelbase_plus_half_track=0.2)
    radius, arm, speed, period, count = 0.0325, 0.21, 0.24, 0.2, 80
    logs = []
    for drive_number, (sideways, yaw_rate) in enumerate(((0, 0.4), (0, 0.4), (1, -0.4), (1, 0.4))):
        way = np.array([-1, 1, 1, -1]) if sideways else np.ones(4)
        wheels = speed / radius * way + arm / radius * yaw_rate * np.array([-1, 1, -1, 1])
        twist = [0.0, short * speed, yaw_rate] if sideways else [speed, 0.0, yaw_rate]
        rng = np.random.default_rng([20 + drive_number, 3])
        per_metre, by_turning = np.array([0.003, 0.001, np.radians(0.15)]), np.radians(0.4)
        variances = speed * period * per_metre**2
        variances[2] += abs(yaw_rate) * period * by_turning**2
        twists = np.tile(twist, (count, 1)) + np.sqrt(variances) / period * rng.normal(size=(count, 3))
        times = period * np.arange(count + 1)
        states = arcs((0.3, -0.2, 0.7), twists, np.diff(times))
        drive = Course(robot, times, np.tile(wheels, (count, 1)), states)
        seed, name = 20 + drive_number, f"drive {drive_number}"
        logs.append(log_of(drive, noise=(0.001, 0.0025), seed=seed, name=name))
    return calibrate(logged_problem(model=robot), logs, options(method="likelihood"))


@pytest.mark.slow
@pytest.mark.xfail(
    strict=True, raises=AssertionError, reason="issue 54: errors that last take half of the drives out"
)
def test_likelihood_of_drives_that_contradict_each_other_leaves_room_for_either():
    calibration = mecanum_calibration(0.95)
    reach = calibration.covariances[0].half_width * np.sqrt(calibration.covariance[0, 0])
    assert abs(calibration.values[0] - 0.0325 * 0.975) < reach


@pytest.mark.slow
def test_a_note_says_that_drives_contradict_each_other():
    assert DRIVES_CONTRADICT in mecanum_calibration(0.95).notes
    assert DRIVES_CONTRADICT not in mecanum_calibration(1.0).notes


def nearly_straight(quantities: tuple[str, ...], seed: int = 0, seconds: float = 12.0) -> Calibration:
    """A drive that hardly turns, by odometry whose heading errs by 0.1 rad for 0.3 s."""
    robot, rng, period = Unicycle(), np.random.default_rng([seed, 9]), 0.05
    count = round(seconds / period)
    turning = 0.06 * np.sin(2 * np.pi * period * np.arange(count) / 9 + seed)
    inputs = np.column_stack([np.full(count, 0.6), turning])
    parameters = truth_of(robot, gain_v=0.955, gain_omega=0.96)
    drive = course(robot, parameters, seconds=seconds, period=period, inputs=inputs)
    log = log_of(drive, noise=(0.001, 0.0026), quantities=quantities, seed=seed)
    play, keep = np.zeros(count + 1), np.exp(-period / 0.3)
    for step in range(count):
        play[step + 1] = keep * play[step] + 0.1 * np.sqrt(1 - keep**2) * rng.normal()
    log = replace(log, integrals=log.integrals + np.column_stack([0 * play, play]))
    return calibrate(logged_problem(model=robot), [log], options(clock_offset=False, sensor_place=()))


@pytest.mark.slow
def test_a_note_says_that_drift_of_a_lagging_robot_is_assumed():
    drive = course(LAGGING, LAGS, seconds=20.0, period=0.05, inputs=commands(0))
    log = log_of(drive, noise=(0.002, 0.005), every=2)
    calibration = calibrate(logged_problem(model=LAGGING), [log], options(clock_offset=False))
    assert OF_LAGS in calibration.notes


@pytest.mark.slow
def test_a_note_says_that_short_segments_of_positions_hardly_show_turns():
    assert TURNS_IN_SHORT_SEGMENTS in nearly_straight(("x", "y")).notes


@pytest.mark.slow
def test_an_ordinary_log_has_no_such_notes():
    log = log_of(course(seconds=20.0), noise=(0.002, 0.005))
    calibration = calibrate(logged_problem(), [log], options(clock_offset=False))
    assert not {OF_LAGS, TURNS_IN_SHORT_SEGMENTS, DRIVES_CONTRADICT} & set(calibration.notes)


@pytest.mark.slow
def test_no_note_says_that_drift_is_assumed_where_a_trailer_leaves_it_to_the_logs():
    model = TractorTrailer(wheel_radius=0.05, track=0.2, hitch_offset=0.1, trailer_length=0.3)
    log = log_of(course(model, truth_of(model), seconds=20.0), noise=(0.001, 0.003))
    calibration = calibrate(
        logged_problem(model=model), [log], options(clock_offset=False, covariance="drift")
    )
    assert calibration.covariances[0].name == "drift"
    assert OF_LAGS not in calibration.notes
