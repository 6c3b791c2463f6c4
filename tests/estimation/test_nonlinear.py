"""Joint least squares against `evaluate`, against SciPy on plain loops, and against simulated readings."""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, partial
from typing import NamedTuple

import numpy as np
import oracle
import pytest
from builders import RADIUS, SPEED, TRACK, check_all, problem_of, random_drive
from scipy.integrate import trapezoid
from scipy.optimize import OptimizeResult, least_squares
from scipy.stats import norm

from oed.estimation.methods import Estimate, Nonlinear
from oed.estimation.methods.gauss_newton import loss_moments, robust_loss
from oed.estimation.methods.joint import JointSearch
from oed.estimation.methods.side_by_side import SideBySide
from oed.estimation.setup.options import Loss
from oed.foundation.errors import ProblemError, UserMistake
from oed.kernel.criteria import E
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.evaluation import evaluate
from oed.kernel.measurement.prior import Prior
from oed.kernel.problem import Problem
from oed.robots.models import SkidSteer
from oed.robots.sensors import Poses, Ranges, Several, YawRate
from oed.robots.space import StartPose
from oed.simulation import validate

START = (0.2, -0.1, 0.4)
BEACONS = ((4.0, 3.0), (-3.5, 2.5), (0.5, -4.0))
C = ("c11", "c12", "c21", "c22")
GEOMETRY = (RADIUS, RADIUS, TRACK)
UNKNOWN = (math.inf,) * 3
CORRELATED = 1e-6 * np.kron(0.6 ** np.abs(np.subtract.outer(range(9), range(9))), [[1.0, 0.3], [0.3, 2.0]])
ROBUST: tuple[Loss, ...] = ("huber", "soft_l1", "cauchy")
REPLICATES = 180

Read = Callable[[np.ndarray, np.ndarray, Sequence[float]], np.ndarray]


sensed_problem = partial(
    problem_of,
    period=0.25,
    start=StartPose(x=START[0], y=START[1], heading=START[2]),
    limits=(SPEED,),
    criterion=E(),
)
"""Drives of a quarter of a second per sample, from a start of its own."""


def pose_readings(quantities: str, every: int = 1) -> Read:
    """Some of x, y and heading ("xyh") at the end of an arm, pose by pose."""

    def read(poses, twists, own):
        ahead, left = own or (0.0, 0.0)
        x, y, heading = poses[::every].T
        table = {
            "x": x + ahead * np.cos(heading) - left * np.sin(heading),
            "y": y + ahead * np.sin(heading) + left * np.cos(heading),
            "h": heading,
        }
        return np.column_stack([table[quantity] for quantity in quantities]).ravel()

    return read


def distances(poses, twists, own):
    return np.column_stack([np.hypot(*(poses[:, :2] - beacon).T) for beacon in BEACONS]).ravel()


def yaw_rates(poses, twists, own):
    return twists[:, 2] + sum(own)


@dataclass(frozen=True)
class Sensor:
    """A sensor without the package.

    Attributes:
        read: its readings of poses (N + 1, 3), twists (N, 3) and its own nuisances.
        deviations: of one moment's readings, or a covariance of all readings.
        own: nominal value and standard deviation known beforehand of each of its own nuisances.
    """

    read: Read
    deviations: np.ndarray
    own: tuple[tuple[float, float], ...] = ()

    def covariance(self, count: int) -> np.ndarray:
        if self.deviations.ndim == 2:
            return self.deviations
        return np.diag(np.resize(self.deviations, count) ** 2)


