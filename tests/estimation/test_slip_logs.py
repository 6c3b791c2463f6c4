"""Logs of a robot whose yaw rate lags: a state that no pose tells, at the beginning of every segment."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from simulated import (
    XYH,
    Course,
    course,
    fit_of,
    log_of,
    logged_problem,
    options,
    rich_inputs,
    truth_of,
    unknowns_of,
)
from studies import saved_study

from oed.estimation import calibrate
from oed.estimation.prediction.layout import cut
from oed.estimation.prediction.logged_readings import further_starts
from oed.estimation.preprocessing.moves import Moves, unexplained
from oed.foundation.errors import ProblemError
from oed.robots.models import DifferentialDrive, SkidSteerSlip
from oed.workflow.estimate_logs import estimate

ROBOT = SkidSteerSlip(
    wheel_radius=0.05, track=0.2, yaw_lag=0.3, track_per_yaw_rate=0.02, track_per_curvature=0.1, x_icr=-0.03
)
TRUTH = {
    "wheel_radius_right": 0.0515,
    "wheel_radius_left": 0.0492,
    "track": 0.213,
    "yaw_lag": 0.42,
    "track_per_yaw_rate": 0.035,
    "track_per_curvature": 0.13,
    "x_icr": -0.045,
}
TRUE = truth_of(ROBOT, **TRUTH)


def driven(seed: int = 0, seconds: float = 12.0, period: float = 0.08) -> Course:
    """A drive that begins at rest."""
    middles = period * (np.arange(round(seconds / period)) + 0.5)
    inputs = rich_inputs(ROBOT, middles, seed) * np.minimum(1.0, middles)[:, None]
    return course(ROBOT, TRUE, seconds=seconds, period=period, inputs=inputs)


def logs_of(count: int = 2, **keys):
    return [log_of(driven(seed), name=str(seed), seed=seed, **keys) for seed in range(count)]


class TestRecovery:
    @pytest.mark.slow
    @pytest.mark.parametrize("seconds", [2.0, 5.0, np.inf])
    def test_in_segments_of_any_length(self, seconds: float):
        drive = driven()
        fit = fit_of([log_of(drive)], unknowns_of(ROBOT), seconds=seconds)
        assert fit.converged
        assert fit.values == pytest.approx(TRUE, rel=1e-7)
        knots = [int(np.argmin(np.abs(drive.times - first))) for first in fit.layout.times[:, 0]]
        assert fit.starts[:, 3] == pytest.approx(drive.states[knots, 3], abs=1e-6)
        assert fit.starts[0, 3] == pytest.approx(0, abs=1e-7)

    @pytest.mark.slow
    def test_by_calibrate(self):
        # Of segments below, where files are read.
        found = calibrate(logged_problem(model=ROBOT), logs_of(offset=0.03), options(segment="log"))
        assert found.values == pytest.approx(TRUE, rel=1e-6)
        # Behind the centre of rotation or ahead of the sensor: that is the same.
        assert any("sensor_x" in note for note in found.notes)
        assert found.own is None
        # What the others say of a log: its yaw rate at the first pose is that of the inputs before it.
        assert max(one.after[0].rmse_position for one in found.cross_validation) < 1e-3

    @pytest.mark.slow
    def test_with_lags_far_from_the_truth(self):
        for lag in (0.05, 1.5):
            far = ROBOT.with_values({"yaw_lag": lag, "track_per_curvature": 0.0})
            fit = fit_of(logs_of(), unknowns_of(far), seconds=4.0)
            assert fit.values == pytest.approx(TRUE, rel=1e-6), lag

    @pytest.mark.slow
    def test_errors_are_as_large_as_they_are_said_to_be(self):
        pulls = []
        for seed in range(6):
            logs = [log_of(driven(seed), noise=(0.002, 0.004), seed=seed)]
            fit = fit_of(logs, unknowns_of(ROBOT), seconds=4.0)
            pulls.append((fit.values - TRUE) / np.sqrt(np.diag(fit.inverse)))
        assert np.sqrt(np.mean(np.square(pulls))) == pytest.approx(1.0, abs=0.35)

    def test_a_yaw_rate_that_is_read_is_a_reading(self):
        log = log_of(driven(), quantities=XYH)
        log = replace(
            log, quantities=(*XYH, "yaw_rate"), poses=np.column_stack([log.poses, driven().states[:, 3]])
        )
        fit = fit_of([log], unknowns_of(ROBOT), seconds=4.0)
        assert fit.values == pytest.approx(TRUE, rel=1e-7)

    @pytest.mark.slow
    def test_of_a_log_in_a_file(self, tmp_path: Path):
        drive = driven()
        held = np.vstack([drive.inputs, drive.inputs[-1:]])
        table = np.column_stack([drive.times, held, drive.states[:, :3]])
        header = "t,wheel_speed_right,wheel_speed_left,x,y,heading"
        np.savetxt(tmp_path / "0.csv", table, delimiter=",", header=header, comments="")
        study = saved_study(
            tmp_path,
            """\
