"""Simulated experiments: linear where theory is exact, biased where it says so, and negative controls."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import oracle
import pytest
from builders import RADIUS, SPEED, TRACK, check_all, problem_of, random_drive
from scipy import stats

from oed.estimation.methods import EstimatorName, Heading, Regression, missing_noise
from oed.foundation.errors import ProblemError
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.evaluation import evaluate
from oed.kernel.measurement.measurement import Measurement
from oed.kernel.problem import Problem
from oed.optimize import Silent
from oed.robots.models import SkidSteer
from oed.robots.sensors import Displacements
from oed.simulation import Validation, validate
from oed.simulation.agreement import agreement_text
from oed.simulation.monte_carlo import BATCH, SHOWN

NOISE = {"position": "1 cm", "heading": "2 deg"}
TEN_DEGREES = math.radians(10)
REPLICATES = 4000


@cache
def make(regressor: str = "both", segments: int | str = 10, rule: str = "arc", **noise) -> Problem:
    return problem_of(
        integration=rule,
        measurement=Displacements(segments=segments, regressor=regressor, noise=noise or NOISE),
        limits=(SPEED,),
    )


DRIVE = random_drive(make(), 3, 5.0)
EVERY_WAY: tuple[tuple[EstimatorName, Heading], ...] = (
    ("ols", "known"),
    ("ols", "predicted"),
    ("ols", "measured"),
    ("errors_in_variables", "measured"),
)
every_way = pytest.mark.parametrize(("name", "heading"), EVERY_WAY)


@cache
def validated(
    heading: Heading, regressor: str = "both", noise: tuple[str, str] = ("1 cm", "2 deg")
) -> Validation:
    problem = make(regressor, position=noise[0], heading=noise[1])
    return validate(problem, DRIVE, heading=heading, replicates=REPLICATES, seed=0)


def simulated(
    problem: Problem,
    heading: Heading,
    replicates: int,
    drive: Trajectory = DRIVE,
    seed: int = 0,
    name: EstimatorName = "ols",
):
    """The regression, and its estimates and linear estimates (R, p)."""
    regression = Regression(problem, drive, name, heading)
    return regression, *regression.simulate(np.random.default_rng(seed), replicates)


class TestKnownHeading:
    """Then the estimates are linear in the noise, and the promise is exact."""

    @pytest.mark.parametrize("regressor", ["position", "heading", "both"])
    def test_the_promise_holds(self, regressor: str):
        result = validated("known", regressor)
        assert result.passed
        assert len(result.checks) == 6
        assert "as predicted" in result.verdict
        assert agreement_text(result.largest_ratio) in result.verdict
        assert 1 < result.largest_ratio < 1.06

    def test_estimates_are_linear(self):
        _, estimates, linear = simulated(make(), "known", 200)
        np.testing.assert_allclose(estimates, linear, rtol=1e-13)

    def test_the_paired_ratio_is_exactly_one(self):
        np.testing.assert_allclose(validated("known").paired_ratio, np.ones(4), rtol=1e-12)
        np.testing.assert_allclose(validated("known").paired_error, np.zeros(4), atol=1e-12)

    def test_the_sample_covariance_is_within_its_interval(self):
        result = validated("known")
        share = np.diag(result.sampled) / np.diag(result.predicted)
        low, high = stats.chi2.ppf([0.0005, 0.9995], REPLICATES - 1) / (REPLICATES - 1)
        assert np.all((low < share) & (share < high))

    def test_the_promise_is_sigma_squared_times_the_inverse(self):
        designs = evaluate(make(), DRIVE).design_matrices
        expected = np.zeros((4, 4))
        expected[:2, :2] = math.radians(2) ** 2 * np.linalg.inv(designs["heading"].T @ designs["heading"])
        expected[2:, 2:] = 0.01**2 * np.linalg.inv(designs["position"].T @ designs["position"])
        np.testing.assert_allclose(validated("known").predicted, expected, rtol=1e-9, atol=1e-18)
        deviations = evaluate(make(), DRIVE).standard_deviations
        np.testing.assert_allclose(np.sqrt(np.diag(expected)), list(deviations.values()), rtol=1e-9)

    def test_what_is_compared(self):
        result = validated("known")
        assert result.parameters == ("c11", "c12", "c21", "c22")
        np.testing.assert_allclose(
            result.true, [RADIUS / TRACK, -RADIUS / TRACK, RADIUS / 2, RADIUS / 2], rtol=1e-14
        )
        assert validated("known", "position").parameters == ("c21", "c22")
        assert (result.replicates, result.seed, result.alpha) == (REPLICATES, 0, 0.01)
        assert (result.estimator, result.heading) == ("ols", "known")
        assert result.estimates.shape == (SHOWN, 4)
        standard_errors = np.sqrt(np.diag(result.predicted) / REPLICATES)
        assert np.all(np.abs(result.mean - result.true) < 4 * standard_errors)

    def test_a_robot_with_slip(self):
        robot = SkidSteer(wheel_radius=RADIUS, track=TRACK, slip_outer=0.1, slip_inner=-0.05)
        problem = problem_of(model=robot, measurement=Displacements(segments=10, noise=NOISE))
        assert validate(problem, random_drive(problem, 3, 5.0), replicates=1000).passed


class TestNegativeControls:
    """A wrong covariance must not pass."""

    @staticmethod
    def passes(seed: int, replicates: int, factor: float) -> bool:
        """Whether `factor` times the right covariance passes."""
        regression, estimates, _ = simulated(make(), "known", replicates, seed=seed)
        assert regression.covariance.shape == (4, 4)
        checks = check_all(estimates - regression.true, factor * regression.covariance, 0.01)
        return all(check.passed for check in checks)

    @pytest.mark.slow
    def test_five_per_cent(self):
        # 4000 replicates see it nine times in ten, 10,000 always.
        assert sum(self.passes(seed, REPLICATES, 0.95) for seed in range(10)) <= 3
        assert not any(self.passes(seed, 10_000, 1.05) for seed in range(3))

    @pytest.mark.slow
    def test_the_right_one_passes(self):
        assert all(self.passes(seed, REPLICATES, 1.0) for seed in range(5))

    @pytest.mark.parametrize("seed", range(3))
    def test_the_naive_covariance_under_noise_of_absolute_poses(self, seed: int):
        # Differences D n of absolute positions: neighbouring displacements share an error, so the naive
        # 2 sigma^2 (W'W)^-1 is wrong; the sandwich sigma^2 S W' D D' W S is right.
        problem, sigma = make("position"), 0.01
        design = Regression(problem, DRIVE, "ols").regressors.nominal_designs["position"]
        segments = len(design) // 2
        differences = np.kron(np.diff(np.eye(segments + 1), axis=0), np.eye(2))
        noise = sigma * np.random.default_rng(seed).standard_normal((REPLICATES, 2 * (segments + 1)))
        errors = noise @ differences.T @ np.linalg.pinv(design).T
        inverse = np.linalg.inv(design.T @ design)
        naive = 2 * sigma**2 * inverse
        middle = design.T @ differences @ differences.T @ design
        sandwich = sigma**2 * inverse @ middle @ inverse
        assert not all(check.passed for check in check_all(errors, naive, 0.01))
        assert all(check.passed for check in check_all(errors, sandwich, 0.01))

    def test_a_broken_promise_is_put_into_words(self):
        result = validated("measured", "position", ("1 mm", "10 deg"))
        assert not result.passed
        assert "the prediction did not hold" in result.verdict
        failed = [check.name for check in result.checks if not check.passed]
        assert ", ".join(failed) in result.verdict
        assert "times as much as predicted" in result.verdict
        assert "confidence" not in result.verdict


class TestPredictedHeading:
    """The first stage's errors enter the second: its positions scatter more than predicted."""

    @pytest.mark.slow
    def test_little_noise_of_the_turns_does_little(self):
        result = validated("predicted", "position", ("1 cm", "0.001 deg"))
        np.testing.assert_allclose(result.paired_ratio, 1, atol=1e-3)
        assert result.passed

    def test_much_noise_is_noticed(self):
        result = validated("predicted", "position", ("1 mm", "5 deg"))
        assert not result.passed
        assert result.paired_ratio.max() > 1 + 5 * result.paired_error[result.paired_ratio.argmax()]

    def test_the_first_stage_itself_stays_linear(self):
        _, estimates, linear = simulated(make(), "predicted", 50)
        np.testing.assert_allclose(estimates[:, :2], linear[:, :2], rtol=1e-13)
        assert np.abs(estimates[:, 2:] - linear[:, 2:]).max() > 0

    def test_estimates_are_least_squares_with_predicted_headings(self):
        # By the oracle: y from the true drive and noise, W from the headings of the first estimate.
        problem = make(position="0.001 mm", heading="2 deg")
        regression, estimates, _ = simulated(problem, "predicted", 20)
        edges = problem.measurement.segment_edges(40)
        true = regression.regressors.nominal_designs["position"] @ regression.regressors.true["position"]
        for estimate in estimates:
            rates = DRIVE.inputs @ estimate[:2]
            headings = DRIVE.period * np.concatenate([[0.0], np.cumsum(rates)[:-1]])
            _, design = oracle.segment_regressors(DRIVE.inputs, headings, rates, DRIVE.period, edges, "arc")
            expected = np.linalg.lstsq(design, true, rcond=None)[0]
            np.testing.assert_allclose(estimate[2:], expected, atol=1e-6)