@dataclass(frozen=True)
class Case:
    """A problem with sensors and the same written without the package.

    Attributes:
        name: shown in test ids.
        problem: of the package.
        sensors: the same.
        start: standard deviations known beforehand of the initial pose; () where it is known.
        before: covariance of parameters known beforehand, by their places.
        coefficients: whether c11, ..., c22 are the parameters.
    """

    name: str
    problem: Problem
    sensors: tuple[Sensor, ...]
    start: tuple[float, ...] = UNKNOWN
    before: tuple[tuple[int, ...], np.ndarray] | None = None
    coefficients: bool = False

    @cached_property
    def drive(self) -> Trajectory:
        return random_drive(self.problem, 3, 5.0)

    @cached_property
    def estimator(self) -> Nonlinear:
        return Nonlinear(self.problem, self.drive)

    @property
    def parameters(self) -> np.ndarray:
        if not self.coefficients:
            return np.array(GEOMETRY)
        return np.array([RADIUS / TRACK, -RADIUS / TRACK, RADIUS / 2, RADIUS / 2])

    @property
    def nominal(self) -> np.ndarray:
        """Parameters, initial pose where it is unknown, the sensors' nuisances."""
        own = [value for sensor in self.sensors for value, _ in sensor.own]
        return np.array([*self.parameters, *(START if self.start else ()), *own])

    @cached_property
    def sizes(self) -> np.ndarray:
        """Nominal sizes of the parameters, 1 of all else."""
        count = len(self.nominal) - len(self.parameters)
        return np.concatenate([np.abs(self.parameters), np.ones(count)])

    def readings(self, values: np.ndarray) -> np.ndarray:
        """All sensors' readings (M,) for values of all unknowns."""
        count = len(self.parameters)
        if self.coefficients:
            product = self.drive.inputs @ np.reshape(values[:4], (2, 2)).T
            twists = np.column_stack([product[:, 1], np.zeros(len(product)), product[:, 0]])
        else:
            twists = np.array([oracle.differential_twist(row, *values[:3]) for row in self.drive.inputs])
        start = values[count : count + 3] if self.start else START
        poses = oracle.roll_out(twists, start, self.drive.period, "arc")
        rows, begin = [], count + len(self.start)
        for sensor in self.sensors:
            own = values[begin : (begin := begin + len(sensor.own))].tolist()
            rows.append(sensor.read(poses, twists, own))
        return np.concatenate(rows)

    @cached_property
    def whitener(self) -> np.ndarray:
        """(M, M), from errors to standard normal numbers."""
        counts = [
            len(sensor.read(np.zeros((self.drive.samples + 1, 3)), np.zeros((self.drive.samples, 3)), ()))
            for sensor in self.sensors
        ]
        total, first = np.zeros((sum(counts),) * 2), 0
        for sensor, count in zip(self.sensors, counts, strict=True):
            block = slice(first, first := first + count)
            total[block, block] = np.linalg.inv(np.linalg.cholesky(sensor.covariance(count)))
        return total

    @cached_property
    def precision(self) -> np.ndarray:
        """What is known of all unknowns beforehand."""
        own = [deviation for sensor in self.sensors for _, deviation in sensor.own]
        deviations = np.array([*[math.inf] * len(self.parameters), *self.start, *own])
        matrix = np.diag(deviations**-2)
        if self.before is not None:
            places, covariance = self.before
            matrix[np.ix_(places, places)] += np.linalg.inv(covariance)
        return matrix

    @cached_property
    def white_jacobian(self) -> np.ndarray:
        return self.whitener @ oracle.central_difference(self.readings, self.nominal)

    @property
    def covariance(self) -> np.ndarray:
        """F^-1 of the parameters, all else unknown as well."""
        return self.robust_covariance("linear")

    def robust_covariance(self, loss: Loss) -> np.ndarray:
        """H^-1 M H^-1 with H = E[psi'] J'J + P and M = E[psi^2] J'J + P."""
        information, (slope, square) = self.white_jacobian.T @ self.white_jacobian, MOMENTS[loss]
        inverse = scaled_inverse(slope * information + self.precision)
        count = len(self.parameters)
        return (inverse @ (square * information + self.precision) @ inverse)[:count, :count]

    def fit(self, readings: np.ndarray, before: np.ndarray | None = None, loss: Loss = "linear"):
        """SciPy's estimate with derivatives by differences, from a start far off."""
        known = self.nominal if before is None else before
        values, vectors = np.linalg.eigh(self.precision)
        root = (vectors * np.sqrt(np.maximum(values, 0))).T[values > 0]

        def residuals(scaled: np.ndarray) -> np.ndarray:
            unknowns = scaled * self.sizes
            misfit = self.whitener @ (self.readings(unknowns) - readings)
            return np.concatenate([misfit, root @ (unknowns - known)])

        start = self.nominal / self.sizes * 1.01
        result: OptimizeResult = least_squares(
            residuals, start, jac="3-point", loss=loss, xtol=1e-14, ftol=1e-14, gtol=1e-14
        )
        return result.x * self.sizes


def scaled_inverse(matrix: np.ndarray) -> np.ndarray:
    sizes = np.sqrt(np.diag(matrix))
    return np.linalg.inv(matrix / np.outer(sizes, sizes)) / np.outer(sizes, sizes)


def moments(psi: Callable[[np.ndarray], np.ndarray]) -> tuple[float, float]:
    """E[psi'(z)] = E[z psi(z)] and E[psi(z)^2] of a standard normal z, on a fine grid."""
    grid = np.linspace(-12, 12, 240_001)
    weights = norm.pdf(grid)
    return trapezoid(grid * psi(grid) * weights, grid), trapezoid(psi(grid) ** 2 * weights, grid)


