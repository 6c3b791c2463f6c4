"""Studies that design no drive: for estimates from logs alone."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from studies import write_study

import oed
from oed.cli import main
from oed.foundation.errors import ProblemError, StudyError
from oed.robots.models import MODELS
from oed.study.starter import IDENTIFIABLE, TYPICAL
from oed.workflow.studies import parse_study

ONLY = """\
format: 1
name: Only estimated
robot: {kind: tricycle, wheel_radius: 5 cm, wheelbase: 40 cm}
measurement: {kind: poses, noise: {position: 2 mm, heading: 5 mrad}}
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return write_study(tmp_path, ONLY, "only.yaml")


@pytest.mark.parametrize("kind", [one.model_fields["kind"].default for one in MODELS if not one.names_code])
def test_any_robot_does_without_limits(kind: str):
    model = next(one for one in MODELS if one.model_fields["kind"].default == kind)
    sizes = "".join(f", {key}: {size}" for key, size in TYPICAL.items() if key in model.model_fields)
    text = ONLY.replace("tricycle, wheel_radius: 5 cm, wheelbase: 40 cm", f"{kind}{sizes}")
    names = IDENTIFIABLE.get(kind)
    study = parse_study(f"{text}estimate: [{', '.join(names)}]" if names else text)
    assert not study.problem.designed
    assert not np.isfinite(study.problem.input_bounds).any()
    with pytest.raises(StudyError, match="trajectory: missing, and so no drive is designed"):
        study.require_designed()


@pytest.mark.slow
def test_what_the_logs_identify_is_looked_at_all_the_same():
    parse_study(ONLY).require_identifiable()
    headings = "{kind: poses, quantities: [heading], noise: {heading: 5 mrad}}"
    study = parse_study(re.sub(r"(?<=measurement: ).*", headings, ONLY))
    with pytest.raises(StudyError, match="measurement: wheel_radius and wheelbase"):
        study.require_identifiable()


def test_limits_need_not_bound_the_steering():
    study = parse_study(f"{ONLY}limits: {{wheel_speed: 5 rad/s}}\n")
    np.testing.assert_array_equal(study.problem.input_bounds, [[-5, 5], [-np.inf, np.inf]])


def test_its_echo_is_the_same_study():
    study = parse_study(ONLY)
    echo = study.echo()
    assert "trajectory" not in echo
    assert parse_study(json.dumps(echo)).echo() == echo
    assert not study.changed(name="Another").problem.designed


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("robust", "{kind: chance}"),
        ("uncertainty", "{wheel_radius: 1 %}"),
        ("solvers", "[{kind: ipopt, starts: 2}]"),
        ("baselines", "[circle]"),
        ("same_length", "true"),
        ("bound", "true"),
        ("validation", "{replicates: 500}"),
        ("physics", "{}"),
    ],
)
def test_nothing_is_asked_of_a_drive(key: str, value: str):
    with pytest.raises(StudyError) as caught:
        parse_study(f"{ONLY}{key}: {value}\n")
    issue = next(one for one in caught.value.issues if "has no `trajectory`" in one.message)
    assert (issue.line, issue.key) == (5, key)


def test_a_trajectory_needs_limits():
    with pytest.raises(StudyError, match="limits: missing"):
        parse_study(f"{ONLY}trajectory: {{duration: 20 s}}\n")


DESIGNING = [
    ["run"],
    ["solve"],
    ["bound"],
    ["plan", "--to", "wheelbase=1 mm"],
    ["sweep", "--over", "limits.wheel_speed=1,2 rad/s"],
]


@pytest.mark.slow
@pytest.mark.parametrize("arguments", DESIGNING, ids=lambda one: one[0])
def test_what_designs_says_what_is_missing(capsys, file: Path, monkeypatch, arguments: list[str]):
    monkeypatch.chdir(file.parent)
    command, *more = arguments
    assert main([command, file.name, *more]) == 2
    said = capsys.readouterr().err
    assert "only.yaml" in said
    assert "trajectory: missing, and so no drive is designed: say how long it takes" in said
    assert "nothing bounds steering_angle; add steering_angle" in said
    assert [one.name for one in file.parent.iterdir()] == ["only.yaml"]


def test_so_does_the_library():
    problem = parse_study(ONLY).problem
    for work in (oed.solve, oed.bound):
        with pytest.raises(ProblemError, match="trajectory: missing"):
            work(problem)


def test_a_log_is_scored_and_no_limits_are_spoken_of(capsys, file: Path):
    times = 0.1 * np.arange(60)
    table = np.column_stack([times, 3 + np.sin(times), 0.3 * np.cos(times), times, times, 0.1 * times])
    header = "t,wheel_speed,steering_angle,x,y,heading"
    np.savetxt(file.with_name("log.csv"), table, delimiter=",", header=header, comments="")
    assert main(["evaluate", str(file), str(file.with_name("log.csv"))]) == 0
    said = capsys.readouterr().out
    assert "log: 5.9 s of motion" in said
    assert "steering offset" in said
    assert "imits" not in said


def test_check_says_what_it_is_for(capsys, file: Path):
    assert main(["check", str(file)]) == 0
    assert (
        "ok (Only estimated; without `trajectory`: for estimates from logs alone)" in capsys.readouterr().out
    )
