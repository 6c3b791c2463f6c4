"""Driven paths scored like designs: the log of a design is worth the design."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from driven_robot import ROOM_STUDY, write_log

from oed.foundation.errors import LogError
from oed.kernel.evaluation import evaluate
from oed.logs import Log
from oed.records.record import Record
from oed.study.study import Study
from oed.uncertainty.departures import violation_probability
from oed.workflow.driven import driven_parts, score_logs, score_path
from oed.workflow.runner import run
from oed.workflow.studies import parse_study

# Half the time, a third of the samples, and two poses: the bound of such a drive is soon found.
SHORT = ROOM_STUDY.replace("duration: 20 s\n  samples: 40", "duration: 10 s\n  samples: 14")
SHORT = SHORT.replace("{kind: poses,", "{kind: poses, every: 7,")
STUDY = f"{SHORT}solvers: []\nbaselines: [square, figure_eight]\nbound: true\nlog: {{}}\n"


@pytest.fixture(scope="module")
def study() -> Study:
    return parse_study(STUDY)


@pytest.fixture(scope="module")
def saved(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("designs")


@pytest.fixture(scope="module")
def record(study: Study, saved: Path) -> Record:
    """What is in the folder, its bound with it."""
    return run(study, saved, workers=1)


def log_of(study: Study, record: Record, name: str, path: Path) -> Path:
    return write_log(path, study.problem, record.result(name).drive.trajectory, {})


@pytest.mark.slow
def test_the_log_of_a_drive_is_worth_the_drive(study, record, saved, tmp_path):
    trajectory = record.result("square").drive.trajectory
    found = score_logs(study, [log_of(study, record, "square", tmp_path / "log.csv")], saved)
    # The log is moved to its first motion, so that its last periods differ from the drive's by standing.
    assert found.first.result.objective == pytest.approx(
        evaluate(study.problem, trajectory).objective, rel=0.05
    )
    best = record.best
    assert found.best == (best.name, best.objective)
    assert found.first.efficiency == pytest.approx(found.first.result.objective / best.objective)
    assert found.bound == record.certificate.upper_bound >= best.objective
    assert found.first.share_of_bound == pytest.approx(found.first.result.objective / found.bound)
    assert 0 < found.first.share_of_bound <= found.first.efficiency


@pytest.mark.slow
def test_what_is_found_in_the_log_is_told(study, record, saved, tmp_path, capsys):
    file = log_of(study, record, "square", tmp_path / "log.csv")
    file.write_text(file.read_text().rsplit(",", 2)[0])
    found = score_logs(study, [file], saved).data["findings"]
    assert [(one["log"], one["name"]) for one in found if one["name"] == "cut_off"] == [("log", "cut_off")]


@pytest.mark.slow
def test_long_logs_are_cut_to_the_duration_of_the_study(study, record, tmp_path):
    path = log_of(study, record, "square", tmp_path / "log.csv")
    rows = [line.split(",") for line in path.read_text().splitlines()]
    more = [[str(float(row[0]) + 10.0), *row[1:]] for row in rows[1:]]
    path.write_text("\n".join(",".join(row) for row in [*rows[:-1], *more]) + "\n")
    found = score_logs(study, [path])
    assert [one.name for one in found.paths] == ["log part 1", "log part 2"]
    assert found.best is None
    # No record says the bound, and it is the same.
    assert found.bound == pytest.approx(record.certificate.upper_bound, rel=1e-9)


def test_a_path_file_is_scored_as_it_is(study, record, saved):
    found = score_path(study, saved / "figure_eight.csv", saved)
    assert found.first.result.objective == pytest.approx(record.result("figure_eight").objective)
    assert found.first.efficiency is not None


def test_records_of_other_problems_are_not_compared_with(record, saved):
    other = parse_study(STUDY.replace("33 mm", "34 mm"))
    assert score_path(other, saved / "square.csv", saved).first.efficiency is None


def test_a_robot_that_never_moves(study, tmp_path):
    rows = ["t,wheel_speed_right,wheel_speed_left,x,y,heading"]
    rows += [f"{0.1 * k},0,0,0,0,0" for k in range(50)]
    (tmp_path / "log.csv").write_text("\n".join(rows))
    with pytest.raises(LogError, match=r"never (turn|moves)"):
        score_logs(study, [tmp_path / "log.csv"])


@pytest.mark.slow
def test_a_drive_whose_readings_are_chosen_is_not_compared_with_designs_that_read_all(record, saved):
    chosen = parse_study(f"{STUDY}weights: {{readings: 2}}\n")
    found = score_path(chosen, saved / "square.csv", saved)
    assert found.best is None
    assert found.design is None


@pytest.mark.slow
def test_a_robust_study_tells_how_many_robots_leave(study, record, saved):
    robust = parse_study(f"{STUDY}uncertainty: {{x: 90 cm}}\nrobust: {{kind: chance, draws: 400}}\n")
    data = score_path(robust, saved / "square.csv", saved).data
    (found,) = data["robustness"]["results"]
    trajectory = record.result("square").drive.trajectory
    expected = violation_probability(robust.problem, trajectory, draws=400, seed=robust.seed)
    assert (found["probability"], found["by_limit"]) == (expected.probability, expected.by_limit)
    assert 0 < found["probability"] < 1
    assert expected.sentence in data["message"]
    assert score_path(study, saved / "square.csv", saved).data["robustness"] is None


@pytest.mark.slow
def test_shares_are_plain_data(study, record, saved, tmp_path):
    data = score_logs(study, [log_of(study, record, "square", tmp_path / "log.csv")], saved).data
    assert data["worth"][0]["name"] == "log"
    assert np.isfinite(data["upper_bound"])


def test_a_steered_wheel_alone_moves_nothing(study):
    steered = parse_study(
        STUDY.replace(
            "{kind: differential_drive, wheel_radius: 33 mm, track: 160 mm}",
            "{kind: tricycle, wheel_radius: 33 mm, wheelbase: 200 mm}",
        )
        .replace(
            "wheel_speed: 6 rad/s\n", "wheel_speed: 6 rad/s\n  steering_angle: 60 deg\n  steering_rate: 1\n"
        )
        .replace("[square, figure_eight]", "[]")
    )
    times = np.arange(0.0, 10.0, 0.1)
    speeds = np.where(times[:-1] < 4, 0.0, 3.0)
    integrals = np.column_stack([np.append(0, np.cumsum(0.1 * speeds)), 0.3 * times])
    log = Log("run", "run.csv", times, integrals, times, np.zeros((len(times), 3)))
    ((_, trajectory, seconds),) = driven_parts(steered, log)
    assert seconds == pytest.approx(5.9, abs=0.11)
    assert trajectory.inputs[0, 0] == pytest.approx(3.0)