PSI: dict[Loss, Callable[[np.ndarray], np.ndarray]] = {
    "linear": lambda z: z,
    "huber": lambda z: np.clip(z, -1, 1),
    "soft_l1": lambda z: z / np.sqrt(1 + z**2),
    "cauchy": lambda z: z / (1 + z**2),
}
MOMENTS = {loss: moments(psi) for loss, psi in PSI.items()}

XYH = {"position": 2e-3, "heading": 0.02}
PRECISE = {"position": 5e-4, "heading": 5e-3}
PRIOR_COVARIANCE = np.array([[4e-6, -1e-7], [-1e-7, 1e-8]])

CASES = (
    Case(
        "poses",
        sensed_problem(measurement=Poses(noise=XYH)),
        (Sensor(pose_readings("xyh"), np.array([2e-3, 2e-3, 0.02])),),
    ),
    Case(
        "coefficients",
        sensed_problem(measurement=Poses(noise=XYH), estimate=C),
        (Sensor(pose_readings("xyh"), np.array([2e-3, 2e-3, 0.02])),),
        coefficients=True,
    ),
    Case(
        "much_known_before",
        sensed_problem(
            measurement=Poses(
                noise=XYH,
                initial_pose={"position": 2e-3, "heading": 0.01},
                lever_arm={"x": 0.1, "y": 0.02, "known": False},
            ),
            prior=Prior(standard_deviations={"track": "0.3 %", "wheel_radius_left": "0.1 mm"}),
        ),
        (Sensor(pose_readings("xyh"), np.array([2e-3, 2e-3, 0.02]), ((0.1, math.inf), (0.02, math.inf))),),
        start=(2e-3, 2e-3, 0.01),
        before=((1, 2), np.diag([1e-4, 0.003 * TRACK]) ** 2),
    ),
    Case(
        "correlated_prior",
        sensed_problem(
            measurement=Poses(noise=XYH, every=4, initial_pose="known"),
            prior=Prior(parameters=("track", "wheel_radius_right"), covariance=PRIOR_COVARIANCE.tolist()),
        ),
        (Sensor(pose_readings("xyh", 4), np.array([2e-3, 2e-3, 0.02])),),
        start=(),
        before=((2, 0), PRIOR_COVARIANCE),
    ),
    Case(
        "correlated_over_time",
        sensed_problem(
            measurement=Poses(quantities=("x", "y"), noise={"covariance": CORRELATED.tolist()}, every=5)
        ),
        (Sensor(pose_readings("xy", 5), CORRELATED),),
    ),
    Case(
        "ranges",
        sensed_problem(measurement=Ranges(beacons=BEACONS, noise=3e-3)),
        (Sensor(distances, np.array([3e-3] * 3)),),
    ),
    Case(
        "positions_and_a_gyro",
        sensed_problem(
            measurement=Several(
                sensors=[Poses(quantities=("x", "y"), noise={"position": 2e-3}), YawRate(noise=0.02)]
            )
        ),
        (
            Sensor(pose_readings("xy"), np.array([2e-3])),
            Sensor(yaw_rates, np.array([0.02]), ((0.0, math.inf),)),
        ),
    ),
    Case(
        "three_sensors",
        sensed_problem(
            measurement=Several(
                sensors=[
                    YawRate(noise=0.02, bias=0.01),
                    Ranges(beacons=BEACONS, noise=5e-3),
                    Poses(quantities=("heading",), noise={"heading": 0.02}),
                ]
            )
        ),
        (
            Sensor(yaw_rates, np.array([0.02]), ((0.0, 0.01),)),
            Sensor(distances, np.array([5e-3] * 3)),
            Sensor(pose_readings("h"), np.array([0.02])),
        ),
    ),
)
PLAIN = CASES[0]

cases = pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
losses = pytest.mark.parametrize("loss", ROBUST)


def assert_same_estimate(found: np.ndarray, expected: np.ndarray, covariance: np.ndarray, share: float):
    """Equal to a share of the standard deviations."""
    assert np.abs((found - expected) / np.sqrt(np.diag(covariance))).max() < share


