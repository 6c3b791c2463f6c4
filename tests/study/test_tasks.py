"""Tasks of a study: trajectory files beside it, whose drives stand in its echo."""

from __future__ import annotations

from pathlib import Path

import pytest

from oed.foundation.errors import StudyError
from oed.kernel.criteria import TaskDrive
from oed.kernel.evaluation import evaluate
from oed.records.path_file import write_trajectory
from oed.robots.baselines import baselines
from oed.study.study import read_study
from oed.study.yaml_source import PlainSource
from oed.workflow.studies import load_study, parse_study

STUDY = """\
format: 1
name: Task
robot: {kind: differential_drive, wheel_radius: 4.9 cm, track: 32 cm}
trajectory: {duration: 6 s, samples: 60, spline: {degree: 3, coefficients: 8}, start: {x: 0 m, y: 0 m}}
measurement: {kind: poses, noise: {position: 1 cm, heading: 1 deg}}
limits:
  wheel_speed: 10 rad/s
  wheel_acceleration: 20 rad/s^2
  workspace: {kind: rectangle, x: [-1 m, 1 m], y: [-1 m, 1 m]}
criterion: {kind: D}
"""
TASK = "criterion: {kind: I, task: [circle.csv]}"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    problem = parse_study(STUDY).problem
    (circle,) = baselines(problem, "circle")
    write_trajectory(tmp_path / "circle.csv", problem, circle.trajectory, circle.evaluation.states)
    (tmp_path / "study.yaml").write_text(STUDY.replace("criterion: {kind: D}", TASK))
    return tmp_path


@pytest.mark.slow
def test_files_are_found_beside_the_study_and_their_drives_are_saved_with_it(folder: Path):
    study = load_study(folder / "study.yaml")
    (task,) = study.problem.criterion.task
    assert isinstance(task, TaskDrive)
    (circle,) = baselines(study.problem, "circle")
    assert task.inputs == pytest.approx(circle.trajectory.inputs)
    assert task.period == pytest.approx(0.1)
    # On its own: no file is opened again.
    again = read_study(PlainSource("echo", "", study.echo()))
    (drive,) = baselines(study.problem, "random")
    values = [evaluate(one.problem, drive.trajectory).objective for one in (study, again)]
    assert values[0] == pytest.approx(values[1], rel=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("none.csv", "criterion.task.0: .*none.csv: no such file"),
        ("bad.csv", "criterion.task.0: .*bad.csv:3: "),
    ],
)
def test_what_cannot_be_read_is_named_by_file_line_and_key(folder: Path, name: str, message: str):
    lines = (folder / "circle.csv").read_text().splitlines(keepends=True)
    lines[2] = lines[2].replace(",", ",x", 1)
    (folder / "bad.csv").write_text("".join(lines))
    text = (folder / "study.yaml").read_text().replace("circle.csv", name)
    (folder / "study.yaml").write_text(text)
    with pytest.raises(StudyError, match=f"study.yaml:\\d+: {message}"):
        load_study(folder / "study.yaml")


@pytest.mark.slow
def test_a_study_that_stands_on_its_own_opens_no_files(folder: Path):
    study = load_study(folder / "study.yaml")
    named = {**study.echo(), "criterion": {"kind": "I", "task": ["circle.csv"]}}
    with pytest.raises(StudyError, match="expected drives as numbers here"):
        read_study(PlainSource("echo", "", named))
