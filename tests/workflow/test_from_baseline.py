"""A baseline that is better than what the study's splines can drive: the search goes on from it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from oed.kernel.solution import Solution, Status, scored
from oed.optimize import Silent
from oed.records.record import Record
from oed.records.stored.simulation import Tried
from oed.robots.baselines import baselines
from oed.study.study import Study
from oed.workflow import from_baseline, runner
from oed.workflow.from_baseline import left_out, searched_from_baseline
from oed.workflow.runner import run
from oed.workflow.studies import Work, parse_study

DRIFTING = """
format: 1
name: coarse splines
robot: {preset: turtlebot3_burger}
trajectory: {duration: 20 s, samples: SAMPLES, spline: {degree: DEGREE, coefficients: 6}}
measurement: {kind: poses, noise: {position: 1 mm, heading: 0.2 deg}, drift: usual}
limits:
  workspace: {kind: rectangle, x: [-2 m, 2 m], y: [-1.5 m, 1.5 m]}
criterion: {kind: E, scaling: relative}
solvers: [SOLVER]
baselines: [straight_and_spin]
seed: 0
"""
ROBUST = """
uncertainty: {wheel_radius_right: 2 %, wheel_radius_left: 2 %, track: 4 %}
robust: {kind: chance, confidence: 0.97, draws: 300, compare: false}
"""
NOTHING: tuple[list[Solution], bool] = ([], False)
IPOPT = "{kind: ipopt, starts: 2, perturbations: 0}"


def study(*, samples: int = 30, degree: int = 3, solver: str = IPOPT, more: str = "") -> Study:
    text = DRIFTING.replace("SAMPLES", str(samples)).replace("DEGREE", str(degree))
    return parse_study(text.replace("SOLVER", solver) + more)


def violation(record: Record, name: str) -> Tried:
    return next(one for one in record.robustness.results if one.name == name)


@pytest.mark.slow
@pytest.mark.parametrize("more", ["", ROBUST], ids=["nominal", "robust"])
def test_a_search_beats_the_baselines_of_a_robot_that_drifts(more: str):
    record = run(study(samples=16, more=more), workers=1)
    best, baseline = record.best, record.result("straight_and_spin")
    assert (best.kind, best.name) == ("ipopt", "ipopt_from_straight_and_spin")
    assert best.feasible
    assert not more or violation(record, best.name).interval[1] <= 0.03
    assert best.objective > baseline.objective > record.result("ipopt").objective
    assert "Begun from the baseline straight and spin" in best.message
    # What has its length is compared with the drive that is reported.
    same = [one.path_length for one in record.results if one.name.endswith("_same_length")]
    assert same == pytest.approx([best.path_length] * len(same), rel=1e-4)


@pytest.fixture(scope="module")
def baseline() -> Solution:
    """The best of the usual drives."""
    (solution,) = baselines(study().problem, "straight_and_spin")
    return solution


def searched(own: Study, best: Solution | None) -> tuple[list[Solution], bool]:
    return searched_from_baseline(Work(own, seed=0, workers=1, progress=Silent()), best)


class TestWithoutSuchASearch:
    @pytest.fixture(autouse=True)
    def nothing_is_searched(self, monkeypatch: pytest.MonkeyPatch) -> None:
        def solve(*_: Any, **__: Any) -> Solution:
            raise AssertionError("nothing is to be searched")

        monkeypatch.setattr(from_baseline, "solve", solve)

    def test_where_there_is_no_drive(self):
        assert searched(study(), None) == NOTHING

    def test_where_the_best_drive_is_a_searchs(self, baseline):
        assert searched(study(), replace(baseline, kind="ipopt")) == NOTHING

    def test_where_no_search_goes_on_from_a_drive(self, baseline):
        assert searched(study(solver="{kind: genetic, generations: 2}"), baseline) == NOTHING

    @pytest.mark.parametrize("other", ["without_drift: true", "criterion: D"])
    def test_where_the_only_search_is_for_something_else(self, other: str, baseline):
        assert searched(study(solver=f"{{kind: ipopt, {other}}}"), baseline) == NOTHING

    def test_where_splines_would_have_too_many_coefficients(self, baseline):
        large = study(samples=400)
        assert searched(large, baseline) == NOTHING
        (note,) = left_out(large, baseline)
        assert "1602 coefficients, and 500 is the most" in note
        assert left_out(study(), baseline) == []

    def test_where_inputs_are_held_over_every_piece(self, baseline):
        assert searched(study(degree=0), baseline) == NOTHING


def test_a_worse_drive_is_left_out(baseline, monkeypatch: pytest.MonkeyPatch):
    drive = baseline.trajectory
    slower = scored(study().problem, replace(drive, coefficients=0.5 * drive.coefficients), "slower")
    assert slower.evaluation.feasible
    monkeypatch.setattr(from_baseline, "solve", lambda *_, **__: slower)
    assert searched(study(), baseline) == NOTHING


def test_a_search_without_a_drive_leaves_the_baseline_the_best(baseline, monkeypatch: pytest.MonkeyPatch):
    nothing = replace(baseline, status=Status.INFEASIBLE, trajectory=None, evaluation=None)
    monkeypatch.setattr(from_baseline, "solve", lambda *_, **__: nothing)
    assert searched(study(), baseline) == NOTHING


def test_what_is_better_is_kept_where_an_interrupt_ends_the_search(baseline, monkeypatch: pytest.MonkeyPatch):
    def solve(*_: Any, **__: Any) -> Solution:
        return replace(baseline, status=Status.INTERRUPTED)

    worse = replace(baseline, evaluation=replace(baseline.evaluation, objective=0.0))
    monkeypatch.setattr(from_baseline, "solve", solve)
    (better,), interrupted = searched(study(), worse)
    assert interrupted
    assert better.trajectory is baseline.trajectory
    assert searched(study(), baseline) == ([], True)


@pytest.mark.slow
def test_an_unsafe_baseline_is_not_the_best_of_an_interrupted_run(monkeypatch: pytest.MonkeyPatch):
    # A back-off of one standard deviation: baselines are so large that too many robots leave.
    room = "[-0.5 m, 0.5 m], y: [-0.4 m, 0.4 m]"
    text = study(samples=10, more=ROBUST.replace("draws", "beta: 1, draws")).text
    small = parse_study(text.replace("[-2 m, 2 m], y: [-1.5 m, 1.5 m]", room))

    (large,) = baselines(small.problem, "straight_and_spin")
    slow = replace(large.trajectory, coefficients=0.3 * large.trajectory.coefficients)
    found = replace(scored(small.problem, slow, "ipopt"), kind="ipopt")

    def solve(*_: Any, **__: Any) -> Solution:
        raise KeyboardInterrupt

    monkeypatch.setattr(runner, "search", lambda *_: ([found], False))
    monkeypatch.setattr(from_baseline, "solve", solve)
    record = run(small, workers=1)
    assert violation(record, "straight_and_spin").probability > 0.03
    assert record.best.name == "ipopt"