@pytest.mark.parametrize(("name", "heading"), EVERY_WAY[1:])
def test_linear_estimates_hold_the_first_order_of_all_noise(name: EstimatorName, heading: Heading):
    # Half the noise, drawn alike, leaves a quarter of what is not linear.
    whole, half = (
        simulated(make(position=f"{size} mm", heading=f"{size} deg"), heading, 200, name=name)
        for size in (0.2, 0.1)
    )
    regression, estimates, linear = whole
    np.testing.assert_allclose(linear - regression.true, 2 * (half[2] - regression.true), atol=1e-12)
    rest, quarter = np.abs(estimates - linear).sum(), np.abs(half[1] - half[2]).sum()
    assert 0 < rest < 0.05 * np.abs(linear - regression.true).sum()
    assert quarter == pytest.approx(rest / 4, rel=0.02)


@cache
def long_drive(segments: int | str) -> tuple[Problem, Trajectory]:
    """100 s of fast winding with hardly any position noise, headings measured to 10 degrees."""
    problem = problem_of(
        duration=100,
        samples=1000,
        coefficients=60,
        measurement=Displacements(segments=segments, noise={"position": "1 mm", "heading": "10 deg"}),
        limits=(SPEED,),
    )
    return problem, random_drive(problem, 1, 8.0)


