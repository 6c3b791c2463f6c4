"""A drive's regressors as functions of the coefficients, against `evaluate` and the NumPy oracle."""

from __future__ import annotations

import pickle
from functools import cache

import numpy as np
import oracle
import pytest
from builders import problem_of
from sample_robots import ROBOTS, TWO_SIDED, Example, cases, draw_inputs

from oed.estimation.prediction.regressors import Regressors
from oed.kernel.dynamics.space import Spline
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.evaluation import evaluate
from oed.kernel.problem import Problem
from oed.robots.sensors import Displacements

SPLINE = Spline(coefficients=8)
robots = pytest.mark.parametrize("example", cases(TWO_SIDED))
RULES = ("arc", "midpoint")


@cache
def make(example: Example = ROBOTS[0], rule: str = "arc", segments=7) -> tuple[Problem, Trajectory]:
    problem = problem_of(
        model=example.model,
        spline=SPLINE,
        integration=rule,
        measurement=Displacements(segments=segments, regressor="both"),
    )
    # Speeds that leave no doubt which side is the outer one.
    inputs = draw_inputs(np.random.default_rng(2), 40)
    return problem, Trajectory.from_samples(inputs, 10.0, (0.2, -0.1, 0.4), rest_to_rest=False)


@cache
def designs_of(example: Example, rule: str) -> tuple[Problem, Trajectory, Regressors]:
    """Of seven segments, which forty samples are no multiple of."""
    problem, drive = make(example, rule)
    return problem, drive, regressors_of(problem, drive)


def regressors_of(problem: Problem, drive: Trajectory) -> Regressors:
    return Regressors(problem.model, problem.measurement, drive)


def oracle_positions(example: Example, problem: Problem, drive: Trajectory, first_stage) -> np.ndarray:
    """Phi_xy with headings integrated from given c11, c12."""
    speeds = np.array([example.effective(row) for row in drive.inputs])
    rates = speeds @ np.asarray(first_stage)
    headings = drive.start[2] + drive.period * np.concatenate([[0.0], np.cumsum(rates)[:-1]])
    edges = problem.measurement.segment_edges(drive.samples)
    rule = problem.design.integration
    return oracle.segment_regressors(speeds, headings, rates, drive.period, edges, rule)[1]


@robots
@pytest.mark.parametrize(("rule", "segments"), [("arc", 7), ("midpoint", 7), ("arc", "samples")])
def test_at_the_nominal_coefficients_they_are_w(example: Example, rule: str, segments):
    problem, drive = make(example, rule, segments)
    found, expected = regressors_of(problem, drive).nominal_designs, evaluate(problem, drive).design_matrices
    assert set(found) == {"heading", "position"}
    for name, design in found.items():
        np.testing.assert_allclose(design, expected[name], rtol=0, atol=1e-11)


@pytest.mark.parametrize("regressor", ["heading", "position"])
def test_both_are_there_whichever_is_measured(regressor: str):
    problem, drive = make()
    measurement = Displacements(segments=7, regressor=regressor)
    found = Regressors(problem.model, measurement, drive).nominal_designs
    np.testing.assert_array_equal(found["heading"], regressors_of(problem, drive).nominal_designs["heading"])
    assert found["position"].shape == (14, 2)


@robots
def test_true_coefficients(example: Example):
    problem, _, found = designs_of(example, "arc")
    model = problem.model
    expected = np.array(model.coefficients(model.nominal))
    np.testing.assert_allclose(found.true["heading"], expected[0], rtol=1e-14)
    np.testing.assert_allclose(found.true["position"], expected[1], rtol=1e-14)
    assert found.names == {"heading": ("c11", "c12"), "position": ("c21", "c22")}


