"""The precision that is predicted for a drive where other sensors read, against estimates from its logs."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from simulated import Course, course

from oed.kernel.dynamics.trajectory import Trajectory
from oed.logs.sensors import labelled
from oed.records.record import EstimateRecord
from oed.robots.models import DifferentialDrive
from oed.study.study import Study
from oed.workflow.estimate_logs import estimate
from oed.workflow.next_precision import planned_information
from oed.workflow.planned_logs import Logging, Rhythm
from oed.workflow.studies import parse_study

STUDY = """
format: 1
name: A robot among beacons
robot: {{kind: differential_drive, wheel_radius: 33 mm, track: 160 mm}}
trajectory: {{duration: 16 s, samples: 32}}
measurement: [{sensors}]
limits: {{wheel_speed: 6 rad/s}}
log: {{poses: {poses}, sensors: {{{logged}}}}}
calibration: {{segment: log, noise: constant, sensor_place: [], clock_offset: false, covariance: drift}}
"""
POINTS = np.array([[3.0, 0.0], [0.0, 3.0], [-3.0, -3.0]])
PLACES = [[f"{value:g} m" for value in place] for place in POINTS.tolist()]
RANGES = f"{{kind: ranges, beacons: {PLACES}, noise: 1 cm}}"
LANDMARKS = f"{{kind: landmarks, landmarks: {PLACES}, noise: {{range: 1 cm, bearing: 0.5 deg}}}}"
ROUGH = "{kind: poses, quantities: [x, y], noise: {position: 30 cm}}"
BEACONS = "ranges: {columns: [r1, r2, r3]}"
SEEN = 'landmarks: {file: "{stem}_seen.csv", id: id, range: range, bearing: bearing}'
STUDIES = {
    "landmarks": (LANDMARKS, "none", SEEN),
    "poses and ranges": (f"{ROUGH}, {RANGES}", "{x: x, y: y, heading: none}", BEACONS),
}
ROBOT = DifferentialDrive(wheel_radius=0.033, track=0.16)
STEP, SHARE = 0.1, 0.8


def study_of(name: str) -> Study:
    sensors, poses, logged = STUDIES[name]
    return parse_study(STUDY.format(sensors=sensors, poses=poses, logged=logged))


@pytest.fixture(scope="module")
def trajectory() -> Trajectory:
    knots = np.concatenate([np.zeros(3), np.linspace(0, 16, 8), np.full(3, 16.0)])
    speeds = np.array(
        [[0, 0], [5, 5], [5, 2], [2, 5], [-3, 3], [-3, -3], [-5, -1], [5, 1], [4, 4], [0, 0]], float
    )
    return Trajectory(knots, 3, speeds, np.array([0.1, -0.2, 0.3]), 32)


def logged(drive: Course, path: Path, seed: int) -> Path:
    """A log with rough positions and all ranges, and beside it of each landmark what was seen, in 4 of 5
    cases.
    """
    rng = np.random.default_rng(seed)
    away = POINTS - drive.states[:, None, :2]
    ranges = np.linalg.norm(away, axis=-1) + 0.01 * rng.normal(size=(len(away), 3))
    bearings = (
        np.arctan2(away[..., 1], away[..., 0]) - drive.states[:, 2:] + 0.009 * rng.normal(size=ranges.shape)
    )
    bearings = np.angle(np.exp(1j * bearings))
    positions = drive.states[:, :2] + 0.3 * rng.normal(size=(len(away), 2))
    held = [*drive.inputs.tolist(), ["", ""]]
    with path.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["t", "wheel_speed_right", "wheel_speed_left", "x", "y", "r1", "r2", "r3"])
        rows.writerows(
            [t, *u, *p, *r] for t, u, p, r in zip(drive.times, held, positions, ranges, strict=True)
        )
    with path.with_name(f"{path.stem}_seen.csv").open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["t", "id", "range", "bearing"])
        for row, place in zip(*np.nonzero(rng.random(ranges.shape) < SHARE), strict=True):
            rows.writerow([drive.times[row], place + 1, ranges[row, place], bearings[row, place]])
    return path


def estimated(study: Study, drives: list[Course], folder: Path) -> EstimateRecord:
    files = [logged(one, folder / f"{len(drives)}_{seed}.csv", seed) for seed, one in enumerate(drives)]
    return estimate(study, files)


@pytest.mark.slow
@pytest.mark.parametrize("name", STUDIES)
def test_errors_are_those_of_an_estimate_from_logs_of_the_planned_drive(name, trajectory, tmp_path):
    study = study_of(name)
    found = estimated(
        study, [course(ROBOT, np.array(ROBOT.nominal), seconds=16.0, seed=s) for s in (1, 2)], tmp_path
    )
    predicted = np.sqrt(np.diag(np.linalg.inv(planned_information(trajectory, found, study))))
    (planned,) = Logging(STEP).of_drive(ROBOT, trajectory)
    drive = Course(ROBOT, planned.pose_times, planned.inputs_between(planned.pose_times), planned.poses)
    then = estimated(study, [drive], tmp_path)
    # Both at rates of drift that are assumed alike: noise and shares are those that two drives have shown.
    assert found.drift.ahead == pytest.approx(then.drift.ahead)
    np.testing.assert_allclose(predicted, list(then.errors.values()), rtol=0.1)


def test_what_is_planned_to_be_read_is_that_of_the_path_as_often_as_it_was_read(trajectory):
    sensors = tuple(labelled(study_of("landmarks").problem.measurement).items())
    rhythm = Rhythm(0.25, np.array([1.0, 1.0, 0.5, 0.5, 0.0, 0.0]), "poses")
    (log,) = Logging(0.25, ("x", "y", "heading"), sensors, (rhythm,)).of_drive(ROBOT, trajectory)
    (read,) = log.sensors
    assert len(read.times) == len(log.pose_times) == 65
    assert np.isfinite(read.values).sum(axis=0).tolist() == [65, 65, 32, 32, 0, 0]
    away = POINTS - log.poses[:, None, :2]
    bearings = np.arctan2(away[..., 1], away[..., 0]) - log.poses[:, 2:]
    both = np.stack([np.linalg.norm(away, axis=-1), np.angle(np.exp(1j * bearings))], axis=-1).reshape(65, 6)
    there = np.isfinite(read.values)
    np.testing.assert_allclose(read.values[there], both[there], atol=1e-6)
