"""Limits on all trials together count each trial as often as its weight says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import oed
from oed.foundation.errors import FileError
from oed.workflow.studies import parse_study

PRICED = """\
format: 1
name: Trials of different price
system:
  kind: equations
  inputs: {x: ""}
  parameters: {a: 1, b: 1}
  outputs: {y: a + b * x}
experiment: {candidates: {rows: {x: [0, 1]}}}
weights: {total: 10, most: 10}
limits: [{kind: budget, name: price, of: 1 + 3 * x, most: 20}]
measurement: {kind: responses, noise: {y: 1}}
criterion: {kind: D, scaling: none}
"""
TANKS = """\
format: 1
name: Trials of different price that take time
system:
  kind: equations
  states: {z: 1}
  inputs: {u: ""}
  parameters: {k: 0.5 1/s, g: 1 1/s}
  derivatives: {z: g * u - k * z}
  outputs: {z: z}
experiment: {candidates: {rows: {u: [0, 1, 2]}}, duration: 2 s, samples: 4}
weights: {of: trials, total: 10, most: 10}
limits: [{kind: budget, name: price, of: 1 + u, most: 30 s}]
measurement: {kind: outputs, noise: {z: 0.1}}
criterion: {kind: D, scaling: none}
"""


def margin_of(evaluation: oed.Evaluation) -> float:
    (found,) = [margin.margin for margin in evaluation.margins if margin.name == "price"]
    return found


def test_evaluation_counts_settings_as_often_as_their_weights():
    problem = parse_study(PRICED).problem
    five = replace(problem.design.only, weights=np.array([5.0, 5.0]))
    evaluation = oed.evaluate(problem, five)
    assert margin_of(evaluation) == pytest.approx(20 - (5 + 4 * 5))
    assert not evaluation.feasible


@pytest.mark.slow
@pytest.mark.parametrize(("most", "expected"), [(20, (20 / 3, 10 / 3)), (100, (5, 5)), (5, (2.5, 0.625))])
def test_weights_are_best_within_the_budget(most: float, expected: tuple[float, float]):
    """D is log(w0 w1): half of the price for each setting, unless the total of 10 is in the way."""
    problem = parse_study(PRICED.replace("most: 20}", f"most: {most}}}")).problem
    solution = oed.solve(problem)
    assert solution.trajectory.weights == pytest.approx(expected, rel=1e-5)
    assert solution.evaluation.feasible
    assert solution.evaluation.objective == pytest.approx(np.log(np.prod(expected)), abs=1e-6)
    bound = oed.bound(problem).upper_bound
    assert solution.evaluation.objective <= bound + 1e-9
    assert bound == pytest.approx(solution.evaluation.objective, rel=1e-5)


def test_weights_are_best_where_a_budget_must_be_earned():
    """w0 - w1 is at most -3 and w0 + w1 at most 10: of w0 w1 the largest is 3.5 times 6.5."""
    text = PRICED.replace("of: 1 + 3 * x, most: 20", "of: 1 - 2 * x, most: -3")
    problem = parse_study(text).problem
    solution = oed.solve(problem)
    assert solution.trajectory.weights == pytest.approx((3.5, 6.5), rel=1e-5)
    assert solution.evaluation.feasible
    assert oed.bound(problem).upper_bound == pytest.approx(solution.evaluation.objective, rel=1e-5)


def test_a_budget_that_nothing_earns_is_an_exceeded_limit():
    text = PRICED.replace("of: 1 + 3 * x, most: 20", "of: 1 + x, most: -3")
    solution = oed.solve(parse_study(text).problem)
    assert not solution.evaluation.feasible
    assert margin_of(solution.evaluation) <= -3


def test_a_single_trial_is_paid_for_once_whatever_is_read_of_it():
    text = TANKS.replace("candidates: {rows: {u: [0, 1, 2]}}, ", "").replace(
        "of: trials, total: 10, most: 10", "total: 2"
    )
    text = text.replace('  inputs: {u: ""}\n', "").replace("g * u", "g").replace("of: 1 + u", "of: z * 0 + 1")
    evaluation = oed.solve(parse_study(text).problem).evaluation
    assert margin_of(evaluation) == pytest.approx(30 - 2)


@pytest.mark.slow
def test_trials_that_take_time_cost_as_often_as_they_are_repeated():
    problem = parse_study(TANKS).problem
    solution = oed.solve(problem)
    weights = solution.trajectory.weights.reshape(3, -1)
    assert np.ptp(weights, axis=1) == pytest.approx(0)
    price = float(weights[:, 0] @ (2.0 * np.array([1, 2, 3])))
    assert price == pytest.approx(30, rel=1e-4)
    assert margin_of(solution.evaluation) == pytest.approx(30 - price, abs=1e-6)
    assert solution.evaluation.feasible


@pytest.mark.parametrize(
    "text",
    [PRICED.replace("total: 10, most: 10", "readings: 10, most: 10"), TANKS.replace("of: trials, ", "")],
)
def test_weights_whose_price_is_not_known_are_refused(text: str):
    with pytest.raises(FileError, match=r"weights: .*budget of price"):
        parse_study(text)


@pytest.mark.slow
def test_candidates_of_no_weight_break_no_limit():
    text = TANKS.replace("limits: [", "limits: [{kind: always, name: low, of: z, range: [0, 1.5]}, ")
    solution = oed.solve(parse_study(text).problem)
    assert solution.evaluation.feasible


def test_weights_leave_out_candidates_that_break_a_limit():
    """Of inputs 0, 1 and 2 the last drives the state to 2.9; 1 leads to 1.63 after two seconds."""
    text = TANKS.replace("limits: [", "limits: [{kind: always, name: low, of: z, range: [0, 1.7]}, ")
    solution = oed.solve(parse_study(text).problem)
    weights = solution.trajectory.weights.reshape(3, -1)
    assert solution.evaluation.feasible
    assert np.isfinite(solution.evaluation.objective)
    assert np.all(weights[:2] > 0.1)
    assert np.all(weights[2] == 0)