class TestMeasuredHeading:
    """Errors in variables: known shrinkage, and a correction that removes it (STATISTICS, section 3)."""

    shrink = math.exp(-(TEN_DEGREES**2) / 2)

    def paired_bias(self, name: EstimatorName, segments: int | str, replicates: int = 800):
        """Mean of (estimate - linear estimate) / truth and its standard error, (p,) each."""
        problem, drive = long_drive(segments)
        regression, estimates, linear = simulated(problem, "measured", replicates, drive, name=name)
        shares = (estimates - linear) / regression.true
        return regression, shares.mean(axis=0), shares.std(axis=0, ddof=1) / math.sqrt(replicates)

    def test_ten_degrees(self):
        assert self.shrink - 1 == pytest.approx(-0.0151, abs=5e-5)

    @pytest.mark.slow
    def test_per_sample_estimates_shrink(self):
        _, bias, error = self.paired_bias("ols", "samples")
        assert error.max() < 5e-4
        np.testing.assert_allclose(bias, self.shrink - 1, atol=4 * error.max())

    @pytest.mark.slow
    def test_per_segment_estimates_tend_to_the_formula(self):
        # [k^2 W'W + (1 - k^2) S1]^-1 k W'W c with S1 the sum of the samples' own W'W.
        regression, bias, error = self.paired_bias("ols", 100)
        design, k = regression.regressors.nominal_designs["position"], self.shrink
        information = design.T @ design
        rows = regression.regressors.per_sample.reshape(-1, 2)
        own = rows.T @ rows
        normal = k**2 * information + (1 - k**2) * own
        limit = np.linalg.solve(normal, k * information @ regression.true)
        expected = limit / regression.true - 1
        assert np.abs(expected).min() > 20 * error.max()
        np.testing.assert_allclose(bias, expected, atol=4 * error.max() + 0.05 * np.abs(expected).max())

    @pytest.mark.parametrize("segments", ["samples", 100])
    @pytest.mark.slow
    def test_the_correction_removes_it(self, segments):
        _, bias, error = self.paired_bias("errors_in_variables", segments)
        assert error.max() < 2e-4
        assert np.abs(bias).max() < 5e-4 + 3 * error.max()

    @pytest.mark.slow
    def test_without_noise_all_agree(self):
        problem = make("position", position="1 cm", heading="1e-6 deg")
        expected = simulated(problem, "known", 100)[1]
        assert expected.shape == (100, 2)
        for name, heading in EVERY_WAY[1:]:
            _, found, linear = simulated(problem, heading, 100, name=name)
            np.testing.assert_allclose(found, linear, atol=1e-8)

    @pytest.mark.parametrize("name", ["ols", "errors_in_variables"])
    def test_only_positions_are_concerned(self, name: EstimatorName):
        _, estimates, linear = simulated(make(), "measured", 50, name=name)
        np.testing.assert_allclose(estimates[:, :2], linear[:, :2], rtol=1e-13)


