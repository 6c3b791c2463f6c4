"""Studies without drift also know the standard errors of their drives with usual drift."""

from __future__ import annotations

import pytest
from builders import random_drive

from oed.kernel.evaluation import evaluate
from oed.kernel.problem import Problem
from oed.kernel.solution import scored
from oed.records.outcomes import result_of
from oed.workflow.runner import run
from oed.workflow.studies import parse_study
from oed.workflow.usual_drift import usual_drift_deviations

POSES = "{kind: poses, noise: {position: 1 cm, heading: 1 deg}}"
GYROSCOPE = "{kind: yaw_rate, noise: 1 deg/s}"
STUDY = """
format: 1
name: A robot whose drift nobody gives
robot: {kind: differential_drive, wheel_radius: 4.9 cm, track: 18 cm}
trajectory: {duration: 4 s, samples: 8, spline: {degree: 3, coefficients: 7}}
measurement: %s
limits:
  wheel_speed: 10 rad/s
  workspace: {kind: rectangle, x: [-1 m, 1 m], y: [-1 m, 1 m]}
solvers: []
"""


def problem_of(measurement: str, more: str = "") -> Problem:
    return parse_study(STUDY % measurement + more).problem


def usual(sensor: str) -> str:
    return f"{sensor.rstrip('}')}{'}' * (sensor.count('}') - 1)}, drift: usual}}"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("measurement", "drifting"),
    [
        (POSES, usual(POSES)),
        (f"[{POSES}, {GYROSCOPE}]", f"[{usual(POSES)}, {GYROSCOPE}]"),
        (f"[{GYROSCOPE}, {POSES}]", f"[{GYROSCOPE}, {usual(POSES)}]"),
    ],
    ids=["poses", "poses, gyroscope", "gyroscope, poses"],
)
def test_usual_drift_deviations_are_those_of_the_study_with_usual_drift(measurement: str, drifting: str):
    problem = problem_of(measurement)
    drive = random_drive(problem, 0)
    deviations = usual_drift_deviations(problem, scored(problem, drive, "random"))
    expected = evaluate(problem_of(drifting), drive).standard_deviations
    assert deviations == pytest.approx(expected, rel=1e-12)
    alone = evaluate(problem, drive).standard_deviations
    assert all(deviations[name] > size for name, size in alone.items())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("measurement", "more"),
    [
        (usual(POSES), ""),
        (GYROSCOPE, "estimate: [wheel_radius_right]\n"),
        ("{kind: displacements, segments: 4, noise: {position: 1 cm, heading: 1 deg}}", ""),
        (POSES, "weights: {readings: 4}\n"),
    ],
    ids=["drift", "gyroscope", "regression", "chosen readings"],
)
def test_usual_drift_deviations_are_empty_where_drift_is_given_or_does_not_go(measurement: str, more: str):
    problem = problem_of(measurement, more)
    solution = scored(problem, random_drive(problem, 0), "random")
    assert usual_drift_deviations(problem, solution) == {}


@pytest.mark.slow
def test_a_record_holds_what_no_drive_identifies_under_drift_as_none():
    problem = problem_of(POSES)
    solution = scored(problem, random_drive(problem, 0), "random")
    result = result_of(solution, None, usual_drift={"track": float("inf"), "wheel_radius_left": 1e-3})
    assert result.usual_drift_deviations == {"track": None, "wheel_radius_left": 1e-3}


@pytest.mark.slow
def test_every_drive_of_a_run_has_standard_errors_with_usual_drift():
    record = run(parse_study(f"{STUDY % POSES}baselines: [square, figure_eight]\n"), workers=1)
    drifting = problem_of(usual(POSES))
    for result in record.results:
        expected = evaluate(drifting, result.drive.trajectory).standard_deviations
        known = {name: size for name, size in result.usual_drift_deviations.items() if size is not None}
        assert known == pytest.approx({name: expected[name] for name in known})
        assert known