class TestPromise:
    """The covariance is the inverse of the information that the design maximised."""

    @cases
    def test_it_is_what_evaluate_says(self, case: Case):
        told = evaluate(case.problem, case.drive)
        assert case.estimator.parameters == told.parameters["joint"]
        np.testing.assert_allclose(case.estimator.covariance, told.covariances["joint"], rtol=1e-8)
        np.testing.assert_array_equal(case.estimator.linear_covariance, case.estimator.covariance)

    @cases
    def test_it_is_what_loops_and_differences_say(self, case: Case):
        sizes = np.sqrt(np.diag(case.covariance))
        found = case.estimator.covariance / np.outer(sizes, sizes)
        np.testing.assert_allclose(found, case.covariance / np.outer(sizes, sizes), atol=1e-5)

    @cases
    def test_readings_and_unknowns_are_the_same(self, case: Case):
        np.testing.assert_allclose(case.estimator.predicted(), case.readings(case.nominal), atol=1e-6)
        np.testing.assert_allclose(case.estimator.true, case.parameters, rtol=1e-14)
        assert len(case.estimator.parameters) + len(case.estimator.nuisances) == len(case.nominal)

    def test_names_of_the_nuisances(self):
        start = ("initial_pose.x", "initial_pose.y", "initial_pose.heading")
        assert {case.name: case.estimator.nuisances for case in CASES} == {
            "poses": start,
            "coefficients": start,
            "much_known_before": (*start, "poses.lever_arm.x", "poses.lever_arm.y"),
            "correlated_prior": (),
            "correlated_over_time": start,
            "ranges": start,
            "positions_and_a_gyro": (*start, "yaw_rate.bias"),
            "three_sensors": (*start, "yaw_rate.bias"),
        }

    @pytest.mark.slow
    def test_noise_that_grows_with_speed(self):
        noise = {"position": 1e-3, "heading": 0.01, "position_per_speed": 0.02, "heading_per_speed": 0.1}
        problem = sensed_problem(measurement=Poses(noise=noise, every=2))
        drive = random_drive(problem, 3, 5.0)
        promised = Nonlinear(problem, drive).covariance
        np.testing.assert_allclose(promised, evaluate(problem, drive).covariances["joint"], rtol=1e-8)
        assert validate(problem, drive, replicates=REPLICATES).passed

    def test_parameters_that_the_criterion_does_not_judge_are_estimated_too(self):
        problem = sensed_problem(measurement=Poses(noise=XYH), criterion=E(subset=("track",)))
        found, told = Nonlinear(problem, PLAIN.drive), evaluate(problem, PLAIN.drive)
        assert found.parameters == ("track", "wheel_radius_right", "wheel_radius_left")
        np.testing.assert_allclose(found.covariance, told.covariances["joint"], rtol=1e-8)
        order = [2, 0, 1]
        np.testing.assert_allclose(
            found.covariance, PLAIN.estimator.covariance[np.ix_(order, order)], rtol=1e-8
        )

    def test_parameters_that_are_not_estimated_are_known(self):
        problem = sensed_problem(measurement=Poses(noise=XYH), estimate=("track",))
        found = Nonlinear(problem, PLAIN.drive)
        assert found.parameters == ("track",)
        assert found.covariance.shape == (1, 1)
        assert found.covariance.item() < PLAIN.estimator.covariance[2, 2]
        np.testing.assert_allclose(
            found.covariance, evaluate(problem, PLAIN.drive).covariances["joint"], rtol=1e-8
        )


def displaced(case: Case) -> np.ndarray:
    """Other values of all unknowns, a percent and a centimetre away."""
    rng = np.random.default_rng(11)
    return case.nominal + 0.01 * case.sizes * rng.choice([-1.0, 1.0], len(case.nominal))


def noisy(case: Case, seed: int, values: np.ndarray | None = None) -> np.ndarray:
    rng = np.random.default_rng(seed)
    exact = case.readings(case.nominal if values is None else values)
    return exact + np.linalg.solve(case.whitener, rng.standard_normal(len(exact)))


