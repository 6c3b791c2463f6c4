"""Monte Carlo of systems given by equations: the predicted covariance holds where noise is small."""

from __future__ import annotations

import numpy as np
import pytest
from experiments import Experiment, box_and_lucas, compartmental, pond, rooney_and_biegler

import oed

FEW = 200
"""Replicates: fast, and a standard error that is off by a third is seen."""


def validated(one: Experiment, replicates: int = FEW, **options) -> oed.Validation:
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


class TestSmallNoise:
    @pytest.mark.parametrize("one", SMALL.values(), ids=SMALL)
    def test_estimates_scatter_as_evaluate_says(self, one: Experiment):
        found = validated(one)
        (covariance,) = oed.evaluate(one.problem, one.trajectory).covariances.values()
        np.testing.assert_allclose(found.predicted, covariance, rtol=1e-9)
        assert found.passed, found.verdict
        assert np.all(np.abs(found.paired_ratio - 1) < 0.02)
        assert found.units == one.problem.any_estimations[0].units

    @pytest.mark.slow
    @pytest.mark.parametrize("one", SMALL.values(), ids=SMALL)
    def test_so_do_many(self, one: Experiment):
        assert validated(one, 2000).passed

    def test_the_same_whatever_the_workers(self):
        one = SMALL["Rooney and Biegler"]
        alone, together = (validated(one, 250, workers=count) for count in (1, 2))
        for name in ("mean", "sampled", "estimates", "paired_ratio"):
            np.testing.assert_array_equal(getattr(alone, name), getattr(together, name))
        assert alone.checks == together.checks


class TestLargeNoise:
    @pytest.mark.parametrize("prior", [True, False])
    def test_does_not_pass(self, prior: bool):
        found = validated(rooney_and_biegler(3.0, prior=prior), 400)
        assert not found.passed
