"""Criterion I of a task: the mean variance of what is predicted all along drives of the user's own."""

from __future__ import annotations

import numpy as np
import oracle
import pytest
from builders import problem_of, random_drive
from test_prediction import GEOMETRY, POSES, twist_of

from oed.foundation.errors import PartError, ProblemError
from oed.kernel.criteria import I, Leg, TaskDrive
from oed.kernel.evaluation import evaluate
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
    problem = problem_of(measurement=POSES, criterion=I(task=[task_of(5, 20)]))
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
    with pytest.raises(ProblemError) as caught:
        problem_of(measurement=POSES, criterion=I(task=["drive.csv", other]))
    assert [issue.key for issue in caught.value.issues] == [
        ("criterion", "task", 0),
        ("criterion", "task", 1, "inputs"),
    ]