class TestFit:
    """Estimates from readings that the package has not simulated."""

    @cases
    def test_readings_without_noise_give_the_truth(self, case: Case):
        truth, count = displaced(case), len(case.parameters)
        found = case.estimator.fit(case.readings(truth), before=truth)
        assert found.converged
        assert found.message
        np.testing.assert_allclose(found.values, truth[:count], rtol=1e-6)
        np.testing.assert_allclose(found.nuisance_values, truth[count:], atol=1e-6)
        np.testing.assert_allclose(found.residuals, 0, atol=1e-2)
        assert found.parameters == case.estimator.parameters
        assert found.nuisances == case.estimator.nuisances

    @pytest.mark.slow
    @cases
    def test_noisy_readings_give_what_scipy_finds(self, case: Case):
        truth, count = displaced(case), len(case.parameters)
        readings = noisy(case, 1, truth)
        found, expected = case.estimator.fit(readings), case.fit(readings)
        assert found.converged
        assert_same_estimate(found.values, expected[:count], case.covariance, 1e-4)
        np.testing.assert_allclose(found.nuisance_values, expected[count:], atol=1e-5)
        # The truth is not far.
        errors = (found.values - truth[:count]) / np.sqrt(np.diag(case.covariance))
        assert case.precision.any() or np.abs(errors).max() < 4

    @cases
    def test_the_covariance_is_that_at_the_estimate(self, case: Case):
        found, count = case.estimator.fit(noisy(case, 2, displaced(case))), len(case.parameters)
        values = np.concatenate([found.values, found.nuisance_values])
        rows = case.whitener @ oracle.central_difference(case.readings, values)
        expected = scaled_inverse(rows.T @ rows + case.precision)[:count, :count]
        sizes = np.sqrt(np.diag(expected))
        shares = found.covariance / np.outer(sizes, sizes)
        np.testing.assert_allclose(shares, expected / np.outer(sizes, sizes), atol=1e-5)
        deviations = dict(zip(found.parameters, np.sqrt(np.diag(found.covariance)), strict=True))
        assert found.standard_deviations == pytest.approx(deviations)

    @cases
    def test_residuals_are_readings_less_their_prediction(self, case: Case):
        readings = noisy(case, 3)
        found = case.estimator.fit(readings)
        values = np.concatenate([found.values, found.nuisance_values])
        expected = case.whitener @ (readings - case.readings(values))
        assert found.residuals.shape == readings.shape
        np.testing.assert_allclose(found.residuals, expected, atol=2e-3)
        assert 0.6 < np.linalg.norm(found.residuals) / math.sqrt(len(readings)) < 1.4

    @pytest.mark.slow
    def test_what_is_known_from_before_draws_the_estimate(self):
        (case,) = [case for case in CASES if case.name == "much_known_before"]
        readings, other = noisy(case, 4), case.nominal.copy()
        other[2] += 3 * 0.003 * TRACK
        near, far = case.estimator.fit(readings), case.estimator.fit(readings, before=other)
        assert far.values[2] > near.values[2]
        assert_same_estimate(far.values, case.fit(readings, other)[:3], case.covariance, 1e-4)

    @pytest.mark.parametrize("spoil", [math.nan, math.inf])
    def test_readings_that_are_not_finite(self, spoil: float):
        readings = noisy(PLAIN, 5)
        readings[7] = spoil
        with pytest.raises(ValueError, match=f"expected {len(readings)} finite readings"):
            PLAIN.estimator.fit(readings)

    @pytest.mark.parametrize("change", [-1, 1])
    def test_another_number_of_readings(self, change: int):
        count = len(PLAIN.estimator.predicted())
        with pytest.raises(ValueError, match=f"expected {count} finite readings, got {count + change}"):
            PLAIN.estimator.fit(np.zeros(count + change))

    def test_a_covariance_of_another_number_of_readings(self):
        (case,) = [case for case in CASES if case.name == "correlated_over_time"]
        longer = random_drive(sensed_problem(measurement=Poses(noise=XYH), samples=60), 3, 5.0)
        with pytest.raises(UserMistake, match="is for 18 of them; this drive gives 26"):
            Nonlinear(case.problem, longer)

    def test_no_readings(self):
        with pytest.raises(ValueError, match="got 0"):
            PLAIN.estimator.fit([])

    def test_readings_in_rows(self):
        readings = noisy(PLAIN, 6)
        found = PLAIN.estimator.fit(readings.reshape(-1, 3).tolist())
        np.testing.assert_array_equal(found.values, PLAIN.estimator.fit(readings).values)