def same(first: Validation, second: Validation) -> None:
    for name in ("mean", "sampled", "paired_ratio", "paired_error", "estimates"):
        np.testing.assert_allclose(getattr(first, name), getattr(second, name), rtol=1e-10)
    for one, other in zip(first.checks, second.checks, strict=True):
        assert one.statistic == pytest.approx(other.statistic, rel=1e-9)
        assert one.passed == other.passed


class TestSeed:
    @every_way
    @pytest.mark.slow
    def test_the_same_seed_gives_the_same_result(self, name: EstimatorName, heading: Heading):
        first, again, other = (
            validate(make(), DRIVE, estimator=name, heading=heading, replicates=300, seed=seed)
            for seed in (1, 1, 2)
        )
        np.testing.assert_array_equal(first.estimates, again.estimates)
        np.testing.assert_array_equal(first.sampled, again.sampled)
        assert np.abs(first.estimates - other.estimates).max() > 0

    @pytest.mark.slow
    @pytest.mark.parametrize("heading", ["known", "predicted"])
    def test_whatever_the_workers(self, heading: Heading):
        replicates = 2 * BATCH + 500
        single, double = (
            validate(make(), DRIVE, heading=heading, replicates=replicates, seed=1, workers=workers)
            for workers in (1, 2)
        )
        assert single.replicates == double.replicates == replicates
        same(single, double)

    def test_more_replicates_begin_with_the_same(self):
        few, many = (validate(make(), DRIVE, replicates=count, seed=1) for count in (BATCH, BATCH + 300))
        np.testing.assert_array_equal(few.estimates, many.estimates)
        assert many.replicates == BATCH + 300

    def test_batches_differ(self):
        result, half = (validate(make(), DRIVE, replicates=count * BATCH, seed=1) for count in (2, 1))
        assert np.abs(result.mean - half.mean).max() > 0

    def test_progress_is_told(self):
        class Listener(Silent):
            total, steps = 0, 0

            def begin(self, description: str, total: int) -> None:
                self.total = total

            def advance(self, note: str = "") -> None:
                self.steps += 1

        listener = Listener()
        validate(make(), DRIVE, replicates=2 * BATCH + 1, progress=listener)
        assert (listener.total, listener.steps) == (3, 3)


class TestMistakes:
    @pytest.mark.parametrize(
        ("regressor", "heading", "noise", "missing"),
        [
            ("position", "known", {"heading": 0.1}, ["position"]),
            ("heading", "known", {"position": 0.1}, ["heading"]),
            ("both", "known", {"position": 0.1}, ["heading"]),
            ("position", "predicted", {"position": 0.1}, ["heading"]),
            ("position", "measured", {"heading": 0.1}, ["position"]),
            ("position", "measured", {"position": 0.1}, ["heading"]),
            ("position", "known", {"position": 0.1}, []),
        ],
    )
    def test_missing_noise(
        self, regressor: str, heading: Heading, noise: dict[str, float], missing: list[str]
    ):
        problem = make(regressor, **noise)
        assert missing_noise(problem.measurement, heading) == missing
        if missing:
            text = f"simulating {heading} headings needs the noise of {', '.join(missing)}"
            with pytest.raises(ProblemError, match=text):
                validate(problem, DRIVE, heading=heading, replicates=100)
        else:
            assert validate(problem, DRIVE, heading=heading, replicates=100).replicates == 100

    @pytest.mark.parametrize(
        ("speeds", "regressor", "names"),
        [((1, 1), "position", "c21, c22"), ((0, 0), "heading", "c11, c12"), ((1, 1), "both", "c11, c12")],
    )
    def test_a_singular_design(self, speeds, regressor: str, names: str):
        drive = Trajectory.from_samples(np.tile(speeds, (40, 1)), 10.0, (0, 0, 0))
        with pytest.raises(ProblemError, match=f"does not identify {names}"):
            validate(make(regressor), drive, replicates=100)

    def test_another_measurement(self):
        class Guesses(Measurement):
            kind: str = "guesses"

            def blocks(self, drive):
                return Displacements().blocks(drive)

        problem = problem_of(measurement=Guesses())
        with pytest.raises(ProblemError, match="no simulation is known for guesses"):
            validate(problem, DRIVE, replicates=100)


@pytest.mark.parametrize("replicates", [-1, 0, 1, 4])
def test_fewer_experiments_than_a_covariance_needs_are_refused(replicates: int):
    with pytest.raises(
        ProblemError, match=rf"validation.replicates: expected at least 5, .* got {replicates}$"
    ):
        validate(make(), DRIVE, replicates=replicates)
    assert validate(make(), DRIVE, replicates=5).replicates == 5
