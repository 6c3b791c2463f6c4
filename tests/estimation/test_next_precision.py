"""The precision that is predicted for a drive, against estimates from logs of robots that drift."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pulls import SETS, require_pulls
from simulated import Course, course, fit_of, lasting, log_of, search_of, twists_of, unknowns_of
from twin_drives import arcs
from windowed import drifting

from oed.estimation.methods.drift_rates import USUAL
from oed.estimation.methods.gauss_markov import GaussMarkov
from oed.estimation.methods.log_errors import ErrorSizes
from oed.estimation.methods.whole_logs import WholeLogs
from oed.kernel.dynamics.trajectory import Trajectory
from oed.logs.log import Log
from oed.records.record import EstimateRecord
from oed.records.stored.estimate import FoundLasting
from oed.robots.models import DifferentialDrive
from oed.study.study import Study
from oed.workflow.estimate_logs import estimate
from oed.workflow.next_precision import planned_information
from oed.workflow.planned_logs import Logging
from oed.workflow.studies import parse_study

STUDY = """
format: 1
name: A robot in a room
robot: {kind: differential_drive, wheel_radius: 33 mm, track: 160 mm}
trajectory: {duration: 20 s, samples: 40}
measurement: {kind: poses, noise: {position: 1 mm, heading: 0.3 deg}}
limits: {wheel_speed: 6 rad/s}
calibration: {noise: constant, sensor_place: [], clock_offset: false}
"""
ROBOT = DifferentialDrive(wheel_radius=0.033, track=0.16)
TRUE = np.array(ROBOT.nominal)
NOISE = (0.001, 0.005)
STEP = 0.1
LASTS = (0.02, 4.0)


@pytest.fixture(scope="module")
def study() -> Study:
    return parse_study(STUDY)


@pytest.fixture(scope="module")
def trajectory() -> Trajectory:
    knots = np.concatenate([np.zeros(3), np.linspace(0, 20, 8), np.full(3, 20.0)])
    speeds = np.random.default_rng(4).uniform(-5, 5, (10, 2)) * np.r_[0.0, np.ones(8), 0.0][:, None]
    return Trajectory(knots, 3, speeds, np.array([0.1, -0.2, 0.3]), 40)


def driven(drive: Course, seed: int) -> Log:
    return log_of(drifting(drive, TRUE, np.sqrt(USUAL), seed), noise=NOISE, seed=seed, name=str(seed))


def as_course(log: Log) -> Course:
    return Course(ROBOT, log.pose_times, log.inputs_between(log.pose_times), log.poses)


def as_csv(drive: Course, log: Log, path: Path) -> Path:
    held = [*drive.inputs.tolist(), ["", ""]]
    rows = [[time, *inputs, *pose] for time, inputs, pose in zip(drive.times, held, log.poses, strict=True)]
    text = "\n".join(",".join(map(str, row)) for row in rows)
    path.write_text(f"t,wheel_speed_right,wheel_speed_left,x,y,heading\n{text}\n")
    return path


@pytest.fixture(scope="module")
def found(study: Study, tmp_path_factory: pytest.TempPathFactory) -> EstimateRecord:
    folder = tmp_path_factory.mktemp("drifting")
    drives = [course(ROBOT, TRUE, seconds=20.0, seed=seed) for seed in range(3)]
    logs = [as_csv(one, driven(one, seed), folder / f"{seed}.csv") for seed, one in enumerate(drives)]
    return estimate(study, logs)


def test_a_planned_log_is_what_the_robot_would_log(trajectory):
    (log,) = Logging(STEP, ("heading", "x", "y")).of_drive(ROBOT, trajectory)
    assert len(log.pose_times) == 201
    held = np.repeat(trajectory.inputs, 5, axis=0)
    path = arcs(trajectory.start, twists_of(ROBOT, held, TRUE), np.diff(log.pose_times))
    np.testing.assert_allclose(log.poses, path[:, [2, 0, 1]], atol=1e-12)
    np.testing.assert_allclose(np.diff(log.integrals_at(log.pose_times), axis=0), 0.1 * held, atol=1e-12)


def test_poses_are_planned_as_seldom_as_they_were_logged(trajectory):
    (log,) = Logging(2.0).of_drive(ROBOT, trajectory)
    assert trajectory.period < 2.0
    assert len(log.pose_times) == 11


@pytest.mark.slow
def test_more_drift_is_less_information(study, trajectory, found):
    worse = found.model_copy(
        update={"drift": found.drift.model_copy(update={"ahead": 3 * found.drift.ahead})}
    )
    less = np.linalg.inv(planned_information(trajectory, found, study))
    more = np.linalg.inv(planned_information(trajectory, worse, study))
    assert np.linalg.eigvalsh(more - less).min() > -1e-9 * np.trace(less)
    assert more[0, 0] > 2 * less[0, 0]


@pytest.mark.slow
def test_errors_are_as_large_as_predicted_where_robots_drift(study, trajectory, found):
    predicted = np.linalg.inv(planned_information(trajectory, found, study))
    (planned,) = Logging(STEP).of_drive(ROBOT, trajectory)
    drive, unknowns = as_course(planned), unknowns_of(ROBOT)
    seconds = found.segments.seconds or np.inf
    fits = [fit_of([driven(drive, seed)], unknowns, seconds) for seed in range(SETS)]
    errors = np.array([one.values - TRUE for one in fits])
    require_pulls(errors, [predicted] * SETS)
    # By white noise alone the same drive would be thought far better than it is.
    white = np.mean(
        [np.abs(errors[k]) < 1.96 * np.sqrt(np.diag(one.inverse)) for k, one in enumerate(fits)], axis=0
    )
    assert np.all(white < 0.7)


@pytest.mark.slow
def test_errors_are_as_large_as_predicted_where_those_of_readings_last(study, trajectory, found):
    size, seconds = LASTS
    sizes = {one.about: one.at_rest for one in found.noise}
    noise = found.model_copy(update={"lasting": FoundLasting(position=size, seconds=seconds)})
    still = [one.model_copy(update={"per_speed": 0.0, "per_yaw_rate": 0.0}) for one in found.noise]
    segments = found.segments.model_copy(update={"seconds": None})
    whole = noise.model_copy(update={"noise": still, "segments": segments})
    predicted = np.linalg.inv(planned_information(trajectory, whole, study))
    (planned,) = Logging(STEP).of_drive(ROBOT, trajectory)
    drive, known = as_course(planned), GaussMarkov(sizes, {"position": size}, seconds)
    white = (sizes["position"], sizes["heading"])
    logs = [lasting(log_of(drive, noise=white, seed=seed), size, seconds, seed) for seed in range(SETS)]
    fits = [
        search_of([one], unknowns_of(ROBOT), specified=known.noises, correlated=known).fit() for one in logs
    ]
    errors = np.array([one.values - TRUE for one in fits])
    require_pulls(errors, [predicted] * SETS)
    # By white noise alone the same drive would be thought far better than it is.
    alone = whole.model_copy(update={"lasting": FoundLasting(seconds=seconds)})
    short = np.linalg.inv(planned_information(trajectory, alone, study))
    assert np.all(np.mean(np.abs(errors) < 1.96 * np.sqrt(np.diag(short)), axis=0) < 0.7)


@pytest.mark.slow
def test_errors_are_as_large_as_predicted_where_logs_were_fitted_by_likelihood(tmp_path, trajectory):
    study = parse_study(STUDY.replace("calibration: {", "calibration: {method: likelihood, "))
    drives = [course(ROBOT, TRUE, seconds=12.0, period=2 * STEP, seed=seed) for seed in range(2)]
    logs = [as_csv(one, driven(one, seed), tmp_path / f"{seed}.csv") for seed, one in enumerate(drives)]
    found = estimate(study, logs)
    predicted = np.linalg.inv(planned_information(trajectory, found, study))
    (planned,) = Logging(2 * STEP).of_drive(ROBOT, trajectory)
    drive = as_course(planned)
    fits = [fit_of([driven(drive, seed)], unknowns_of(ROBOT), 2.0) for seed in range(10)]
    white = {one.about: one.at_rest for one in found.noise}
    sizes = ErrorSizes.of(white, 20.0).known({one.name: one.size for one in found.log_errors})
    each = [WholeLogs(one, sizes).found() for one in fits]
    errors = np.array([one.fit.values - TRUE for one in each]) / np.sqrt(np.diag(predicted))
    # A deviation of 10 is known to 22 %, and the sizes by a factor.
    ratios = np.sqrt(np.mean(errors**2, axis=0))
    assert np.all((ratios > 0.6) & (ratios < 1.5))