class TestMonteCarlo:
    """Simulated readings scatter the estimates as F^-1 says."""

    @pytest.mark.slow
    @cases
    def test_to_one_per_cent(self, case: Case):
        result = validate(case.problem, case.drive, replicates=REPLICATES, seed=1)
        assert (result.estimator, result.parameters) == ("nonlinear", case.estimator.parameters)
        assert result.passed
        assert np.abs(result.paired_ratio - 1).max() < 0.01
        assert result.paired_error.max() < 0.005

    @cases
    def test_linear_estimates_have_that_covariance_exactly(self, case: Case):
        # Their noise alone is simulated: as many replicates as wanted.
        gain = case.estimator._gain
        count = len(case.parameters)
        np.testing.assert_allclose((gain @ gain.T)[:count, :count], case.estimator.covariance, rtol=1e-7)

    def test_a_promise_five_per_cent_off_is_noticed(self):
        estimates, linear = PLAIN.estimator.simulate(np.random.default_rng(3), 2)
        assert estimates.shape == linear.shape == (2, 3)
        errors = np.random.default_rng(4).multivariate_normal(np.zeros(3), PLAIN.estimator.covariance, 10_000)
        assert all(check.passed for check in check_all(errors, PLAIN.estimator.covariance, 0.01))
        for factor in (0.95, 1.05):
            checks = check_all(errors, factor * PLAIN.estimator.covariance, 0.01)
            assert not all(check.passed for check in checks)

    @cases
    def test_side_by_side_estimates_are_those_of_one_after_another(self, case: Case, monkeypatch):
        together, alone = both_ways(case.estimator, 10, monkeypatch)
        np.testing.assert_array_equal(together.linear, alone.linear)
        errors = np.sqrt(np.diag(case.estimator.covariance))
        np.testing.assert_allclose(together.estimates / errors, alone.estimates / errors, rtol=0, atol=1e-6)
        assert together.searches == 0
        assert alone.searches == 10

    @pytest.mark.slow
    def test_those_that_need_smaller_steps_go_alone(self, monkeypatch):
        noisy = sensed_problem(measurement=Poses(noise={"position": 0.2, "heading": 0.5}))
        estimator = Nonlinear(noisy, PLAIN.drive)
        together, alone = both_ways(estimator, 20, monkeypatch)
        assert 0 < together.searches < 20
        errors = np.sqrt(np.diag(estimator.covariance))
        np.testing.assert_allclose(together.estimates / errors, alone.estimates / errors, rtol=0, atol=1e-6)

    @pytest.mark.slow
    def test_half_the_noise_leaves_a_quarter_of_what_is_not_linear(self):
        rests = []
        for share in (1.0, 0.5):
            noise = {name: share * size for name, size in XYH.items()}
            estimator = Nonlinear(sensed_problem(measurement=Poses(noise=noise)), PLAIN.drive)
            estimates, linear = estimator.simulate(np.random.default_rng(5), 50)
            rests.append(np.abs(estimates - linear).sum())
        assert rests[1] == pytest.approx(rests[0] / 4, rel=0.05)

    @pytest.mark.slow
    def test_a_robot_with_slip(self):
        robot = SkidSteer(wheel_radius=RADIUS, track=TRACK, slip_outer=0.1, slip_inner=-0.05)
        problem = sensed_problem(
            measurement=Poses(noise=PRECISE), model=robot, estimate=("track", "slip_outer", "slip_inner")
        )
        drive = random_drive(problem, 3, 5.0)
        result = validate(problem, drive, replicates=REPLICATES)
        assert result.passed
        assert np.abs(result.paired_ratio - 1).max() < 0.01
        np.testing.assert_allclose(result.predicted, evaluate(problem, drive).covariances["joint"], rtol=1e-8)


class Simulated(NamedTuple):
    estimates: np.ndarray
    linear: np.ndarray
    searches: int


def both_ways(estimator: Nonlinear, count: int, monkeypatch) -> tuple[Simulated, Simulated]:
    """Simulated experiments side by side as far as that leads, and one after another."""
    found, searched, ways = JointSearch.found, list[int](), list[Simulated]()

    def counted(search: JointSearch, values: np.ndarray | None = None):
        searched.append(1)
        return found(search, values)

    monkeypatch.setattr(JointSearch, "found", counted)
    for most in (SideBySide.most, 1):
        monkeypatch.setattr(SideBySide, "most", most)
        searched.clear()
        ways.append(Simulated(*estimator.simulate(np.random.default_rng(6), count), len(searched)))
    return ways[0], ways[1]


