"""Searches whose integration steps are too coarse for what they find."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import oed
from oed.kernel.evaluation import evaluate
from oed.kernel.scorer import score
from oed.kernel.solution import Status
from oed.optimize import _search, enough_steps
from oed.optimize.selection import select
from oed.optimize.solver import Context

SWING = """format: 1
name: Swing
system:
  kind: equations
  states: {place: 0 m, speed: 0 m/s}
  inputs: {push: m/s^2}
  parameters: {stiff: 4 1/s^2, gain: 1}
  derivatives: {place: speed, speed: gain * push - stiff * place}
  outputs: {seen: place}
  substeps: SUBSTEPS
experiment: {duration: 8 s, samples: 8, inputs: {push: [-1 m/s^2, 1 m/s^2]}}
limits: [{kind: always, name: narrow, of: place, range: [-15 cm, 15 cm]}]
measurement: {kind: outputs, noise: {seen: 1 mm}}
criterion: D
baselines: []
solvers: [{kind: ipopt, starts: 2, perturbations: 0}]
seed: 0
"""

WEIGHTED = """
format: 1
name: Swing with chosen readings
system:
  kind: equations
  substeps: 1
  states: {x: 1, v: 0 1/s}
  derivatives: {x: v, v: -w^2 * x - c * v}
  parameters: {w: 1.2 1/s, c: 0.3 1/s}
  outputs: {x: x}
experiment: {duration: 14 s, samples: 8, trials: 1}
measurement: {kind: outputs, noise: {x: 0.1}}
weights: {readings: 2}
criterion: {kind: CRITERION}
"""


def study(substeps: int) -> oed.Study:
    return oed.parse_study(SWING.replace("SUBSTEPS", str(substeps)))


def farthest(drive: oed.Trajectory) -> float:
    """Of the swing, in closed form."""
    place, speed, seen = 0.0, 0.0, [0.0]
    times = np.linspace(0, drive.period, 2001)[1:]
    for (push,) in drive.inputs:
        off = place - push / 4
        seen += list(np.abs(push / 4 + off * np.cos(2 * times) + speed / 2 * np.sin(2 * times)))
        end = 2 * drive.period
        place, speed = (
            push / 4 + off * np.cos(end) + speed / 2 * np.sin(end),
            speed * np.cos(end) - 2 * off * np.sin(end),
        )
    return max(seen)


@pytest.mark.slow
def test_a_search_ends_with_steps_on_which_its_design_no_longer_depends():
    problem = study(1).problem
    solution = oed.solve(problem, study(1).solvers[0], workers=1)
    assert "times finer" in solution.detail
    assert solution.evaluation.feasible
    assert farthest(solution.trajectory) == pytest.approx(0.15, rel=2e-3)
    fine = study(40).problem
    assert evaluate(fine, solution.trajectory).objective == pytest.approx(
        solution.evaluation.objective, rel=1e-3
    )
    reached = oed.solve(fine, study(40).solvers[0], workers=1)
    assert "times finer" not in reached.detail
    assert reached.evaluation.objective == pytest.approx(solution.evaluation.objective, rel=0.01)


@pytest.mark.slow
def test_a_search_by_the_study_s_steps_alone_breaks_the_limit():
    """What the search above is spared."""
    problem = study(1).problem
    solver = study(1).solvers[0]
    found = _search(solver, problem, Context(workers=1))
    assert score(problem, found.trajectory).feasible
    assert farthest(found.trajectory) > 0.16


@pytest.mark.slow
def test_a_run_notes_steps_that_were_too_coarse():
    record = oed.run(study(1))
    assert any(note.startswith("The integration steps of the study are coarse") for note in record.notes)


@pytest.mark.slow
def test_a_design_that_exceeds_a_limit_with_fine_steps_is_not_called_converged(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    monkeypatch.setattr(enough_steps, "FINEST_SEARCHED", 1)
    solution = oed.solve(study(1).problem, study(1).solvers[0], workers=1)
    assert not solution.evaluation.feasible
    assert solution.status is Status.INFEASIBLE
    assert "narrow exceeded by" in solution.message
    record = oed.run(study(1), tmp_path / "out")
    assert not record.results[0].feasible


@pytest.mark.slow
def test_a_design_is_kept_where_finer_steps_find_none():
    problem, solver = study(1).problem, study(1).solvers[0]
    coarse = _search(solver, problem, Context(workers=1))
    answers = iter([coarse, replace(coarse, trajectory=None, evaluation=None, status=Status.INTERRUPTED)])
    kept = enough_steps.search_with_enough_steps(
        lambda *_: next(answers), solver, problem, Context(workers=1)
    )
    assert kept.trajectory is coarse.trajectory
    assert kept.status is Status.INTERRUPTED
    assert enough_steps.COARSER in kept.detail


def test_a_search_that_was_interrupted_is_not_taken_up_again():
    problem, seen = study(1).problem, []
    drive = problem.design.trajectory(
        np.full((problem.design.all_coefficients, 1), 0.5), problem.fixed_starts
    )

    def search(*_: object) -> oed.Solution:
        seen.append(1)
        return oed.Solution("ipopt", "ipopt", drive, score(problem, drive), Status.INTERRUPTED)

    enough_steps.search_with_enough_steps(search, study(1).solvers[0], problem, Context(workers=1))
    assert len(seen) == 1


@pytest.mark.parametrize("criterion", ["A", "E"])
def test_weights_are_chosen_and_certified_by_the_steps_of_their_score(criterion: str):
    """Two of eight readings need finer steps than all: the bound was 2e-5 above the score of the best."""
    problem = oed.parse_study(WEIGHTED.replace("CRITERION", criterion)).problem
    solution = oed.solve(problem)
    selected = select(problem, solution.trajectory)
    assert selected is not None
    assert solution.evaluation.steps.times > 16
    assert selected.bound == pytest.approx(solution.evaluation.objective, rel=1e-8)
