"""Least squares on displacements: every method's formula against experiments simulated by NumPy alone."""

from __future__ import annotations

import math
import pickle
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from itertools import cycle, product

import numpy as np
import oracle
import pytest
from builders import RADIUS, SPEED, TRACK, check_all, problem_of, random_drive
from sample_robots import COEFFICIENT_ROBOTS, TWO_SIDED

from oed.estimation.methods import (
    METHODS,
    EstimatorName,
    Heading,
    Nonlinear,
    Regression,
    estimator_issues,
    make_estimator,
    usual_estimator,
)
from oed.estimation.methods.measured_headings import corrected_covariance
from oed.foundation.errors import Issue, ProblemError
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.evaluation import evaluate
from oed.kernel.measurement.measurement import Measurement
from oed.kernel.problem import Problem
from oed.robots.sensors import Displacements, Poses, Ranges, Several, YawRate
from oed.robots.space import DesignSpace
from oed.simulation import Validation, validate

REPLICATES = 2500
MANY = 4000
"""By which one per cent is seen."""
NOISE_MODELS = ("increments", "absolute")
HEADINGS: tuple[Heading, ...] = ("known", "predicted", "measured")
WAYS: list[tuple[EstimatorName, Heading]] = [
    (name, heading)
    for name in METHODS
    for heading in HEADINGS
    if name != "errors_in_variables" or heading == "measured"
]
C = np.array([[RADIUS / TRACK, -RADIUS / TRACK], [RADIUS / 2, RADIUS / 2]])

noise_models = pytest.mark.parametrize("noise_model", NOISE_MODELS)
DISTINCT = [way for way in WAYS if way[0] != "sandwich"]
ways = pytest.mark.parametrize(("name", "heading"), WAYS, ids=map("-".join, WAYS))
distinct_ways = pytest.mark.parametrize(("name", "heading"), DISTINCT, ids=map("-".join, DISTINCT))
seeds = pytest.mark.parametrize("seed", range(2))


@cache
def make(
    noise_model: str = "increments",
    position: str = "1 cm",
    heading: str = "2 deg",
    *,
    samples: int = 40,
    segments: int | str = 10,
    regressor: str = "both",
    rule: str = "arc",
    estimator: str = "gls",
) -> Problem:
    """Drives of a quarter of a second per sample."""
    return problem_of(
        duration=samples / 4,
        samples=samples,
        integration=rule,
        measurement=Displacements(
            segments=segments,
            regressor=regressor,
            noise={"position": position, "heading": heading},
            noise_model=noise_model,
            estimator=estimator,
        ),
        limits=(SPEED,),
    )


DRIVE = random_drive(make(), 3, 5.0)


@cache
def validated(
    name: EstimatorName, heading: Heading, noise_model: str, position: str = "1 cm", turn: str = "2 deg"
) -> Validation:
    problem = make(noise_model, position, turn)
    return validate(problem, DRIVE, estimator=name, heading=heading, replicates=REPLICATES, seed=1)


