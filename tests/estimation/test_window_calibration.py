"""The methods on windows from the outside: options in, a calibration out."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import scipy
from pulls import REFUSED
from simulated import ROBOT, TRUTH, course, log_of, logged_problem, options, truth_of
from windowed import TRICYCLE, TRICYCLE_TRUTH, drifting

from oed.estimation import Calibration, CalibrationOptions, calibrate
from oed.estimation.methods.drift_rates import USUAL
from oed.foundation.errors import ProblemError
from oed.logs.log import Log
from oed.records.calibration_outcome import estimate_of

pytestmark = pytest.mark.slow

TRUE = truth_of(ROBOT, **TRUTH)
PLACE = (0.03, -0.02, 0.05)
USUALLY = np.sqrt(USUAL)


def quick(**keys: Any) -> CalibrationOptions:
    return options(replicates=100, **keys)


@cache
def noisy_logs() -> list[Log]:
    drives = [
        drifting(course(seconds=30, period=0.2, seed=seed), TRUE, (0.002, 0.001, 0.01), seed)
        for seed in range(3)
    ]
    return [
        log_of(drive, place=PLACE, offset=0.03, noise=(0.001, 0.004), seed=seed, name=f"drive {seed}")
        for seed, drive in enumerate(drives)
    ]


@cache
def found_by(method: str) -> Calibration:
    return calibrate(logged_problem(), noisy_logs(), quick(method=method))


@pytest.fixture
def logs() -> list[Log]:
    return noisy_logs()


@pytest.fixture(params=["gls", "two_stage"])
def found(request) -> Calibration:
    return found_by(request.param)


def test_it_finds_the_truth_within_its_errors(found):
    errors = list(found.standard_deviations.values())
    assert np.all(np.abs(found.values - TRUE) < 4 * np.array(errors))
    np.testing.assert_allclose(found.values, TRUE, rtol=0.01)
    assert found.fit.values[3:6] == pytest.approx(PLACE, abs=0.005)
    assert found.fit.clock_offsets == pytest.approx([0.03] * 3, abs=0.02)


@pytest.mark.slow
def test_windows_are_two_seconds_long_unless_told_otherwise(found, logs):
    assert found.segmenting is None
    assert found.fit.layout.seconds == 2.0
    method = "gls" if found.fit.notes else "two_stage"
    chosen = quick(method=method, segment=3.75, sensor_place=(), clock_offset=False)
    assert calibrate(logged_problem(), logs[:1], chosen).fit.layout.count == 8


def test_slow_poses_make_longer_windows():
    log = log_of(course(seconds=100), every=5, noise=(0.001, 0.004))
    assert calibrate(logged_problem(), [log], quick(method="gls")).fit.layout.seconds == pytest.approx(4.0)


def test_everything_after_the_fit_works_as_for_any_other(found):
    data = json.loads(json.dumps(estimate_of(found).plain(), allow_nan=False, default=float))
    assert data["converged"]
    assert data["segments"]["count"] == 45
    assert len(data["left_out"]) == 3
    assert {entry["name"] for entry in data["parameters"]} == set(TRUTH)
    ways = {"information", "drift", "sandwich", "bootstrap"}
    assert set(data["parameters"][0]["standard_errors"]) == ways
    for one in data["left_out"]:
        assert one["mean"]["after"]["rmse_position"] < 0.5 * one["mean"]["before"]["rmse_position"]
    assert {one.name for one in found.diagnostics} == {"whiteness", "outliers", "logs_agree"}
    assert len(data["residuals"]) == 9
    assert len(data["residuals"][0]["value"]) == 15


@pytest.mark.slow
@pytest.mark.parametrize("method", ["gls", "two_stage"])
def test_intervals_of_two_short_logs_of_a_robot_that_drifts_cover(method: str):
    # Four windows. If 95 % of intervals hold the truth, fewer do so once in a hundred times.
    pulls, count = [], 20
    for seed in range(count):
        drives = [
            drifting(course(seconds=5.0, seed=one), TRUE, USUALLY, one) for one in (2 * seed, 2 * seed + 1)
        ]
        logs = [
            log_of(one, noise=(0.0005, 0.003), seed=2 * seed + k, name=str(k)) for k, one in enumerate(drives)
        ]
        asked = quick(method=method, sensor_place=(), clock_offset=False)
        found = calibrate(logged_problem(), logs, asked)
        reach = found.covariances[0].half_width * np.sqrt(np.diag(found.covariance))
        pulls.append((found.values - TRUE) / reach)
    assert np.all(np.sum(np.abs(pulls) < 1, axis=0) >= scipy.stats.binom.ppf(0.01, count, 0.95))
    # Nor are they larger than what half of an interval is 1.96 times of.
    assert np.all(np.sum((1.96 * np.array(pulls)) ** 2, axis=0) < scipy.stats.chi2.isf(REFUSED, count))


@pytest.mark.slow
def test_weighed_windows_leave_nothing():
    found = found_by("gls")
    assert all(one.passed for one in found.diagnostics), [one.message for one in found.diagnostics]
    assert any("drift, as the windows show it" in note for note in found.notes)


@pytest.mark.slow
def test_noise_may_be_kept_from_growing_with_speed(logs):
    found = calibrate(logged_problem(), logs[:2], quick(method="gls", noise="constant"))
    assert found.fit.noises["position"].per_speed == 0
    assert found.fit.noises["position"].at_rest == pytest.approx(0.001, rel=0.5)


@pytest.mark.parametrize("method", ["gls", "two_stage"])
@pytest.mark.slow
def test_coefficients_are_estimated_where_they_are_asked_for(method, logs):
    names = ("c11", "c12", "c21", "c22")
    found = calibrate(logged_problem(estimate=names), logs[:2], quick(method=method))
    assert found.parameters == names
    assert found.fit.unknowns.place == ("sensor_x", "sensor_heading")
    assert any("sensor_y cannot be separated" in note for note in found.notes)
    radius, _, track = TRUE
    assert found.values[0] == pytest.approx(radius / track, rel=0.01)


def test_a_tricycle_by_windows():
    log = log_of(course(TRICYCLE, TRICYCLE_TRUTH, seconds=40, period=0.2), noise=(0.001, 0.004))
    found = calibrate(logged_problem(model=TRICYCLE), [log], quick(method="gls"))
    np.testing.assert_allclose(found.values, TRICYCLE_TRUTH, rtol=0.02, atol=0.002)
    with pytest.raises(ProblemError, match="tricycle has no coefficients"):
        calibrate(logged_problem(model=TRICYCLE), [log], quick(method="two_stage"))


@pytest.mark.parametrize("method", ["gls", "two_stage"])
@pytest.mark.slow
def test_stated_noise_is_used(method, logs):
    found = calibrate(logged_problem(), logs, quick(method=method, noise="specified", clock_offset=False))
    assert found.fit.noises["position"].at_rest == pytest.approx(0.002)
    assert found.fit.noises["heading"].at_rest == pytest.approx(0.005)


@pytest.mark.parametrize("method", ["gls", "two_stage"])
@pytest.mark.slow
def test_options_that_do_not_suit_windows_are_refused(method, logs):
    with pytest.raises(ProblemError, match=r"calibration\.loss: loss: huber"):
        calibrate(logged_problem(), logs, quick(method=method, loss="huber", clock_offset=False))
    flat = [replace(log, poses=log.poses[:, :2], quantities=("x", "y")) for log in logs]
    if method == "two_stage":
        with pytest.raises(ProblemError, match=r"calibration\.method: "):
            calibrate(logged_problem(), flat, quick(method=method, clock_offset=False))
    with pytest.raises(ProblemError, match=r"calibration\.segment: 3 windows are too few"):
        calibrate(logged_problem(), logs, quick(method=method, segment="log", clock_offset=False))