class TestRobust:
    """Losses that bound the influence of outliers."""

    def test_moments_against_numeric_integration(self):
        for loss in PSI:
            assert loss_moments(loss) == pytest.approx(MOMENTS[loss], rel=1e-7), loss

    def test_moments_of_huber_in_closed_form(self):
        inside = math.erf(1 / math.sqrt(2))
        square = inside - 2 * norm.pdf(1) + (1 - inside)
        assert loss_moments("linear") == pytest.approx((1, 1), rel=1e-10)
        assert loss_moments("huber") == pytest.approx((inside, square), rel=1e-10)

    def test_derivatives(self):
        squares, step = np.array([0.0, 0.3, 0.99, 1.01, 4.0, 1e4]), 1e-6
        sizes = np.sqrt(squares)
        for loss, psi in PSI.items():
            ahead, behind = robust_loss(loss, squares + step), robust_loss(loss, squares - step)
            _, first, second = robust_loss(loss, squares)
            for place, slope in enumerate((first, second)):
                found = (ahead[place] - behind[place]) / (2 * step)
                np.testing.assert_allclose(found, slope, atol=1e-6, err_msg=loss)
            # Its influence psi(z) = z rho'(z^2).
            np.testing.assert_allclose(sizes * first, psi(sizes), rtol=1e-12, err_msg=loss)

    @pytest.mark.parametrize("loss", PSI)
    def test_they_are_scipys(self, loss: Loss):
        # A line through points, some far off: SciPy with the loss by name and by our function.
        rng = np.random.default_rng(0)
        times, noise = np.linspace(0, 1, 60), rng.standard_t(1.5, 60)

        def residuals(line: np.ndarray) -> np.ndarray:
            return line[0] + line[1] * times - noise

        named, ours = (
            least_squares(residuals, [0.3, 0.3], loss=chosen, xtol=1e-14, ftol=1e-14, gtol=1e-12)
            for chosen in (loss, lambda squares: robust_loss(loss, squares))
        )
        assert ours.cost == pytest.approx(named.cost, rel=1e-12)
        np.testing.assert_allclose(ours.x, named.x, atol=1e-6)

    @pytest.mark.slow
    @losses
    @pytest.mark.parametrize("name", ["poses", "correlated_over_time", "positions_and_a_gyro"])
    def test_fits_are_scipys(self, name: str, loss: Loss):
        (case,) = [case for case in CASES if case.name == name]
        readings = with_outliers(case, noisy(case, 1, displaced(case)))
        found = Nonlinear(case.problem, case.drive, loss).fit(readings)
        assert found.converged
        expected = case.fit(readings, loss=loss)[: len(case.parameters)]
        assert_same_estimate(found.values, expected, case.covariance, 2e-3)

    @cases
    def test_the_covariance_formula(self, case: Case):
        for loss in ROBUST:
            found = Nonlinear(case.problem, case.drive, loss)
            expected = case.robust_covariance(loss)
            sizes = np.sqrt(np.diag(expected))
            shares = found.covariance / np.outer(sizes, sizes)
            np.testing.assert_allclose(shares, expected / np.outer(sizes, sizes), atol=1e-5, err_msg=loss)
            # Gauss and Markov: robustness costs precision where there are no outliers.
            assert np.all(np.diag(found.covariance) > np.diag(case.covariance) * 1.01), loss
            np.testing.assert_array_equal(found.linear_covariance, case.estimator.covariance)

    @pytest.mark.slow
    def test_the_covariance_is_what_is_simulated(self):
        # Of one loss: the formula is that of all, whose moments are tested above; another passes the checks
        # below.
        # Each estimate is paired with H^-1 (J' psi(z) + P z_0), whose covariance the formula is.
        loss: Loss = "huber"
        case = LONG
        estimator = Nonlinear(case.problem, case.drive, loss)
        rng, exact = np.random.default_rng(6), estimator.predicted()
        jacobian, slope = case.white_jacobian, MOMENTS[loss][0]
        inverse = scaled_inverse(slope * jacobian.T @ jacobian)
        differences = []
        # Enough for the mean of their differences to be known to 0.02.
        for _ in range(100):
            white = rng.standard_normal(len(exact))
            found = estimator.fit(exact + white / np.diag(case.whitener)).values - estimator.true
            first = (inverse @ jacobian.T @ PSI[loss](white))[:3]
            differences.append((found**2 - first**2) / np.diag(estimator.covariance))
        # What is left is of the order of unknowns over readings.
        assert np.abs(np.mean(differences, axis=0)).max() < 0.04
        assert np.std(differences, axis=0).max() / math.sqrt(len(differences)) < 0.02

    @pytest.mark.slow
    def test_it_passes_the_checks(self):
        result = validate(PLAIN.problem, PLAIN.drive, replicates=50, loss="cauchy", seed=2)
        assert result.passed

    @pytest.mark.slow
    @losses
    def test_knowledge_from_before_has_no_outliers(self, loss: Loss):
        # A prior that contradicts the readings keeps its full weight, by SciPy with a loss for each row.
        (case,) = [case for case in CASES if case.name == "correlated_prior"]
        before = case.nominal.copy()
        before[2] += 20 * math.sqrt(PRIOR_COVARIANCE[0, 0])
        readings = noisy(case, 8)
        found = Nonlinear(case.problem, case.drive, loss).fit(readings, before=before).values
        root = np.linalg.inv(np.linalg.cholesky(PRIOR_COVARIANCE))

        def residuals(scaled: np.ndarray) -> np.ndarray:
            values = scaled * case.sizes
            misfit = case.whitener @ (case.readings(values) - readings)
            # rho(z^2) = z^2 of these rows, written as the square root of what the loss makes of it.
            return np.concatenate([np.sqrt(2 * cost(misfit)), root @ (values - before)[[2, 0]]])

        def cost(misfit: np.ndarray) -> np.ndarray:
            return robust_loss(loss, misfit**2)[0] / 2

        start = case.estimator.fit(readings).values / case.sizes
        expected = least_squares(residuals, start, jac="3-point", xtol=1e-14, ftol=1e-14, gtol=1e-14)
        assert_same_estimate(found, expected.x * case.sizes, case.covariance, 5e-3)

    @pytest.mark.slow
    def test_truths_far_from_the_nominal_are_found(self):
        # Sixty per cent off, which halved steps alone found in less than two of three cases.
        estimator, found = Nonlinear(PLAIN.problem, PLAIN.drive, "huber"), 0
        for seed in range(20):
            rng, truth = np.random.default_rng([seed, 9]), PLAIN.nominal.copy()
            truth[:3] *= 1 + 0.6 * rng.choice([-1.0, 1.0], 3)
            truth[3:] += 0.3 * rng.standard_normal(3)
            estimate = estimator.fit(noisy(PLAIN, seed, truth))
            errors = (estimate.values - truth[:3]) / np.sqrt(np.diag(estimate.covariance))
            found += estimate.converged and np.abs(errors).max() < 6
        assert found >= 15

    @losses
    def test_outliers_hurt_least_squares_alone(self, loss: Loss):
        linear, robust = (
            Nonlinear(LONG.problem, LONG.drive, chosen).fit(with_outliers(LONG, noisy(LONG, 9)))
            for chosen in ("linear", loss)
        )
        assert far_off(linear) > 8
        assert far_off(robust) < 4