@dataclass(frozen=True)
class Experiment:
    """The paper's robot, simulated and estimated from with NumPy alone; displacements as complex numbers.

    Attributes:
        problem: with noisy displacements.
        drive: that is driven.
    """

    problem: Problem
    drive: Trajectory

    @property
    def edges(self) -> np.ndarray:
        return self.problem.measurement.segment_edges(self.drive.samples)

    def rows(self, first_stage: np.ndarray) -> np.ndarray:
        """Phi_xy of single samples with the headings that c11, c12 (R, 2) predict, (R, N, 2)."""
        turns = self.drive.period * np.atleast_2d(first_stage) @ self.drive.inputs.T
        middles = self.drive.start[2] + np.cumsum(turns, axis=1) - turns / 2
        chords = self.drive.period * np.sinc(turns / (2 * np.pi)) * np.exp(1j * middles)
        return chords[..., None] * self.drive.inputs

    def sums(self, rows: np.ndarray) -> np.ndarray:
        """Of single samples' rows (..., N, 2) over the segments, (..., P, 2)."""
        return np.add.reduceat(rows, self.edges[:-1], axis=-2)

    @property
    def designs(self) -> dict[str, np.ndarray]:
        """W at the truth: of the turns, (P, 2), and of the complex displacements, (P, 2)."""
        return {
            "heading": self.sums(self.drive.period * self.drive.inputs),
            "position": self.sums(self.rows(C[0])[0]),
        }

    @property
    def differences(self) -> np.ndarray:
        """D (P, P + 1) of absolute poses, or 1."""
        count = len(self.edges) - 1
        absolute = self.problem.measurement.noise_model == "absolute"
        return np.diff(np.eye(count + 1), axis=0) if absolute else np.eye(count)

    def noise(self, rng: np.random.Generator, name: str, count: int) -> np.ndarray:
        """Of turns or of complex displacements, (R, P)."""
        size, width = getattr(self.problem.measurement.noise, name), self.differences.shape[1]
        drawn = rng.standard_normal((count, width)).astype(complex)
        if name == "position":
            drawn += 1j * rng.standard_normal((count, width))
        return size * (drawn if name == "position" else drawn.real) @ self.differences.T

    def estimates(
        self, name: EstimatorName, heading: Heading, count: int = REPLICATES, seed: int = 0
    ) -> np.ndarray:
        """c11, c12, c21, c22 of simulated experiments, (R, 4)."""
        rng = np.random.default_rng([seed, 77])
        return self.estimated(name, heading, *self.readings(rng, count))

    def readings(self, rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Noisy turns (R, P) and complex displacements (R, P) and heading errors (R, N)."""
        turns = self.designs["heading"] @ C[0] + self.noise(rng, "heading", count)
        moves = self.designs["position"] @ C[1] + self.noise(rng, "position", count)
        size = self.problem.measurement.noise.heading
        return turns, moves, size * rng.standard_normal((count, self.drive.samples))

    def estimated(
        self, name: EstimatorName, heading: Heading, turns: np.ndarray, moves: np.ndarray, errors: np.ndarray
    ) -> np.ndarray:
        """c11, c12, c21, c22 from readings, (R, 4)."""
        count, design = len(turns), self.designs["heading"]
        weight = np.eye(len(self.differences))
        if name == "gls":
            weight = np.linalg.inv(self.differences @ self.differences.T)
        first = _weighted(np.broadcast_to(design, (count, *design.shape)), turns, weight)
        rows = np.broadcast_to(self.rows(C[0]), (count, self.drive.samples, 2))
        if heading == "predicted":
            rows = self.rows(first)
        if heading == "measured":
            rows = rows * np.exp(1j * errors)[..., None]
        if name != "errors_in_variables":
            return np.hstack([first, _weighted(self.sums(rows), moves, weight)])
        shrink, own = math.exp(-(self.problem.measurement.noise.heading**2) / 2), self.rows(C[0])[0]
        excess = (shrink**-2 - 1) * (own.conj().T @ own).real
        return np.hstack([first, _weighted(self.sums(rows) / shrink, moves, weight, excess)])


def _weighted(designs: np.ndarray, measured: np.ndarray, weight: np.ndarray, excess=0.0) -> np.ndarray:
    # (W' K W - excess)^-1 W' K y of each replicate.
    left = designs.conj().transpose(0, 2, 1) @ weight
    normal = (left @ designs).real - excess
    return np.linalg.solve(normal, (left @ measured[..., None]).real)[..., 0]


def passes(estimates: np.ndarray, covariance: np.ndarray, skipped: str = "") -> bool:
    """Whether estimates of C scatter as predicted."""
    checks = check_all(estimates - C.ravel(), covariance, 0.01)
    return all(check.passed for check in checks if check.name != skipped)


def test_the_simulation_is_the_oracles():
    experiment = Experiment(make(), DRIVE)
    rates = DRIVE.inputs @ C[0]
    headings = DRIVE.period * np.concatenate([[0.0], np.cumsum(rates)[:-1]])
    turns, moves = oracle.segment_regressors(
        DRIVE.inputs, headings, rates, DRIVE.period, experiment.edges, "arc"
    )
    np.testing.assert_allclose(experiment.designs["heading"], turns, atol=1e-12)
    stacked = np.stack([experiment.designs["position"].real, experiment.designs["position"].imag], axis=1)
    np.testing.assert_allclose(stacked.reshape(-1, 2), moves, atol=1e-12)


class TestFirstOrder:
    """Every method promises, or at least knows, how its estimates scatter to first order."""

    @distinct_ways
    @noise_models
    def test_the_linear_covariance_is_the_scatter_of_an_independent_simulation(
        self, name: EstimatorName, heading: Heading, noise_model: str
    ):
        problem = make(noise_model, "1 cm", "0.5 deg")
        estimates = Experiment(problem, DRIVE).estimates(name, heading)
        assert passes(estimates, Regression(problem, DRIVE, name, heading).linear_covariance)

    @distinct_ways
    @noise_models
    def test_the_linear_estimates_have_it(self, name: EstimatorName, heading: Heading, noise_model: str):
        # However large the noise is.
        regression = Regression(make(noise_model, "1 cm", "10 deg"), DRIVE, name, heading)
        _, linear = regression.simulate(np.random.default_rng(3), REPLICATES)
        assert passes(linear, regression.linear_covariance)

    @pytest.mark.slow
    @distinct_ways
    @noise_models
    def test_estimates_are_those_of_the_simulation(
        self, name: EstimatorName, heading: Heading, noise_model: str
    ):
        # Even where noise is large: the same mean and covariance, as far as two samples can tell.
        problem = make(noise_model, "1 cm", "3 deg")
        ours, _ = Regression(problem, DRIVE, name, heading).simulate(np.random.default_rng(4), REPLICATES)
        theirs = Experiment(problem, DRIVE).estimates(name, heading)
        covariances = [np.cov(sample, rowvar=False) for sample in (ours, theirs)]
        sizes = np.sqrt(np.diag(covariances[0]))
        offset = (ours.mean(axis=0) - theirs.mean(axis=0)) / sizes
        assert np.abs(offset).max() < 4 * math.sqrt(2 / REPLICATES)
        shares = (covariances[1] - covariances[0]) / np.outer(sizes, sizes)
        assert np.abs(shares).max() < 4 * 2 / math.sqrt(REPLICATES)

    @pytest.mark.parametrize("heading", HEADINGS)
    @noise_models
    def test_the_sandwich_says_more_of_the_same_estimates(self, heading: Heading, noise_model: str):
        ols, sandwich = (Regression(make(noise_model), DRIVE, name, heading) for name in ("ols", "sandwich"))
        for one, other in zip(
            *(found.simulate(np.random.default_rng(1), 5) for found in (ols, sandwich)), strict=True
        ):
            np.testing.assert_array_equal(one, other)
        np.testing.assert_array_equal(sandwich.covariance, ols.linear_covariance)


class TestOwnFormula:
    """What a method promises, where it promises to be right."""

    RIGHT = (
        ("sandwich", "known", "increments", "2 deg"),
        ("sandwich", "known", "absolute", "2 deg"),
        ("sandwich", "predicted", "increments", "1 deg"),
        ("sandwich", "predicted", "absolute", "1 deg"),
        ("gls", "known", "increments", "2 deg"),
        ("gls", "known", "absolute", "2 deg"),
        ("ols", "known", "increments", "2 deg"),
        ("errors_in_variables", "measured", "increments", "2 deg"),
        ("errors_in_variables", "measured", "absolute", "2 deg"),
    )

    @pytest.mark.parametrize(("name", "heading", "noise_model", "turn"), RIGHT, ids=map("-".join, RIGHT))
    def test_it_holds(self, name: EstimatorName, heading: Heading, noise_model: str, turn: str):
        result = validated(name, heading, noise_model, turn=turn)
        assert (result.estimator, result.heading) == (name, heading)
        assert result.passed
        assert np.abs(result.paired_ratio - 1).max() < 0.01
        assert result.paired_error.max() < 0.003

    @pytest.mark.parametrize(("name", "heading", "noise_model", "turn"), RIGHT, ids=map("-".join, RIGHT))
    def test_an_independent_simulation_agrees(
        self, name: EstimatorName, heading: Heading, noise_model: str, turn: str
    ):
        estimates = Experiment(make(noise_model, "1 cm", turn), DRIVE).estimates(name, heading, seed=1)
        promised = validated(name, heading, noise_model, turn=turn).predicted
        assert passes(estimates, promised)
        assert not passes(estimates, 1.1 * promised)
        assert not passes(estimates, 0.9 * promised)

    @noise_models
    def test_known_headings_by_the_textbook(self, noise_model: str):
        # sigma^2 S W' D D' W S and sigma^2 [W' (D D')^-1 W]^-1 with S = (W'W)^-1.
        problem = make(noise_model)
        experiment = Experiment(problem, DRIVE)
        spread = experiment.differences @ experiment.differences.T
        for first, block in ((0, "heading"), (2, "position")):
            design, size = experiment.designs[block], getattr(problem.measurement.noise, block)
            inverse = np.linalg.inv((design.conj().T @ design).real)
            expected = {
                "ols": size**2 * spread[0, 0] * inverse,
                "sandwich": size**2 * inverse @ (design.conj().T @ spread @ design).real @ inverse,
                "gls": size**2 * np.linalg.inv((design.conj().T @ np.linalg.solve(spread, design)).real),
            }
            for name, covariance in expected.items():
                found = Regression(problem, DRIVE, name).covariance
                np.testing.assert_allclose(found[first : first + 2, first : first + 2], covariance, rtol=1e-9)
                np.testing.assert_array_equal(found[:2, 2:], 0)

    def test_gls_is_the_scatter_of_the_cumulative_regressors(self):
        # sigma^2 [sum (G_k - Gbar)'(G_k - Gbar)]^-1, with the poses measured at all P + 1 ends.
        experiment = Experiment(make("absolute"), DRIVE)
        sums = np.vstack([np.zeros((1, 2)), np.cumsum(experiment.designs["position"], axis=0)])
        centred = sums - sums.mean(axis=0)
        expected = 0.01**2 * np.linalg.inv((centred.conj().T @ centred).real)
        found = Regression(make("absolute"), DRIVE, "gls").covariance[2:, 2:]
        np.testing.assert_allclose(found, expected, rtol=1e-9)

    @pytest.mark.parametrize(
        ("noise_model", "estimator", "name"),
        [
            ("increments", "gls", "ols"),
            ("increments", "ols", "ols"),
            ("absolute", "gls", "gls"),
            ("absolute", "ols", "sandwich"),
        ],
    )
    def test_the_usual_one_promises_what_the_design_maximised(
        self, noise_model: str, estimator: str, name: EstimatorName
    ):
        for regressor in ("position", "heading", "both"):
            problem = make(noise_model, regressor=regressor, estimator=estimator)
            assert usual_estimator(problem.measurement) == name
            found, told = make_estimator(problem, DRIVE), evaluate(problem, DRIVE)
            assert (found.name, found.parameters) == (name, tuple(told.standard_deviations))
            for index, covariance in enumerate(told.covariances.values()):
                block = slice(2 * index, 2 * index + 2)
                np.testing.assert_allclose(found.covariance[block, block], covariance, rtol=1e-8)

    @ways
    def test_a_regression_alone_promises_what_it_does_beside_the_other(
        self, name: EstimatorName, heading: Heading
    ):
        both = Regression(make("absolute"), DRIVE, name, heading)
        for regressor, block in (("heading", slice(2)), ("position", slice(2, 4))):
            alone = Regression(make("absolute", regressor=regressor), DRIVE, name, heading)
            assert alone.parameters == both.parameters[block]
            np.testing.assert_allclose(alone.covariance, both.covariance[block, block], rtol=1e-12)
            np.testing.assert_allclose(
                alone.linear_covariance, both.linear_covariance[block, block], rtol=1e-12
            )

    # One rule and estimator after the other: neither knows of robots.
    @pytest.mark.slow
    @pytest.mark.parametrize(
        ("example", "rule", "name", "heading"),
        [
            (one, *other)
            for one, other in zip(
                COEFFICIENT_ROBOTS,
                cycle(
                    [
                        ("arc", "sandwich", "predicted"),
                        ("midpoint", "errors_in_variables", "measured"),
                        ("arc", "errors_in_variables", "measured"),
                        ("midpoint", "sandwich", "predicted"),
                    ]
                ),
                strict=False,
            )
        ],
        ids=lambda one: one if isinstance(one, str) else one.name,
    )
    def test_every_robot_and_rule(self, example, rule: str, name: EstimatorName, heading: Heading):
        problem = problem_of(
            model=example.model,
            integration=rule,
            measurement=Displacements(
                regressor="both",
                noise={"position": "5 mm", "heading": "0.5 deg"},
                noise_model="absolute",
            ),
            limits=(SPEED,),
        )
        drive = DRIVE if example in TWO_SIDED else random_drive(problem, seed=3)
        result = validate(problem, drive, estimator=name, heading=heading, replicates=1000)
        assert result.passed
        assert np.abs(result.paired_ratio - 1).max() < 0.01


class TestNegativeControls:
    """What a method does not know, the checks do."""

    @pytest.mark.parametrize("heading", HEADINGS)
    def test_the_naive_formula_under_noise_of_absolute_poses(self, heading: Heading):
        result = validated("ols", heading, "absolute", turn="0.5 deg")
        assert not result.passed
        failed = {check.name for check in result.checks if not check.passed}
        assert failed >= {"covariance", "NEES", "eigenvalues"}
        # The others' errors cancel in part: it promises more than twice the variance there is.
        assert result.paired_ratio.max() < 0.5

    @pytest.mark.slow
    def test_the_naive_formula_where_predicted_headings_err(self):
        result = validated("ols", "predicted", "increments", "0.01 mm", "0.05 deg")
        assert not result.passed
        assert result.paired_ratio.max() > 1.3
        # It takes the same estimates; their covariance is the sandwich's.
        sandwich = Regression(make("increments", "0.01 mm", "0.05 deg"), DRIVE, "sandwich", "predicted")
        share = np.diag(sandwich.covariance) / np.diag(result.predicted)
        np.testing.assert_allclose(share, result.paired_ratio, rtol=0.05)

    @noise_models
    def test_gls_knows_nothing_of_noisy_headings(self, noise_model: str):
        # Its promise is that of known ones; what they add shows in the linear covariance.
        problem = make(noise_model, "0.01 mm", "0.05 deg")
        known = Regression(problem, DRIVE, "gls", "known").covariance
        for heading in ("predicted", "measured"):
            regression = Regression(problem, DRIVE, "gls", heading)
            np.testing.assert_array_equal(regression.covariance, known)
            more = np.diag(regression.linear_covariance) / np.diag(known)
            np.testing.assert_allclose(more[:2], 1, rtol=1e-9)
            assert more[2:].min() > 1.1

    @pytest.mark.slow
    def test_least_squares_are_biased_where_errors_in_variables_are_not(self):
        problem = make("increments", "1 cm", "10 deg", samples=200, segments="samples")
        drive = random_drive(problem, 3)
        plain, corrected = (
            validate(problem, drive, estimator=name, heading="measured", replicates=2000)
            for name in ("sandwich", "errors_in_variables")
        )
        assert next(check.name for check in plain.checks if not check.passed) == "bias"
        assert corrected.passed


class TestLoewner:
    """Gauss and Markov: no linear unbiased estimator beats generalised least squares, in any direction."""

    @seeds
    @pytest.mark.parametrize("segments", [3, 10, "samples"])
    def test_gls_is_at_least_as_good_as_the_sandwich(self, segments, seed: int):
        problem = make("absolute", segments=segments)
        drive = random_drive(problem, seed)
        sandwich, gls = (Regression(problem, drive, name).covariance for name in ("sandwich", "gls"))
        sizes = np.sqrt(np.diag(sandwich))
        gaps = np.linalg.eigvalsh((sandwich - gls) / np.outer(sizes, sizes))
        assert gaps[0] > -1e-9
        assert gaps[-1] > 1e-3

    def test_independent_increments_need_no_weights(self):
        sandwich, gls, ols = (
            Regression(make(), DRIVE, name).covariance for name in ("sandwich", "gls", "ols")
        )
        np.testing.assert_allclose(gls, ols, rtol=1e-12)
        np.testing.assert_allclose(sandwich, ols, rtol=1e-9, atol=1e-20)

    @noise_models
    def test_noisy_headings_never_help(self, noise_model: str):
        known, predicted, measured = (
            Regression(make(noise_model), DRIVE, "sandwich", heading).covariance for heading in HEADINGS
        )
        for worse in (predicted, measured):
            assert np.linalg.eigvalsh((worse - known)[2:, 2:])[0] > -1e-12 * np.trace(worse)
            np.testing.assert_array_equal(worse[:2, :2], known[:2, :2])


class TestCrossCovariance:
    """Predicted headings carry the first stage's errors into the second."""

    @noise_models
    def test_both_stages_err_together(self, noise_model: str):
        problem = make(noise_model, "0.01 mm", "0.05 deg")
        estimates = Experiment(problem, DRIVE).estimates("sandwich", "predicted", 10_000)
        promised = Regression(problem, DRIVE, "sandwich", "predicted").covariance
        sampled = np.cov(estimates, rowvar=False)
        sizes = np.diag(promised)
        errors = np.sqrt((np.outer(sizes, sizes) + promised**2) / len(estimates))[:2, 2:]
        assert np.abs((sampled - promised)[:2, 2:] / errors).max() < 4
        assert np.abs(promised[:2, 2:] / errors).max() > 20
        np.testing.assert_allclose(promised, promised.T, rtol=1e-9)
        assert np.linalg.eigvalsh(promised / np.sqrt(np.outer(sizes, sizes)))[0] > 0

    @noise_models
    def test_leaving_it_out_is_noticed(self, noise_model: str):
        problem = make(noise_model, "0.01 mm", "0.05 deg")
        estimates = Experiment(problem, DRIVE).estimates("sandwich", "predicted")
        promised = Regression(problem, DRIVE, "sandwich", "predicted").covariance
        assert passes(estimates, promised, skipped="bias")
        apart = promised.copy()
        apart[:2, 2:] = apart[2:, :2] = 0
        assert not passes(estimates, apart, skipped="bias")

    @pytest.mark.parametrize("heading", ["known", "measured"])
    @noise_models
    def test_otherwise_the_stages_are_independent(self, heading: Heading, noise_model: str):
        found = Regression(make(noise_model), DRIVE, "sandwich", heading)
        np.testing.assert_array_equal(found.covariance[:2, 2:], 0)


@pytest.mark.slow
class TestErrorsInVariables:
    """The corrected estimate's own formula."""

    @staticmethod
    def at_full_size(noise_model: str, position: str, turn: str, segments: int | str) -> Validation:
        """20 s of 200 samples."""
        problem = problem_of(
            design=DesignSpace(duration=20),
            measurement=Displacements(
                segments=segments, noise={"position": position, "heading": turn}, noise_model=noise_model
            ),
            limits=(SPEED,),
        )
        return validate(
            problem,
            random_drive(problem, 3),
            estimator="errors_in_variables",
            heading="measured",
            replicates=MANY,
        )

    @pytest.mark.parametrize(
        ("noise_model", "segments", "turn"),
        [
            ("increments", 10, "2 deg"),
            ("increments", 20, "5 deg"),
            ("increments", 20, "10 deg"),
            ("absolute", 20, "2 deg"),
            ("absolute", 10, "5 deg"),
            ("absolute", 10, "10 deg"),
        ],
    )
    def test_to_one_per_cent(self, noise_model: str, segments: int, turn: str):
        result = self.at_full_size(noise_model, "1 cm", turn, segments)
        assert result.passed
        assert result.paired_error.max() < 0.004
        assert np.all(np.abs(result.paired_ratio - 1) < 0.01)

    @noise_models
    def test_to_two_per_cent_where_headings_alone_scatter(self, noise_model: str):
        result = self.at_full_size(noise_model, "0.1 mm", "10 deg", 20)
        assert result.passed
        assert np.all(np.abs(result.paired_ratio - 1) < 0.02)

    def test_without_heading_noise_it_is_the_sandwich(self):
        for noise_model in NOISE_MODELS:
            problem = make(noise_model, heading="1e-6 deg")
            corrected = Regression(problem, DRIVE, "errors_in_variables", "measured").covariance
            sandwich = Regression(problem, DRIVE, "sandwich", "known").covariance
            np.testing.assert_allclose(corrected, sandwich, rtol=1e-6, atol=1e-25)

    @noise_models
    def test_to_first_order_it_is_the_sandwich_of_measured_headings(self, noise_model: str):
        problem = make(noise_model, heading="0.1 deg", position="1 mm")
        corrected = Regression(problem, DRIVE, "errors_in_variables", "measured")
        sandwich = Regression(problem, DRIVE, "sandwich", "measured").covariance
        np.testing.assert_allclose(corrected.linear_covariance, sandwich, rtol=1e-12)
        np.testing.assert_allclose(corrected.covariance, sandwich, rtol=1e-3, atol=1e-12)

    @noise_models
    def test_what_the_noise_of_displacements_scatters(self, noise_model: str):
        # At rest headings scatter nothing of their own: E[W~' D D' W~] / k^2 is left, averaged over headings.
        size, position = math.radians(20), 0.01
        experiment = Experiment(make(noise_model, segments=20), DRIVE)
        rows, shrink = experiment.rows(C[0])[0], math.exp(-(size**2) / 2)
        spread = position**2 * experiment.differences @ experiment.differences.T
        errors = size * np.random.default_rng(6).standard_normal((20_000, len(rows)))
        designs = experiment.sums(rows * np.exp(1j * errors)[..., None])
        middle = (designs.conj().transpose(0, 2, 1) @ spread @ designs).real.mean(axis=0) / shrink**2
        design = experiment.designs["position"]
        inverse = np.linalg.inv((design.conj().T @ design).real)
        found = corrected_covariance(
            rows,
            experiment.edges,
            np.zeros(2),
            heading_noise=size,
            spread=(design.conj().T @ spread @ design).real,
            variance=spread[0, 0],
        )
        expected = inverse @ middle @ inverse
        sizes = np.sqrt(np.diag(expected))
        np.testing.assert_allclose(
            found / np.outer(sizes, sizes), expected / np.outer(sizes, sizes), atol=0.005
        )
        without = inverse @ (design.conj().T @ spread @ design).real @ inverse
        assert np.diag(found / without).min() > 1.04

    def test_what_headings_alone_scatter(self):
        # By errors e^(j e) - k of simulated headings, less what each sample's own adds on average.
        problem = make(position="1e-6 mm", heading="5 deg", segments=4)
        experiment, size = Experiment(problem, DRIVE), math.radians(5)
        shrink = math.exp(-(size**2) / 2)
        rows = experiment.rows(C[0])[0]
        normal = (experiment.designs["position"].conj().T @ experiment.designs["position"]).real
        rng = np.random.default_rng(5)
        spread = np.exp(1j * size * rng.standard_normal((20_000, len(rows)))) - shrink
        total = np.zeros((len(spread), 2))
        for first, last in zip(experiment.edges[:-1], experiment.edges[1:], strict=True):
            part, moves = rows[first:last], rows[first:last] @ C[1]
            scattered = spread[:, first:last] @ part
            moved = spread[:, first:last] * moves
            own = (1 - shrink**2) * moves @ part.conj()
            total -= (part.sum(axis=0).conj() * moved.sum(axis=1)[:, None]).real / shrink
            total -= (scattered.conj() * moved.sum(axis=1)[:, None] - own).real / shrink**2
        inverse = np.linalg.inv(normal)
        sampled = np.cov(total @ inverse, rowvar=False)
        found = Regression(problem, DRIVE, "errors_in_variables", "measured").covariance[2:, 2:]
        sizes = np.sqrt(np.diag(found))
        np.testing.assert_allclose(
            sampled / np.outer(sizes, sizes), found / np.outer(sizes, sizes), atol=0.04
        )


def two_columns(moves: np.ndarray) -> np.ndarray:
    """Complex displacements (P,) as x and y in turn, (2 P,)."""
    return np.column_stack([moves.real, moves.imag]).ravel()


class TestFit:
    """Estimates from readings of one's own."""

    @staticmethod
    def middles(c: np.ndarray) -> np.ndarray:
        """True headings in the middle of every period, (N,)."""
        turns = DRIVE.period * DRIVE.inputs @ c[0]
        return DRIVE.start[2] + np.cumsum(turns) - turns / 2

    @noise_models
    def test_it_is_what_numpy_finds(self, noise_model: str):
        problem = make(noise_model, "1 cm", "3 deg")
        experiment = Experiment(problem, DRIVE)
        turns, moves, errors = experiment.readings(np.random.default_rng(8), 1)
        for name, heading in WAYS:
            regression = Regression(problem, DRIVE, name, heading)
            headings = self.middles(C) + errors[0] if heading == "measured" else None
            found = regression.fit(turns=turns[0], displacements=two_columns(moves[0]), headings=headings)
            expected = experiment.estimated(name, heading, turns, moves, errors)[0]
            np.testing.assert_allclose(found.values, expected, rtol=1e-9, err_msg=f"{name} {heading}")
            assert found.parameters == ("c11", "c12", "c21", "c22")
            np.testing.assert_array_equal(found.covariance, regression.covariance)
            assert (found.converged, found.nuisances, found.nuisance_values.tolist()) == (True, (), [])

    @pytest.mark.parametrize(
        ("name", "heading", "noise_model"),
        [
            ("ols", "predicted", "increments"),
            ("ols", "measured", "absolute"),
            ("gls", "predicted", "absolute"),
            ("gls", "measured", "increments"),
        ],
    )
    def test_readings_without_noise_give_another_robots_c(
        self, name: EstimatorName, heading: Heading, noise_model: str
    ):
        # Its headings are its own: predicted from its turns, or measured.
        other = C * [[1.03, 0.98], [0.97, 1.02]]
        problem = make(noise_model, rule="midpoint")
        turns = DRIVE.period * DRIVE.inputs @ other[0]
        samples = DRIVE.period * np.exp(1j * self.middles(other)) * (DRIVE.inputs @ other[1])
        edges = problem.measurement.segment_edges(40)[:-1]
        found = Regression(problem, DRIVE, name, heading).fit(
            turns=np.add.reduceat(turns, edges),
            displacements=two_columns(np.add.reduceat(samples, edges)),
            headings=self.middles(other) if heading == "measured" else None,
        )
        np.testing.assert_allclose(found.values, other.ravel(), rtol=1e-9)

    @noise_models
    def test_headings_may_be_given_in_any_turn(self, noise_model: str):
        problem = make(noise_model)
        turns, moves, errors = Experiment(problem, DRIVE).readings(np.random.default_rng(8), 1)
        headings = self.middles(C) + errors[0]
        regression = Regression(problem, DRIVE, "errors_in_variables", "measured")
        whole, wrapped = (
            regression.fit(turns=turns[0], displacements=two_columns(moves[0]), headings=given).values
            for given in (headings, np.angle(np.exp(1j * headings)))
        )
        np.testing.assert_allclose(whole, wrapped, rtol=1e-9)

    @pytest.mark.parametrize("name", ["ols", "sandwich", "gls"])
    @noise_models
    def test_residuals_are_readings_less_their_prediction(self, name: EstimatorName, noise_model: str):
        experiment = Experiment(make(noise_model), DRIVE)
        turns, moves, _ = experiment.readings(np.random.default_rng(8), 1)
        found = Regression(make(noise_model), DRIVE, name).fit(
            turns=turns[0], displacements=two_columns(moves[0])
        )
        spread = experiment.differences @ experiment.differences.T
        whitener = np.linalg.inv(np.linalg.cholesky(spread))
        misfits = [
            readings[0] - experiment.designs[block] @ found.values[first : first + 2]
            for first, block, readings in ((0, "heading", turns), (2, "position", moves))
        ]
        white = [
            whitener @ misfits[0] / math.radians(2),
            two_columns(whitener @ misfits[1] / 0.01),
        ]
        np.testing.assert_allclose(found.residuals, np.concatenate(white), rtol=1e-6, atol=1e-9)

    @pytest.mark.parametrize("name", ["ols", "gls"])
    @noise_models
    def test_it_is_a_fit_like_every_other(self, name: EstimatorName, noise_model: str):
        regression = Regression(make(noise_model), DRIVE, name)
        turns, moves, _ = Experiment(make(noise_model), DRIVE).readings(np.random.default_rng(8), 1)
        readings = {"heading": turns, "position": two_columns(moves[0])[None]}
        fit = regression._fit(readings, regression._estimates(readings)[0], None)
        assert (fit.layout.count, fit.white.shape, fit.unknowns.names) == (
            10,
            (10, 3, 1),
            regression.parameters,
        )
        assert fit.weights.shape == fit.residuals.shape == fit.white.shape
        steps = fit.inverse @ fit.scores.sum(axis=0) / np.sqrt(np.diag(fit.inverse))
        np.testing.assert_allclose(steps, 0, atol=1e-9)
        assert fit.redundancy.sum() == pytest.approx(30 - 4)
        if (name, noise_model) != ("ols", "absolute"):
            np.testing.assert_allclose(fit.inverse, regression.covariance, rtol=1e-9, atol=1e-20)

    @pytest.mark.parametrize("heading", ["predicted", "measured"])
    def test_a_perfect_fit_has_no_residuals(self, heading: Heading):
        other = C * [[1.03, 0.98], [0.97, 1.02]]
        problem = make(rule="midpoint")
        turns = DRIVE.period * DRIVE.inputs @ other[0]
        samples = DRIVE.period * np.exp(1j * self.middles(other)) * (DRIVE.inputs @ other[1])
        edges = problem.measurement.segment_edges(40)[:-1]
        found = Regression(problem, DRIVE, "ols", heading).fit(
            turns=np.add.reduceat(turns, edges),
            displacements=two_columns(np.add.reduceat(samples, edges)),
            headings=self.middles(other) if heading == "measured" else None,
        )
        np.testing.assert_allclose(found.residuals, 0, atol=1e-6)

    def test_only_what_is_used_is_needed(self):
        turns, moves = np.zeros(10), np.zeros(20)
        Regression(make(regressor="heading"), DRIVE, "ols").fit(turns=turns)
        Regression(make(regressor="position"), DRIVE, "ols").fit(displacements=moves)
        Regression(make(regressor="heading"), DRIVE, "ols", "measured").fit(turns=turns)
        Regression(make(regressor="position"), DRIVE, "ols", "measured").fit(
            displacements=moves, headings=np.zeros(40)
        )
        # Predicted headings come from the turns.
        predicted = Regression(make(regressor="position"), DRIVE, "ols", "predicted")
        found = predicted.fit(turns=turns, displacements=moves)
        assert found.parameters == ("c21", "c22")
        with pytest.raises(ValueError, match="expected 10 finite turns, got 0"):
            predicted.fit(displacements=moves)

    def test_readings_that_cannot_be_used(self):
        regression = Regression(make(), DRIVE, "ols", "measured")
        counts = {"turns": 10, "displacements": 20, "headings": 40}
        readings = {what: [0.1] * count for what, count in counts.items()}
        for what, count in counts.items():
            few = [0.1] * (count - 1)
            for faulty in (None, few, [*few, 0.1, 0.1], [math.nan, *few], [*few, math.inf]):
                with pytest.raises(ValueError, match=f"expected {count} finite {what}"):
                    regression.fit(**{**readings, what: faulty})


class Guesses(Measurement):
    """Neither displacements nor a sensor."""

    kind: str = "guesses"

    def blocks(self, drive):
        return Displacements().blocks(drive)


POSES = Poses(noise={"position": 1e-3, "heading": 0.01})
RANGES = Ranges(beacons=((1, 2), (3, 4)), noise=0.01)
BOTH = Several(sensors=[POSES, YawRate(noise=0.01)])


@cache
def issues_of(measurement: Measurement, name=None, heading: Heading = "known") -> list[Issue]:
    """The issues, which `make_estimator` raises."""
    issues = estimator_issues(measurement, name, heading)
    problem = problem_of(measurement=measurement)
    if not issues:
        assert make_estimator(problem, DRIVE, name, heading=heading).name
        return []
    with pytest.raises(ProblemError) as raised:
        make_estimator(problem, DRIVE, name, heading=heading)
    assert raised.value.issues == tuple(issues)
    return issues


class TestMistakes:
    """What does not suit is said with the key to change."""

    @staticmethod
    def displacements(noise: Mapping[str, str] | None = None, **parts) -> Displacements:
        return Displacements(
            noise={"position": "1 cm", "heading": "1 deg"} if noise is None else noise, **parts
        )

    def test_what_suits_has_no_issue(self):
        for (name, heading), noise_model, regressor in product(
            WAYS, NOISE_MODELS, ("position", "heading", "both")
        ):
            measurement = self.displacements(noise_model=noise_model, regressor=regressor)
            assert estimator_issues(measurement, name, heading) == [], (name, heading, regressor)

    @pytest.mark.parametrize("name", ["nonlinear", "magic"])
    def test_methods_of_displacements(self, name: str):
        (issue,) = issues_of(self.displacements(), name)
        assert issue.key == ("validation", "estimators")
        assert issue.message == (
            f"displacements are estimated by ols, sandwich, gls, errors_in_variables; not by {name}"
        )

    @pytest.mark.parametrize("heading", ["known", "predicted"])
    def test_errors_in_variables_are_those_of_measured_headings(self, heading: Heading):
        (issue,) = issues_of(self.displacements(), "errors_in_variables", heading)
        assert issue.key == ("validation", "heading")
        assert issue.message == f"errors in variables are those of heading: measured; these are {heading}"

    @pytest.mark.parametrize(
        ("name", "regressor", "noise", "missing"),
        [
            (None, "position", {"position": "1 cm"}, "heading"),
            ("ols", "position", {"heading": "1 deg"}, "position"),
            ("gls", "heading", {"position": "1 cm"}, "heading"),
            ("errors_in_variables", "both", {}, "heading, position"),
        ],
    )
    def test_missing_noise(self, name, regressor: str, noise: dict[str, str], missing: str):
        problem = problem_of(measurement=self.displacements(noise, regressor=regressor))
        issues = estimator_issues(problem.measurement, name, "measured")
        assert issues == [
            Issue(("measurement", "noise"), f"simulating measured headings needs the noise of {missing}")
        ]
        with pytest.raises(ProblemError, match=missing):
            make_estimator(problem, DRIVE, name, heading="measured")

    @pytest.mark.parametrize("measurement", [POSES, RANGES, BOTH], ids=lambda one: one.kind)
    def test_sensors_are_estimated_from_together(self, measurement: Measurement):
        for name in (*METHODS, "magic"):
            (issue,) = issues_of(measurement, name)
            assert issue.key == ("validation", "estimators")
            assert issue.message == (
                f"{measurement.kind} are estimated by nonlinear least squares; not by {name}"
            )

    @pytest.mark.parametrize("measurement", [POSES, RANGES, BOTH], ids=lambda one: one.kind)
    def test_which_is_their_usual_estimator(self, measurement: Measurement):
        assert usual_estimator(measurement) == "nonlinear"
        assert not issues_of(measurement)
        assert not issues_of(measurement, "nonlinear")

    @pytest.mark.parametrize("name", [None, "nonlinear", "ols"])
    def test_a_measurement_of_another_kind(self, name):
        assert issues_of(Guesses(), name) == [Issue(("validation",), "no simulation is known for guesses")]

    def test_joint_least_squares_need_sensors(self):
        with pytest.raises(ProblemError, match="displacements is a regression"):
            Nonlinear(make(), DRIVE)

    @pytest.mark.parametrize("heading", HEADINGS)
    def test_a_drive_that_tells_too_little(self, heading: Heading):
        # Predicted headings need c11 and c12, whatever is asked for.
        straight = Trajectory.from_samples(np.ones((40, 2)), 10.0, (0, 0, 0))
        names = "c11, c12" if heading == "predicted" else "c21, c22"
        for name in (name for name, own in WAYS if own == heading):
            with pytest.raises(ProblemError, match=f"does not identify {names}") as raised:
                Regression(make(regressor="position"), straight, name, heading)
            assert raised.value.issues[0].key == ("validation",)


@distinct_ways
def test_workers_get_the_same(name: EstimatorName, heading: Heading):
    regression = Regression(make("absolute"), DRIVE, name, heading)
    found = [
        np.hstack(one.simulate(np.random.default_rng(1), 5))
        for one in (regression, pickle.loads(pickle.dumps(regression)))
    ]
    np.testing.assert_allclose(found[0], found[1], rtol=1e-12)
