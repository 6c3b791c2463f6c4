"""Criterion I of a task: the mean variance of what is predicted all along drives of the user's own."""

from __future__ import annotations

import re

import numpy as np
import oracle
import pytest
from builders import problem_of, random_drive
from places import PROBLEMS
from test_prediction import GEOMETRY, POSES, twist_of

import oed
from oed.foundation.errors import PartError, ProblemError, StudyError
from oed.kernel.criteria import I, Leg, TaskDrive
from oed.kernel.evaluation import evaluate
from oed.kernel.scorer import score
from oed.optimize import Ipopt, solve

LEG = Leg(inputs=(5, 4), duration=2)


def task_of(seed: int, periods: int) -> TaskDrive:
    inputs = np.random.default_rng(seed).uniform(-6, 6, (periods, 2))
    return TaskDrive(inputs=inputs.tolist(), period=0.2, start=(0.3, -0.2, 1.1))


def paths(model, task: TaskDrive, parameters: np.ndarray) -> np.ndarray:
    """Poses (N, 3) at the ends of the periods."""
    pose, poses = np.array(task.start), []
    for inputs in task.inputs:
        pose = oracle.advance(pose, twist_of(model, np.array(inputs), parameters), task.period, "arc")
        poses.append(pose)
    return np.array(poses)


@pytest.mark.parametrize(("quantity", "columns"), [("position", slice(0, 2)), ("heading", slice(2, 3))])
def test_the_value_is_the_mean_of_the_propagated_variances(quantity: str, columns: slice):
    tasks = [task_of(1, 7), task_of(2, 11)]
    problem = problem_of(measurement=POSES, criterion=I(task=tasks, quantity=quantity))
    evaluation = evaluate(problem, random_drive(problem, 1))
    covariance, nominal = evaluation.covariances["joint"], np.array(problem.model.nominal, dtype=float)
    variances = []
    for task in tasks:
        rows = oracle.central_difference(
            lambda p, one=task: paths(problem.model, one, p)[:, columns], nominal
        )
        rows = rows.reshape(len(task.inputs), -1, len(nominal))
        variances += list(np.einsum("lci,ij,lcj->l", rows, covariance, rows))
    assert evaluation.objective == pytest.approx(-np.mean(variances), rel=1e-6)


def test_where_a_task_starts_and_how_parameters_are_scaled_do_not_matter():
    task = task_of(3, 9)
    moved = task.model_copy(update={"start": None})
    sizes = dict(zip(GEOMETRY, (1.0, 20.0, 0.3), strict=True))
    values = []
    for criterion in (I(task=[task]), I(task=[moved]), I(task=[task], scaling=sizes)):
        problem = problem_of(measurement=POSES, criterion=criterion)
        values.append(evaluate(problem, random_drive(problem, 2)).objective)
    np.testing.assert_allclose(values, values[0], rtol=1e-8)


def test_a_straight_task_needs_no_track():
    # Straight tasks need drives that leave the track unknown: here straight ones.
    straight = TaskDrive(inputs=[(5, 5)] * 6, period=0.2)
    problem = problem_of(measurement=POSES, criterion=I(task=[straight]))
    drive = random_drive(problem, 4)
    ahead = type(drive).from_samples(np.abs(drive.inputs[:, [0, 0]]), drive.duration, drive.start)
    found = evaluate(problem, ahead)
    assert np.isfinite(found.objective)
    assert not np.isfinite(found.standard_deviations["track"])
    turning = problem_of(measurement=POSES, criterion=I(task=[task_of(1, 7)]))
    assert evaluate(turning, ahead).objective == -np.inf


@pytest.mark.slow
def test_a_drive_that_aims_at_the_task_predicts_it_better_than_a_random_one():
    problem = problem_of(measurement=POSES, criterion=I(task=[task_of(5, 20)]), samples=20)
    found = solve(problem, Ipopt(starts=1, perturbations=0), seed=0, workers=1).evaluation
    assert found.feasible
    assert all(
        found.objective > evaluate(problem, random_drive(problem, seed)).objective for seed in range(5)
    )


@pytest.mark.parametrize("options", [{}, {"task": []}, {"task": [task_of(1, 2)], "test_drive": [LEG]}])
def test_a_task_or_a_test_drive_is_expected(options):
    with pytest.raises(PartError, match="expected test_drive"):
        I(**options)