def with_outliers(case: Case, readings: np.ndarray) -> np.ndarray:
    """One reading in twenty is off by forty times its noise, always to the same side."""
    hit = np.random.default_rng(10).choice(len(readings), len(readings) // 20, replace=False)
    spoiled = readings.copy()
    spoiled[hit] += 40 / np.diag(case.whitener)[hit]
    return spoiled


def far_off(estimate: Estimate) -> float:
    """The largest error in promised standard deviations."""
    errors = (estimate.values - np.array(GEOMETRY)) / np.sqrt(np.diag(estimate.covariance))
    return float(np.abs(errors).max())


LONG = Case(
    "long",
    sensed_problem(measurement=Poses(noise=PRECISE), samples=200),
    (Sensor(pose_readings("xyh"), np.array([5e-4, 5e-4, 5e-3])),),
)


class TestMistakes:
    @pytest.mark.parametrize("speeds", [(0.0, 0.0), (2.0, 2.0)], ids=["at rest", "straight"])
    def test_a_drive_that_tells_too_little(self, speeds: tuple[float, float]):
        drive = Trajectory.from_samples(np.tile(speeds, (40, 1)), 10.0, START)
        names = "wheel_radius_right, wheel_radius_left, track"
        with pytest.raises(ProblemError, match=f"does not identify {names}") as raised:
            Nonlinear(PLAIN.problem, drive)
        assert raised.value.issues[0].key == ("validation",)

    def test_unless_the_rest_is_known_from_before(self):
        problem = sensed_problem(
            measurement=Poses(noise=XYH), prior=Prior(standard_deviations={"track": "1 %"})
        )
        drive = Trajectory.from_samples(np.full((40, 2), 2.0), 10.0, START)
        deviations = np.sqrt(np.diag(Nonlinear(problem, drive).covariance))
        assert deviations[2] == pytest.approx(0.01 * TRACK, rel=1e-6)
        assert deviations[:2].max() < 1e-3

    def test_parameters_that_no_drive_tells_apart(self):
        robot = SkidSteer(wheel_radius=RADIUS, track=TRACK, slip_outer=0.1, slip_inner=-0.05)
        problem = sensed_problem(measurement=Poses(noise=XYH), model=robot)
        with pytest.raises(ProblemError, match="slip_outer, slip_inner; nothing"):
            Nonlinear(problem, PLAIN.drive)


@cache
def simulated(workers: int, loss: Loss = "linear"):
    case = CASES[2]
    return validate(case.problem, case.drive, replicates=205, seed=4, workers=workers, loss=loss)


class TestWorkers:
    @cases
    def test_workers_get_the_same(self, case: Case):
        estimator = Nonlinear(case.problem, case.drive, "huber")
        estimator.simulate(np.random.default_rng(1), 1)
        again = pickle.loads(pickle.dumps(estimator))
        found, expected = (np.hstack(one.simulate(np.random.default_rng(2), 3)) for one in (again, estimator))
        np.testing.assert_allclose(found, expected, rtol=1e-12)
        np.testing.assert_array_equal(again.covariance, estimator.covariance)

    @pytest.mark.slow
    def test_whatever_their_number(self):
        single, double = simulated(1), simulated(2)
        assert single.replicates == double.replicates == 205
        np.testing.assert_allclose(single.estimates, double.estimates, rtol=1e-12)
        np.testing.assert_allclose(single.paired_ratio, double.paired_ratio, rtol=1e-10)

    def test_the_same_seed_gives_the_same_result(self):
        first, again, other = (
            PLAIN.estimator.simulate(np.random.default_rng(seed), 3)[0] for seed in (1, 1, 2)
        )
        np.testing.assert_array_equal(first, again)
        assert np.abs(first - other).max() > 0