format: 1
name: Logged
robot:
  kind: skid_steer_slip
  wheel_radius: 5 cm
  track: 20 cm
  yaw_lag: 300 ms
  track_per_yaw_rate: 2 cm*s/rad
  track_per_curvature: 10 cm
  x_icr: -3 cm
trajectory: {duration: 10 s, samples: 40, spline: {degree: 3, coefficients: 8}}
measurement: {kind: poses, noise: {position: 2 mm, heading: 5 mrad}}
limits: {wheel_speed: 10 rad/s}
calibration: {segment: 4 s}
""",
        )
        record = estimate(study, [tmp_path / "0.csv"])
        assert record.values == pytest.approx(TRUTH, rel=1e-5)


class TestStarts:
    def test_are_what_the_inputs_before_lead_to(self):
        drive = driven(seconds=8.0)
        layout = cut([log_of(drive, offset=0.4)], 1.0, [0.4])
        found = further_starts(ROBOT, layout, np.array([0.4]), TRUE)
        knots = [int(np.argmin(np.abs(drive.times - first))) for first in layout.times[:, 0]]
        assert found[0] == pytest.approx(0, abs=1e-12)
        assert found[:, 0] == pytest.approx(drive.states[knots, 3], abs=0.01)

    def test_of_inputs_that_were_not_logged(self):
        plain = SkidSteerSlip(wheel_radius=0.05, track=0.2, yaw_lag=0.3)
        layout = cut([log_of(driven(seconds=2.0))], 1.0, [0.0])
        inputs = np.tile([6.0, 2.0], (layout.count, layout.periods, 1))
        found = further_starts(plain, layout, np.zeros(1), np.array(plain.nominal), inputs)
        assert found == pytest.approx(np.ones((2, 1)), abs=1e-12)

    def test_a_pose_has_no_more_to_begin_with(self):
        robot = DifferentialDrive(wheel_radius=0.05, track=0.2)
        layout = cut([log_of(driven(seconds=2.0))], 1.0, [0.0])
        assert further_starts(robot, layout, np.zeros(1), np.array(robot.nominal)).shape == (2, 0)

    def test_moves_are_explained_from_there(self):
        moves = Moves.of(ROBOT.with_values(TRUTH), logs_of(1))
        left = unexplained(moves.measured(), moves.predicted())
        assert max(left.values()) < 0.02


@pytest.mark.slow
@pytest.mark.parametrize("method", ["gls", "two_stage"])
def test_windows_do_not_tell_how_they_begin(method: str):
    with pytest.raises(ProblemError, match=r"the yaw_rate that a window of skid_steer_slip begins with"):
        calibrate(logged_problem(model=ROBOT), logs_of(1), options(method=method))


@pytest.mark.slow
def test_segments_share_no_yaw_rate_with_a_log_that_begins_in_motion():
    drive = driven()
    part = log_of(drive, rows=np.arange(40, len(drive.times)))
    assert cut([part], np.inf, [0.0]).times[0, 0] > 3
    fit = fit_of([part], unknowns_of(ROBOT))
    assert fit.values == pytest.approx(TRUE, rel=1e-7)
    assert fit.starts[0, 3] == pytest.approx(drive.states[40, 3], abs=1e-6)