@robots
def test_samples_add_up_to_segments(example: Example):
    for rule in RULES:
        problem, _, found = designs_of(example, rule)
        assert found.per_sample.shape == (40, 2, 2)
        sums = np.add.reduceat(found.per_sample, problem.measurement.segment_edges(40)[:-1], axis=0)
        np.testing.assert_allclose(
            sums.reshape(14, 2), found.nominal_designs["position"], rtol=0, atol=1e-12, err_msg=rule
        )


@robots
def test_they_predict_the_motion(example: Example):
    for rule in RULES:
        problem, drive, found = designs_of(example, rule)
        poses = evaluate(problem, drive).states
        ends = poses[problem.measurement.segment_edges(40)]
        turns = found.nominal_designs["heading"] @ found.true["heading"]
        moves = found.nominal_designs["position"] @ found.true["position"]
        np.testing.assert_allclose(turns, np.diff(ends[:, 2]), atol=1e-12)
        np.testing.assert_allclose(moves.reshape(-1, 2), np.diff(ends[:, :2], axis=0), atol=1e-12)


class TestPredictedHeadings:
    """Phi_xy with the headings that the first stage's estimate predicts [Choi, eq. 16]."""

    @robots
    def test_the_true_estimate_gives_w(self, example: Example):
        for rule in RULES:
            _, _, found = designs_of(example, rule)
            predicted = found.predicted_positions(np.tile(found.true["heading"], (3, 1)))
            assert predicted.shape == (3, 14, 2)
            for each in predicted:
                np.testing.assert_allclose(each, found.nominal_designs["position"], rtol=0, atol=1e-12)

    @robots
    def test_other_estimates_are_the_oracles(self, example: Example):
        for rule in RULES:
            problem, drive, found = designs_of(example, rule)
            rng = np.random.default_rng(0)
            estimates = found.true["heading"] * rng.uniform(0.8, 1.2, (5, 2))
            for each, estimate in zip(found.predicted_positions(estimates), estimates, strict=True):
                expected = oracle_positions(example, problem, drive, estimate)
                np.testing.assert_allclose(each, expected, rtol=0, atol=1e-10)

    @robots
    def test_their_slopes_are_the_papers(self, example: Example):
        # Midpoint rule: d Phi_xy / d c11 = sum T w (-sin, cos)(a) (Q + T w_R / 2), Q the angle turned before.
        problem, drive, found = designs_of(example, "midpoint")
        speeds = np.array([example.effective(row) for row in drive.inputs])
        rates = speeds @ found.true["heading"]
        turned = drive.period * (np.cumsum(rates) - rates / 2)
        directions = drive.start[2] + turned
        edges = problem.measurement.segment_edges(40)[:-1]
        slopes = []
        for side in range(2):
            before = drive.period * (np.cumsum(speeds[:, side]) - speeds[:, side] / 2)
            across = np.column_stack([-np.sin(directions), np.cos(directions)]) * before[:, None]
            rows = drive.period * across[:, :, None] * speeds[:, None, :]
            slopes.append(np.add.reduceat(rows, edges, axis=0).ravel())
        difference = oracle.central_difference(
            lambda estimate: found.predicted_positions(estimate[None, :])[0], found.true["heading"], 1e-6
        )
        np.testing.assert_allclose(difference, np.array(slopes).T, rtol=0, atol=1e-5)

    def test_estimates_do_not_disturb_each_other(self):
        problem, drive = make()
        found = regressors_of(problem, drive)
        estimates = np.random.default_rng(1).uniform(0.2, 0.4, (4, 2))
        together = found.predicted_positions(estimates)
        alone = np.concatenate([found.predicted_positions(row[None, :]) for row in estimates])
        np.testing.assert_array_equal(together, alone)


def test_they_travel_to_workers():
    problem, drive = make()
    found = regressors_of(problem, drive)
    estimates = found.true["heading"][None, :] * 1.1
    before = found.predicted_positions(estimates)
    again = pickle.loads(pickle.dumps(found))
    np.testing.assert_array_equal(again.predicted_positions(estimates), before)
    np.testing.assert_array_equal(again.per_sample, found.per_sample)