def test_tasks_of_another_robot_are_issues():
    other = TaskDrive(inputs=[(1, 2, 3)], period=0.1, start=(0, 0))
    elsewhere = TaskDrive(inputs=[(1, 2)], period=0.1, start=(0, 0))
    with pytest.raises(ProblemError, match="expected 3 states, got 2") as caught:
        problem_of(measurement=POSES, criterion=I(task=["drive.csv", other, elsewhere]))
    assert [issue.key for issue in caught.value.issues] == [
        ("criterion", "task", 0),
        ("criterion", "task", 1, "inputs"),
        ("criterion", "task", 2, "start"),
    ]


TANK = """
format: 1
name: tank
system:
  kind: equations
  states: {{temperature: {start}}}
  inputs: {{heat: W}}
  parameters: {{loss: 2 W/K, capacity: 20 kJ/K, room: 293 K}}
  derivatives: {{temperature: (heat - loss * (temperature - room)) / capacity}}
  outputs: {{reading: temperature}}
experiment: {{duration: 4 h, samples: 12, inputs: {{heat: [0 W, 500 W]}}}}
measurement: {{kind: outputs, noise: {{reading: 0.5 K}}}}
estimate: [loss, capacity]
criterion: {{kind: {kind}, scaling: none, quantity: temperature, {aim}}}
"""
HEAT = 300.0


def heated(hours: float, start: float) -> np.ndarray:
    """Derivatives of the temperature by loss and capacity, by the closed form."""
    seconds = 3600.0 * hours

    def temperature(p: np.ndarray) -> np.ndarray:
        limit = 293.0 + HEAT / p[0]
        return np.array([limit + (start - limit) * np.exp(-p[0] / p[1] * seconds)])

    return oracle.central_difference(temperature, np.array([2.0, 20e3]))[0]


@pytest.mark.parametrize(("start", "begun"), [("330 K", 330.0), ("{design: [290 K, 300 K]}", 295.0)])
@pytest.mark.parametrize("hours", [2.0, 200.0])
@pytest.mark.parametrize("kind", ["G", "I"])
def test_predictions_begin_where_experiments_do_in_steps_as_fine(kind, hours, start, begun):
    """All states began at 0, and however long a leg was, it was one step of the integration."""
    aim = f"test_drive: [{{inputs: [{HEAT:g}], duration: {hours:g} h}}]"
    task = f"task: [{{inputs: [[{HEAT:g}], [{HEAT:g}]], period: {hours / 2:g} h}}]"
    problem = oed.parse_study(TANK.format(kind=kind, aim=aim, start=start), "tank.yaml").problem
    found = np.array(problem.objective.rows[0]).ravel()
    np.testing.assert_allclose(found, heated(hours, begun), rtol=1e-5, atol=1e-12)
    if kind == "I":
        problem = oed.parse_study(TANK.format(kind=kind, aim=task, start=start), "tank.yaml").problem
        rows = np.array(problem.objective.rows[0][0])
        each = np.array([heated(hours / 2, begun), heated(hours, begun)])
        np.testing.assert_allclose(rows.T @ rows, each.T @ each / 2, rtol=1e-5, atol=1e-9)


def test_a_task_like_the_experiment_is_predicted_as_it_is_read():
    """In the same steps, with the same error of integration."""
    periods = [[HEAT]] * 12
    aim = f"task: [{{inputs: {periods}, period: 20 min}}]"
    problem = oed.parse_study(TANK.format(kind="I", aim=aim, start="330 K"), "tank.yaml").problem
    held = np.full((problem.design.all_coefficients, 1), HEAT)
    drive = problem.design.trajectory(held, problem.fixed_starts)
    (known,) = score(problem, drive).information.values()
    rows = np.array(problem.objective.rows[0][0])
    np.testing.assert_allclose(rows.T @ rows, known * 0.5**2 / len(periods), rtol=1e-12)


def test_predictions_of_too_many_samples_and_of_no_states_are_issues():
    legs = "test_drive: [{inputs: [300], duration: 50000 h}]"
    periods = "task: [{inputs: [[300], [200]], period: 25000 h}, {inputs: [[300]], period: 1 h}]"
    for kind, aim in (("G", legs), ("I", legs), ("I", periods)):
        with pytest.raises(
            StudyError, match=r"1\.8e\+08 s, more than 100000 samples of 1200 s: predict less"
        ):
            oed.parse_study(TANK.format(kind=kind, aim=aim, start="293 K"), "tank.yaml")
    text = (PROBLEMS / "published" / "box_lucas.yaml").read_text()
    aim = "criterion: {kind: G, test_drive: [{inputs: [60], duration: 1 s}]}"
    with pytest.raises(StudyError, match="predicts states, of which this system has none; use E, D or A"):
        oed.parse_study(re.sub("criterion: .*", aim, text), "box_lucas.yaml")
