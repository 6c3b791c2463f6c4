"""Monte Carlo of systems given by equations: the predicted covariance holds where noise is small."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from experiments import Experiment, box_and_lucas, compartmental, pond, response, rooney_and_biegler

import oed
from oed.kernel.scorer import score
from oed.simulation.checks import Moments
from oed.simulation.linearisation import Linearisation, differences, directions_of

FEW = 100
"""Replicates, of what another one with many is shown to be the same as."""


MANY = 150
"""A standard error that is off by a quarter is seen, and in pairs with linear estimates one by a fiftieth."""


@cache
def found_of(name: str) -> oed.Validation:
    """Of small noise, for all that looks at it."""
    return validated(SMALL[name], FEW if name in SAME else MANY)


def validated(one: Experiment, replicates: int, **options) -> oed.Validation:
    return oed.validate(one.problem, one.trajectory, replicates=replicates, seed=1, **options)


SMALL = {
    "Box and Lucas": box_and_lucas(1e-3),
    "compartmental": compartmental(0.01),
    "compartmental in several runs": compartmental(0.01, runs=3),
    "Rooney and Biegler": rooney_and_biegler(0.1),
    "without a prior": rooney_and_biegler(0.1, prior=False),
    "pond": pond(0.01, inputs=np.zeros((48, 1))),
    "pond without inputs": pond(0.01),
    "pond from an unknown start": pond(0.01, start="unknown"),
    "pond from a start known roughly": pond(0.01, start={"prey": 0.02, "predators": 0.01}),
}


SAME = {"pond": "pond without inputs"}
"""Whose inputs are all 0: what is validated with many is the other one."""


class TestSmallNoise:
    @pytest.mark.slow
    @pytest.mark.parametrize("name", SMALL)
    def test_estimates_scatter_as_evaluate_says(self, name: str):
        one, found = SMALL[name], found_of(name)
        (covariance,) = score(one.problem, one.trajectory).covariances.values()
        np.testing.assert_allclose(found.predicted, covariance, rtol=1e-9)
        assert found.passed, found.verdict
        assert np.all(np.abs(found.paired_ratio - 1) < 0.02)
        assert found.units == one.problem.any_estimations[0].units

    @pytest.mark.slow
    @pytest.mark.parametrize("name", SAME)
    def test_many_would_be_those_of(self, name: str):
        # The same numbers are drawn, and the same estimates follow from each: so they would from many.
        one, other = found_of(name), found_of(SAME[name])
        np.testing.assert_allclose(one.estimates, other.estimates[: len(one.estimates)], rtol=1e-9)
        assert len(one.estimates) == FEW
        np.testing.assert_allclose(one.predicted, other.predicted, rtol=1e-9)

    @pytest.mark.slow
    def test_the_same_whatever_the_workers(self):
        one = SMALL["Rooney and Biegler"]
        alone, together = (validated(one, 250, workers=count) for count in (1, 2))
        for name in ("mean", "sampled", "estimates", "paired_ratio"):
            np.testing.assert_array_equal(getattr(alone, name), getattr(together, name))
        assert alone.checks == together.checks


class TestLargeNoise:
    @pytest.mark.slow
    def test_does_not_pass(self):
        found = validated(rooney_and_biegler(3.0, prior=False), 50)
        assert not found.passed
        assert found.linearisation.small_enough is False
        assert "did not hold" in found.verdict
        assert found.verdict.endswith(found.linearisation.sentence)
        assert "The noise is too large for linearisation" in found.verdict


class TestLinearisation:
    @pytest.mark.slow
    @pytest.mark.parametrize("name", SMALL)
    def test_holds_where_noise_is_small(self, name: str):
        found = found_of(name)
        assert found.linearisation.small_enough is True
        assert "small enough for linearisation" in found.linearisation.sentence
        assert "linearisation" not in found.verdict
        assert np.all(found.linearisation.bias_error < 0.01)

    def test_of_a_linear_response_is_exact(self):
        one = response(
            {"a": "2", "b": "3 1/s"}, "a + b * t", lambda t, a, b: a + b * t, [1.0, 2.0, 5.0], 10.0
        )
        found = validated(one, 50).linearisation
        assert np.abs(found.bias).max() < 1e-9
        assert np.abs(found.ratio - 1).max() < 1e-9
        assert found.small_enough is True

    @pytest.mark.slow
    def test_few_experiments_do_not_say(self):
        found = validated(rooney_and_biegler(1.0), 50).linearisation
        assert found.small_enough is None
        assert "50 simulated experiments do not say: take more" in found.sentence

    def test_what_is_compared(self):
        # Estimates and linear ones by hand, all errors below the cap.
        rng = np.random.default_rng(5)
        covariance = np.array([[4.0, 1e-3], [1e-3, 1e-6]])
        linear = rng.multivariate_normal([3.0, 0.1], covariance, 500)
        estimates = linear + np.array([0.4, 0.0])
        directions = directions_of(covariance)
        np.testing.assert_allclose(np.diag(directions @ covariance @ directions.T), 1.0, rtol=1e-12)
        axes = directions[2:]
        np.testing.assert_allclose(axes @ covariance @ axes.T, np.eye(2), atol=1e-12)
        pairs = Moments.of(differences(estimates, linear, np.array([3.0, 0.1]), directions))
        found = Linearisation.of(("a", "b"), directions, covariance, pairs, 0.01)
        np.testing.assert_allclose(found.bias[:2], [0.2, 0.0], atol=1e-9)
        np.testing.assert_allclose(found.bias_error, 0, atol=1e-9)
        off = (linear[:, 0] + 0.4 - 3.0) ** 2 - (linear[:, 0] - 3.0) ** 2
        assert found.ratio[0] == pytest.approx(np.sqrt(1 + off.mean() / 4))
        expected = np.std(off / 4, ddof=1) / np.sqrt(500) / 2 / found.ratio[0]
        assert found.ratio_error[0] == pytest.approx(expected)
        assert found.small_enough is False

    def test_single_estimates_that_run_away_do_not_decide(self):
        rng = np.random.default_rng(6)
        linear = rng.standard_normal((5000, 1))
        estimates = linear.copy()
        estimates[7] = 1e12
        pairs = Moments.of(differences(estimates, linear, np.zeros(1), directions_of(np.eye(1))))
        assert Linearisation.of(("a",), np.eye(1), np.eye(1), pairs, 0.01).small_enough is True

    def test_looks_along_combinations(self):
        # Both parameters are right, their sum, which is known much better, is not.
        covariance = np.array([[1.0, -0.999], [-0.999, 1.0]])
        linear = np.random.default_rng(7).multivariate_normal([0, 0], covariance, 400)
        directions = directions_of(covariance)
        pairs = Moments.of(differences(linear + 0.01, linear, np.zeros(2), directions))
        found = Linearisation.of(("a", "b"), directions, covariance, pairs, 0.01)
        assert np.all(np.abs(found.bias[:2]) < 0.02)
        assert found.small_enough is False
        assert "a combination of a and b" in found.sentence
