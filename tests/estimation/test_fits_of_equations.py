"""Least squares of systems given by equations against SciPy, on closed forms and its own integration."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from experiments import BEGIN, Experiment, box_and_lucas, compartmental, pond, response, rooney_and_biegler
from scipy.optimize import least_squares

import oed
from oed.estimation.methods import Estimate
from oed.foundation.errors import NotFinite, ProblemError
from oed.kernel.scorer import score

CLOSE = 1e-6
"""Share of a standard error by which two least squares may differ."""
QUOTIENT = np.finfo(float).eps ** (1 / 3)
"""Step of central differences, in units of the unknowns."""


def independent(one: Experiment, readings: np.ndarray, centre: np.ndarray, known: np.ndarray) -> np.ndarray:
    """The least squares by SciPy, of unknowns about whose centre the information `known` is had."""
    root, sizes = np.linalg.cholesky(known).T if known.any() else known, centre

    def residuals(scaled: np.ndarray) -> np.ndarray:
        values = scaled * sizes
        return np.concatenate([(one.read(values) - readings) / one.deviations, root @ (values - centre)])

    def slopes(scaled: np.ndarray) -> np.ndarray:
        # Central differences, all at once.
        units = QUOTIENT * np.eye(len(scaled))
        ahead, behind = np.hsplit(
            one.read(sizes[:, None] * np.hstack([scaled[:, None] + units, scaled[:, None] - units])), 2
        )
        return np.vstack([(ahead - behind) / (2 * QUOTIENT) / one.deviations[:, None], root * sizes])

    found = least_squares(
        residuals, np.ones(len(centre)), jac=slopes, method="lm", xtol=1e-12, ftol=1e-15, gtol=1e-15
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

    @pytest.mark.slow
    def test_pond(self):
        compared(pond(0.03, start="known", substeps=30))

    @pytest.mark.slow
    def test_pond_that_is_fished_in_two_runs(self):
        catches = np.random.default_rng(3).uniform(0, 1, (96, 1))
        compared(pond(0.03, start="unknown", inputs=catches, runs=2, substeps=30))

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


class TestWhatIsFitted:
    @pytest.mark.slow
    def test_a_reading_that_counts_three_times_is_the_mean_of_three(self):
        one = rooney_and_biegler(0.1, prior=False)
        weights = np.array([3.0, 0.0, 1.0, 0.5, 0.0, 2.0, 1.0])
        taken = weights > 0
        weighted = replace(one.trajectory, weights=weights)
        estimator = oed.make_estimator(one.problem, weighted)
        (covariance,) = score(one.problem, weighted).covariances.values()
        np.testing.assert_allclose(estimator.covariance, covariance, rtol=1e-9)
        nominal = np.array(one.problem.system.nominal)
        readings = one.read(nominal) + 0.1 * np.random.default_rng(1).standard_normal(7)
        found = estimator.fit(np.where(taken, readings, 1e3))
        chosen = Experiment(
            one.problem,
            one.trajectory,
            lambda values: one.read(values)[taken],
            0.1 / np.sqrt(weights[taken]),
        )
        expected = independent(chosen, readings[taken], nominal, np.zeros((2, 2)))
        assert np.all(np.abs(found.values - expected) < CLOSE * np.sqrt(np.diag(found.covariance)))
        assert oed.validate(one.problem, weighted, replicates=200, seed=2).passed

    @pytest.mark.slow
    def test_several_sensors_and_a_start_that_is_known_roughly(self):
        begin = {"prey": 0.01, "predators": 0.02}
        plain = pond(0.01)
        sensors = [
            oed.Rates(noise={"prey": 0.01}, start=begin),
            oed.Outputs(noise={"predators": 0.02}, start=begin),
        ]
        problem = replace(plain.problem, measurement=sensors)
        estimator = oed.make_estimator(problem, plain.trajectory)
        (covariance,) = score(problem, plain.trajectory).covariances.values()
        np.testing.assert_allclose(estimator.covariance, covariance, rtol=1e-9)
        assert estimator.nuisances == ("start.prey", "start.predators")
        found = estimator.fit(estimator.predicted())
        np.testing.assert_allclose(found.values, problem.system.nominal, rtol=1e-12)
        np.testing.assert_allclose(found.nuisance_values, BEGIN, rtol=1e-12)

    @pytest.mark.slow
    def test_tiny_states_from_nothing(self):
        system = oed.Equations(
            inputs={"feed": "mol/s"},
            states={"amount": "mol"},
            parameters={"rate": "1e-5 1/s"},
            derivatives={"amount": "feed - rate * amount"},
            outputs={"y": "amount"},
            substeps=50,
        )
        spline = oed.Spline(degree=0, coefficients=20)
        space = oed.SignalSpace(duration=2.5e5, samples=20, spline=spline, rest_to_rest=False)
        problem = oed.Problem(
            model=system,
            design=space.model_copy(update={"start": (0.0,)}),
            measurement=oed.Outputs(noise={"y": "1e-12 mol"}, start="unknown"),
            limits=[oed.InputRange(input="feed", range=("0 mol/s", "1 mol/s"))],
            criterion="D",
        )
        trajectory = space.trajectory(np.full((20, 1), 1e-12), [[0.0]])
        times = np.linspace(0, 2.5e5, 21)

        def read(values: np.ndarray) -> np.ndarray:
            rate, begin = values
            settled = 1e-12 / rate
            return settled + (begin - settled) * np.exp(-rate * times)

        estimator = oed.make_estimator(problem, trajectory)
        # The Runge-Kutta steps are finer than the noise by far.
        np.testing.assert_allclose(estimator.predicted(), read(np.array([1e-5, 0.0])), rtol=1e-12)
        readings = estimator.predicted() + 1e-12 * np.random.default_rng(2).standard_normal(21)
        found = estimator.fit(readings)
        sizes = np.array([1e-5, 1e-12])

        def slopes(scaled: np.ndarray) -> np.ndarray:
            rate, begin = scaled * sizes
            left = np.exp(-rate * times)
            by_rate = (1e-12 / rate - begin) * times * left - 1e-12 / rate**2 * (1 - left)
            return np.column_stack([by_rate, left]) * sizes / 1e-12

        expected = least_squares(
            lambda scaled: (read(scaled * sizes) - readings) / 1e-12,
            [1.0, 0.0],
            jac=slopes,
            method="lm",
            xtol=1e-15,
            ftol=1e-15,
            gtol=1e-15,
        )
        errors = np.array([np.sqrt(found.covariance[0, 0]), 1e-12])
        assert found.converged
        assert np.all(np.abs([*found.values, *found.nuisance_values] - expected.x * sizes) < CLOSE * errors)

    @pytest.mark.slow
    @pytest.mark.filterwarnings("error")
    def test_a_search_may_come_to_where_nothing_is_finite(self):
        one = response(
            {"b": "5", "c": "0.8 1/s"},
            "10 * exp(-b * exp(-c * t))",
            lambda t, b, c: 10 * np.exp(-b * np.exp(-c * t)),
            [0.5, 1.0, 2.0, 4.0],
            4.0,
        )
        found = oed.validate(one.problem, one.trajectory, replicates=10, seed=0)
        assert np.all(np.isfinite(found.estimates))
        assert found.linearisation.small_enough is False


class TestMistakes:
    def test_what_is_not_finite_is_named(self):
        one = response(
            {"a": "2", "unit": "1 s"}, "sqrt(t / unit - a)", lambda t, a: t, [1.0, 5.0], 1.0, estimate=["a"]
        )
        with pytest.raises(NotFinite, match=r"the reading of responses at 0\.5 s is not finite"):
            oed.make_estimator(one.problem, one.trajectory)

    def test_parameters_that_nothing_tells_apart(self):
        one = response({"a": "2 1/s", "b": "3"}, "a * b * t", lambda t, a, b: a * b * t, [1.0, 5.0], 1.0)
        with pytest.raises(ProblemError, match="does not identify a, b"):
            oed.validate(one.problem, one.trajectory, replicates=10)

    def test_a_trajectory_of_another_system(self):
        one = pond(0.01)
        other = oed.Trajectory.from_samples(np.zeros((48, 1)), 12.0, BEGIN)
        with pytest.raises(ValueError, match="expected 0 inputs"):
            oed.make_estimator(one.problem, other)
        weighted = replace(one.trajectory, weights=np.ones(3))
        with pytest.raises(ValueError, match="expected weights of 49 readings, got 3"):
            oed.make_estimator(one.problem, weighted)

    def test_other_estimators(self):
        one = box_and_lucas(0.1)
        with pytest.raises(ProblemError, match="responses are estimated by nonlinear least squares"):
            oed.validate(one.problem, one.trajectory, estimator="ols")

    def test_readings_of_another_number(self):
        one = box_and_lucas(0.1)
        with pytest.raises(ValueError, match="expected 2 finite readings, got 3"):
            oed.make_estimator(one.problem, one.trajectory).fit([1.0, 2.0, 3.0])
