"""Least squares of systems given by equations against SciPy, on closed forms and its own integration."""

from __future__ import annotations

import numpy as np
import pytest
from experiments import BEGIN, Experiment, box_and_lucas, compartmental, pond, response, rooney_and_biegler
from scipy.optimize import least_squares

import oed
from oed.estimation.methods import Estimate

CLOSE = 1e-6
"""Share of a standard error by which two least squares may differ."""


def independent(one: Experiment, readings: np.ndarray, centre: np.ndarray, known: np.ndarray) -> np.ndarray:
    """The least squares by SciPy, of unknowns about whose centre the information `known` is had."""
    root, sizes = np.linalg.cholesky(known).T if known.any() else known, centre

    def residuals(scaled: np.ndarray) -> np.ndarray:
        values = scaled * sizes
        return np.concatenate([(one.read(values) - readings) / one.deviations, root @ (values - centre)])

    found = least_squares(
        residuals, np.ones(len(centre)), jac="3-point", method="lm", xtol=1e-15, ftol=1e-15, gtol=1e-15
    )
    return found.x * sizes


def compared(one: Experiment, noise_seed: int = 0, known: np.ndarray | None = None) -> Estimate:
    """Fits readings with noise, and compares with SciPy's fit."""
    estimator = oed.make_estimator(one.problem, one.trajectory)
    nominal = np.array(one.problem.system.nominal)
    if estimator.nuisances:
        nominal = np.concatenate([nominal, np.tile(BEGIN, len(estimator.nuisances) // 2)])
    exact = one.read(nominal)
    np.testing.assert_allclose(estimator.predicted(), exact, rtol=0, atol=1e-7 * one.deviations.min())
    readings = exact + one.deviations * np.random.default_rng(noise_seed).standard_normal(len(exact))
    found = estimator.fit(readings)
    assert found.converged
    expected = independent(one, readings, nominal, np.zeros((len(nominal),) * 2) if known is None else known)
    errors = np.sqrt(np.diag(found.covariance))
    count = len(found.parameters)
    assert np.all(np.abs(found.values - expected[:count]) < CLOSE * errors)
    if estimator.nuisances:
        assert np.all(np.abs(found.nuisance_values - expected[count:]) < CLOSE * one.deviations.min())
    assert np.abs(found.values - nominal[:count]).max() > 0
    white = (readings - one.read(expected)) / one.deviations
    np.testing.assert_allclose(found.residuals, white, atol=1e-5)
    return found


class TestAgainstSciPy:
    def test_box_and_lucas(self):
        found = compared(box_and_lucas(1e-2))
        # As many readings as parameters: nothing is left.
        assert np.abs(found.residuals).max() < 1e-9

    @pytest.mark.parametrize("runs", [1, 3])
    def test_compartmental(self, runs: int):
        compared(compartmental(0.1, runs))

    @pytest.mark.parametrize("noise", [0.1, 1.0])
    def test_rooney_and_biegler(self, noise: float):
        compared(rooney_and_biegler(noise, prior=False))

    def test_a_prior(self):
        one = rooney_and_biegler(0.5)
        covariance = np.array(one.problem.prior.covariance)
        compared(one, known=np.linalg.inv(covariance))

    @pytest.mark.parametrize("start", ["known", "unknown"])
    def test_pond(self, start: str):
        compared(pond(0.1, start=start, substeps=60))

    @pytest.mark.slow
    def test_pond_that_is_fished_in_two_runs(self):
        catches = np.random.default_rng(3).uniform(0, 1, (96, 1))
        compared(pond(0.1, start="unknown", inputs=catches, runs=2, substeps=60))

    def test_parameters_of_very_different_sizes(self):
        one = response(
            {"slow": "2e-5 1/s", "fast": "40 1/s", "large": "3e7"},
            "large * (exp(-slow * t) - exp(-fast * t))",
            lambda t, slow, fast, large: large * (np.exp(-slow * t) - np.exp(-fast * t)),
            [1e-2, 3e-2, 0.1, 1.0, 100.0, 1000.0, 4000.0],
            1e4,
        )
        found = compared(one)
        assert np.ptp(np.log10(found.values)) > 12
