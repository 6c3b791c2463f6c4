"""Logs whose standard errors, or estimates, are known to be wrong: what a sound estimator makes of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from simulated import (
    course,
    log_of,
    logged_problem,
    options,
    truth_of,
)

from oed.estimation import Calibration, calibrate
from oed.estimation.assessment.cautions import OF_LAGS, TURNS_IN_SHORT_SEGMENTS
from oed.robots.models import Unicycle

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
@pytest.mark.xfail(strict=True, reason="issue 54: usual drift is assumed of robots with states of their own")
def test_errors_of_a_lagging_robot_without_drift_are_as_large_as_its_standard_errors():
    squares = []
    for seed in range(4):
        drive = course(LAGGING, LAGS, seconds=20.0, period=0.05, inputs=commands(seed))
        log = log_of(drive, noise=(0.002, 0.005), every=2, seed=seed)
        calibration = calibrate(logged_problem(model=LAGGING), [log], options(clock_offset=False))
        deviations = np.sqrt(np.diag(calibration.covariance))[: len(LAGS)]
        squares.append(((calibration.values[: len(LAGS)] - LAGS) / deviations) ** 2)
    assert 0.6 < np.sqrt(np.mean(squares)) < 1.5


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
    assert not {OF_LAGS, TURNS_IN_SHORT_SEGMENTS} & set(calibration.notes)
