"""A step that fails after a search: the record says so, and has the results of the search."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NoReturn

import pytest
from studies import saved_study, write_study

from oed.cli import main
from oed.foundation.errors import Failure
from oed.optimize import Ipopt
from oed.records.record import Record, load_record
from oed.workflow import runner
from oed.workflow.after_search import Failures
from oed.workflow.runner import run
from oed.workflow.sweep import parse_axis, sweep
from oed.workflow.sweep import run as sweeping

LINE = """\
format: 1
name: A line
system:
  kind: equations
  inputs: {x: ""}
  parameters: {a: 1, b: 1}
  outputs: {y: a + b * x}
experiment: {candidates: {rows: {x: [0, 1]}}}
weights: {total: 10, most: 10}
measurement: {kind: responses, noise: {y: 1}}
criterion: {kind: D, scaling: none}
bound: true
validation: {replicates: 100}
seed: 3
"""
"""A study whose search is only one of weights; half of the trials at each end are best."""
ROBUST_POINTS = """\
format: 1
name: A decay whose rate is hardly known
system:
  kind: equations
  inputs: {t: s}
  parameters: {k: 4 1/s}
  outputs: {y: exp(-k * t)}
experiment: {points: 1, inputs: {t: [0 s, 5 s]}}
measurement: {kind: responses, noise: {y: 0.01}}
uncertainty: {k: [1 1/s, 7 1/s]}
robust: {kind: scenarios, objective: mean, draws: 400}
criterion: {kind: D, scaling: none}
solvers: [{kind: ipopt, starts: 1, perturbations: 0}]
"""
GYROSCOPE = """\
format: 1
name: Gyroscope with an unknown scale
robot: {kind: differential_drive, wheel_radius: 5 cm, track: 20 cm}
trajectory: {duration: 10 s, samples: 10, spline: {degree: 3, coefficients: 6}, start: free}
measurement:
- {kind: poses, quantities: [x, y], noise: {position: 1 cm}}
- {kind: yaw_rate, noise: 1 deg/s, scale: unknown}
limits: {wheel_speed: 10 rad/s, wheel_acceleration: 20 rad/s^2}
estimate: [wheel_radius_right, wheel_radius_left, track, scale]
criterion: {kind: D, scaling: none}
bound: true
solvers: [{kind: ipopt, starts: 1, perturbations: 0}]
"""
STEPS = [
    ("_certificate", "bound"),
    ("certified", "gap to the bound"),
    ("compared", "comparison with baselines"),
    ("tried", "check of robustness"),
    ("robustness", "report of robustness"),
    ("simulated", "validation"),
    ("driven_in_physics", "trial on a simulated robot"),
    ("nominal_search", "search without back-off"),
    ("scores_by_criteria", "score by further criteria"),
    ("selection_of", "table of readings"),
]


def breaking(error: Exception) -> Any:
    """A step that raises an error."""

    def step(*_: object, **__: object) -> NoReturn:
        raise error

    return step


def weights_of(record: Record) -> Any:
    (result,) = record.results
    return result.drive.trajectory.weights


@pytest.mark.slow
@pytest.mark.parametrize(("name", "step"), STEPS)
@pytest.mark.parametrize("error", [ValueError("'scale' is not in list"), Failure("no room")])
def test_results_are_saved_whichever_step_fails_after_the_search(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, step: str, error: Exception
):
    # The step is called in both ways that a record is made: while the run is under way, and at its end.
    monkeypatch.setattr(runner, name, breaking(error))
    study = saved_study(tmp_path, LINE)
    record = run(study, tmp_path / "out", workers=1)
    assert load_record(tmp_path / "out").data == json.loads(record.to_json())
    assert record.best is not None
    assert list(weights_of(record)) == pytest.approx([5, 5], rel=1e-6)
    (sentence,) = record.failures
    assert step in sentence
    assert str(error) in sentence


@pytest.mark.slow
def test_later_steps_are_done_after_one_that_failed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(runner, "_certificate", breaking(ValueError("no")))
    record = run(saved_study(tmp_path, LINE), workers=1)
    assert record.certificate is None
    assert [entry.name for entry in record.validation.results] == ["ipopt"]


@pytest.mark.slow
def test_a_failed_step_makes_the_command_fail_and_the_report_names_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr(runner, "simulated", breaking(ValueError("no such estimator")))
    file = write_study(tmp_path, LINE)
    assert main(["run", str(file), "--out", str(tmp_path / "out"), "--quiet", "--workers", "1"]) == 1
    said = capsys.readouterr()
    assert "no such estimator" in said.err
    assert "standard error" in said.out
    assert "no such estimator" in (tmp_path / "out" / "report.md").read_text()


@pytest.mark.slow
def test_a_report_that_fails_costs_neither_answer_nor_record(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr("oed.report.write_report", breaking(ValueError("no figure")))
    file = write_study(tmp_path, LINE)
    assert main(["run", str(file), "--out", str(tmp_path / "out"), "--quiet", "--workers", "1"]) == 1
    said = capsys.readouterr()
    assert "no figure" in said.err
    assert f"oed report {tmp_path / 'out'}" in said.err
    assert "standard error" in said.out
    assert load_record(tmp_path / "out").best is not None


@pytest.mark.slow
def test_a_search_that_fails_after_another_costs_no_result(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def second_fails(problem: Any, options: Ipopt, **given: Any) -> Any:
        if options.name == "second":
            raise ValueError("no step")
        return solve(problem, options, **given)

    solve = runner.solve
    monkeypatch.setattr(runner, "solve", second_fails)
    solvers = "[{kind: ipopt, name: first}, {kind: ipopt, name: second}, {kind: ipopt, name: third}]"
    record = run(saved_study(tmp_path, f"{LINE}solvers: {solvers}\n"), tmp_path / "out", workers=1)
    assert [result.name for result in record.results] == ["first", "third"]
    (sentence,) = record.failures
    assert "second" in sentence


def test_a_first_search_that_fails_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(runner, "solve", breaking(ValueError("no step")))
    with pytest.raises(ValueError, match="no step"):
        run(saved_study(tmp_path, LINE), workers=1)


def test_an_interrupt_is_no_failure_of_a_step():
    failures = Failures()

    def interrupted() -> NoReturn:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        failures.attempt("bound", interrupted, None)
    assert failures.sentences == []


@pytest.mark.slow
def test_robust_study_without_states_keeps_its_design(tmp_path: Path):
    """Robots' courses were drawn of systems that have none, after the search."""
    study = saved_study(tmp_path, ROBUST_POINTS)
    record = run(study, tmp_path / "out", workers=1)
    assert record.failures == []
    assert record.robustness.bundles == []
    (setting,) = record.best.drive.trajectory.inputs
    # Mean of log (t exp(-k t))^2 over k from 1 to 7, 4 on average.
    assert setting.item() == pytest.approx(0.25, rel=1e-3)
    assert main(["report", str(tmp_path / "out")]) == 0


@pytest.mark.slow
@pytest.mark.parametrize("criterion", ["D", "A"])
def test_bound_of_an_estimated_sensor_constant_is_unknown_not_a_crash(tmp_path: Path, criterion: str):
    """Names of sensors' constants were looked up among the robot's parameters."""
    study = saved_study(tmp_path, GYROSCOPE.replace("kind: D", f"kind: {criterion}"))
    record = run(study, workers=1)
    assert record.failures == []
    assert record.certificate is None
    assert record.best is not None
    assert any("no bound is known" in note for note in record.notes)


@pytest.mark.slow
def test_a_sweep_keeps_the_points_beside_one_that_meets_a_defect(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    def one_fails(study: Any, *given: Any, **more: Any) -> Record:
        if study.seed == 2:
            raise ValueError("no such point")
        return run(study, *given, **more)

    monkeypatch.setattr(sweeping, "run", one_fails)
    file = write_study(tmp_path, LINE)
    swept = sweep(file, [parse_axis("seed=1,2")], tmp_path / "out", workers=1)
    good, bad = swept.found.points
    assert (good.design, bad.design) == ("ipopt", None)
    assert "no such point" in bad.message
