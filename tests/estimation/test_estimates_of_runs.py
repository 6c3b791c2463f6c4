"""Estimates from several runs: readings simulated run by run, the truth found again, promises kept."""

from __future__ import annotations

import math
import pickle
from functools import cache, partial

import numpy as np
import oracle
import pytest
from builders import RADIUS, SPEED, TRACK, problem_of, random_drive

from oed.estimation.methods import Nonlinear, Regression
from oed.estimation.methods.side_by_side import SideBySide
from oed.estimation.prediction.layout import SegmentLayout
from oed.kernel.criteria import E
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.evaluation import evaluate
from oed.robots.sensors import Displacements, Measurement, Poses, Ranges, Several, YawRate
from oed.robots.space import StartPose
from oed.simulation import Validation, validate

STARTS = (StartPose(x=0.2, y=-0.1, heading=0.4), StartPose(x=-0.5, y=0.3, heading=3.0))
BEACONS = ((4.0, 3.0), (-3.5, 2.5), (0.5, -4.0))
SIGMAS = {"position": 2e-3, "heading": 0.01}
REPLICATES = 1000
TRUTH = {"wheel_radius_right": 0.0485, "wheel_radius_left": 0.0497, "track": 0.183}

SENSORS: dict[str, Measurement] = {
    "poses": Poses(noise=SIGMAS),
    "poses of known start": Poses(noise=SIGMAS, initial_pose="known", every=3),
    "start known roughly": Poses(noise=SIGMAS, initial_pose={"position": 0.01, "heading": 0.02}),
    "several": Several(
        sensors=(
            Poses(
                quantities=("x", "y"),
                noise={"position": 2e-3},
                lever_arm={"x": 0.1, "y": 0.02, "known": False},
                every=2,
            ),
            YawRate(noise=0.01),
            Ranges(beacons=BEACONS, noise=0.02, every=4),
        )
    ),
    "correlated": Poses(
        quantities=("x", "y"),
        noise={
            "covariance": (
                1e-6 * np.kron(0.6 ** np.abs(np.subtract.outer(range(5), range(5))), [[1.0, 0.3], [0.3, 2]])
            ).tolist()
        },
        every=5,
    ),
}
sensors = pytest.mark.parametrize("measurement", SENSORS.values(), ids=SENSORS.keys())


runs_problem = partial(
    problem_of, duration=5.0, samples=20, start=STARTS, runs=2, limits=(SPEED,), criterion=E()
)


@cache
def drive_of(seed: int = 3, amplitude: float = 6.0) -> Trajectory:
    return random_drive(runs_problem(measurement=SENSORS["poses"]), seed, amplitude)


def true_poses(drive: Trajectory, values: dict[str, float], shifts: np.ndarray | None = None):
    """Poses (samples + 1, 3) and twists of every run, by loops."""
    count = drive.samples // drive.runs
    found = []
    for run in range(drive.runs):
        rows = drive.inputs[run * count : (run + 1) * count]
        twists = np.array([oracle.differential_twist(row, *values.values()) for row in rows])
        start = drive.start[run] + (0 if shifts is None else shifts[run])
        found.append((oracle.roll_out(twists, start, drive.period, "arc"), twists))
    return found


class TestNonlinear:
    @sensors
    def test_predicted_readings_fit_exactly(self, measurement: Measurement):
        estimator = Nonlinear(runs_problem(measurement=measurement), drive_of())
        estimate = estimator.fit(estimator.predicted())
        assert estimate.converged
        np.testing.assert_allclose(estimate.values, estimator.true, rtol=1e-9)
        np.testing.assert_allclose(estimate.residuals, 0, atol=1e-6)

    @sensors
    def test_the_promise_is_evaluates(self, measurement: Measurement):
        problem = runs_problem(measurement=measurement)
        expected = evaluate(problem, drive_of()).covariances["joint"]
        np.testing.assert_allclose(Nonlinear(problem, drive_of()).covariance, expected, rtol=1e-6)

    def test_another_truth_is_found_with_its_starts_and_nuisances(self):
        """Poses at the end of an arm and yaw rates, written by hand: sensor by sensor, run by run."""
        sensors = (
            Poses(noise=SIGMAS, lever_arm={"x": 0.1, "y": 0.02, "known": False}, every=3),
            YawRate(noise=0.01),
        )
        shifts = np.array([[0.02, -0.01, 0.05], [-0.03, 0.01, -0.04]])
        arm, bias = (0.12, 0.01), 0.03
        poses, rates = [], []
        for path, twists in true_poses(drive_of(), TRUTH, shifts):
            for x, y, heading in path[::3]:
                ahead = complex(*arm) * np.exp(1j * heading)
                poses += [x + ahead.real, y + ahead.imag, heading]
            rates += list(twists[:, 2] + bias)
        estimator = Nonlinear(runs_problem(measurement=Several(sensors=sensors)), drive_of())
        estimate = estimator.fit([*poses, *rates])
        names = [f"initial_pose_{run}.{state}" for run in (1, 2) for state in ("x", "y", "heading")]
        assert estimate.nuisances == (*names, "poses.lever_arm.x", "poses.lever_arm.y", "yaw_rate.bias")
        np.testing.assert_allclose(estimate.values, list(TRUTH.values()), rtol=1e-6)
        expected = [*(drive_of().start + shifts).ravel(), *arm, bias]
        np.testing.assert_allclose(estimate.nuisance_values, expected, rtol=0, atol=1e-6)

    @pytest.mark.parametrize("every", [1, 3])
    def test_angles_that_jump_are_unwrapped_run_by_run(self, every: int):
        """Each run's headings within (-pi, pi], as an instrument gives them, from starts turns apart."""
        drive = drive_of(7, 9.0)
        measurement = Several(
            sensors=(
                Poses(noise=SIGMAS, every=every),
                Poses(quantities=("heading", "x"), noise={"x": 1e-3, "heading": 0.02}),
            )
        )
        first, second = [], []
        for path, _ in true_poses(drive, TRUTH):
            wrapped = np.angle(np.exp(1j * path[:, 2]))
            first += np.column_stack([path[:, :2], wrapped])[::every].ravel().tolist()
            second += np.column_stack([wrapped, path[:, 0]]).ravel().tolist()
        readings = np.array([*first, *second])
        assert np.abs(np.diff(readings[2 : len(first) : 3])).max() > math.pi
        estimate = Nonlinear(runs_problem(measurement=measurement), drive).fit(readings)
        np.testing.assert_allclose(estimate.values, list(TRUTH.values()), rtol=1e-6)
        np.testing.assert_allclose(estimate.residuals, 0, atol=1e-4)

    def test_one_runs_turns_do_not_wind_up_the_next(self):
        """The first run ends turned by several turns, the second begins where it says."""
        rows = np.vstack([np.tile([9.0, -9.0], (20, 1)), np.full((20, 2), 3.0)])
        drive = Trajectory.from_samples(rows, 10.0, np.zeros((2, 3)), runs=2)
        problem = runs_problem(measurement=SENSORS["poses"])
        predicted = Nonlinear(problem, drive).predicted().reshape(2, 21, 3)
        assert predicted[0, -1, 2] > 4 * math.pi
        np.testing.assert_allclose(predicted[1, :, 2], 0, atol=1e-12)
        wrapped = predicted.copy()
        wrapped[..., 2] = np.angle(np.exp(1j * wrapped[..., 2]))
        found = Nonlinear(problem, drive)._readings.unwrapped(wrapped.ravel())
        np.testing.assert_allclose(found, predicted.ravel(), rtol=0, atol=1e-9)

    def test_a_run_is_a_segment(self):
        drive, readings = drive_of(), np.arange(8.0).reshape(2, 4)
        layout = SegmentLayout.of_drive(drive, readings)
        assert (layout.count, layout.periods, layout.quantities) == (2, 20, ())
        np.testing.assert_array_equal(layout.readings[..., 0], readings)
        assert layout.valid.all()
        np.testing.assert_array_equal(layout.inputs(np.zeros(0)).reshape(40, -1), drive.inputs)
        np.testing.assert_allclose(layout.steps, drive.period, rtol=1e-12)

    def test_a_fit_of_a_drive_is_one_of_its_segments(self):
        estimator = Nonlinear(runs_problem(measurement=SENSORS["several"]), drive_of())
        fit = estimator._searching(estimator.predicted(), estimator._initial).fit()
        np.testing.assert_allclose(fit.inverse[:3, :3], estimator.covariance, rtol=1e-6)
        assert fit.information.shape[0] == fit.layout.count == 2
        readings = estimator._readings.by_sensor(fit.layout.readings)
        np.testing.assert_array_equal(readings, estimator.predicted())

    @pytest.mark.slow
    @sensors
    def test_side_by_side_estimates_are_those_of_one_after_another(self, measurement, monkeypatch):
        estimator = Nonlinear(runs_problem(measurement=measurement), drive_of())
        found, _ = estimator.simulate(np.random.default_rng(1), 20)
        monkeypatch.setattr(SideBySide, "most", 1)
        expected, _ = estimator.simulate(np.random.default_rng(1), 20)
        errors = np.sqrt(np.diag(estimator.covariance))
        np.testing.assert_allclose(found / errors, expected / errors, rtol=0, atol=1e-6)
        assert not np.array_equal(found, expected)

    def test_pickled_it_estimates_the_same(self):
        estimator = Nonlinear(runs_problem(measurement=SENSORS["several"]), drive_of())
        again = pickle.loads(pickle.dumps(estimator))
        first, second = (one.simulate(np.random.default_rng(1), 3)[0] for one in (estimator, again))
        np.testing.assert_array_equal(first, second)

    def test_another_number_of_readings_is_refused(self):
        estimator = Nonlinear(runs_problem(measurement=SENSORS["poses"]), drive_of())
        assert len(estimator.predicted()) == 2 * 21 * 3
        with pytest.raises(ValueError, match="expected 126 finite readings, got 123"):
            estimator.fit(estimator.predicted()[3:])

    @pytest.mark.slow
    @sensors
    def test_estimates_scatter_as_predicted(self, measurement: Measurement):
        result = validate(runs_problem(measurement=measurement), drive_of(), replicates=200, seed=0)
        assert_kept(result)
        assert result.paired_error.max() < 0.005


def assert_kept(result: Validation, tolerance: float = 0.01) -> None:
    assert result.passed, result.verdict
    np.testing.assert_allclose(result.paired_ratio, 1.0, rtol=0, atol=tolerance)


def displacements(noise_model: str = "increments", **parts) -> Displacements:
    noise = {"position": "2 mm", "heading": "0.3 deg"}
    return Displacements(
        **{"segments": 5, "regressor": "both", "noise": noise, **parts}, noise_model=noise_model
    )


WAYS = [
    ("ols", "known", "increments"),
    ("ols", "predicted", "increments"),
    ("sandwich", "known", "absolute"),
    ("sandwich", "predicted", "absolute"),
    ("sandwich", "measured", "absolute"),
    ("sandwich", "measured", "increments"),
    ("gls", "known", "absolute"),
    ("gls", "predicted", "increments"),
    ("errors_in_variables", "measured", "increments"),
    ("errors_in_variables", "measured", "absolute"),
]
ways = pytest.mark.parametrize(("name", "heading", "noise_model"), WAYS, ids=map("-".join, WAYS))


def noise_free(drive: Trajectory, segments: int, values: dict[str, float]) -> dict[str, np.ndarray]:
    """Turns, displacements, and headings in the middle of every period, run by run."""
    turns, moves, middles = [], [], []
    for path, _ in true_poses(drive, values):
        edges = np.rint(np.linspace(0, len(path) - 1, segments + 1)).astype(int)
        turns.append(np.diff(path[edges, 2]))
        moves.append(np.diff(path[edges, :2], axis=0).ravel())
        middles.append((path[1:, 2] + path[:-1, 2]) / 2)
    return {
        "turns": np.concatenate(turns),
        "displacements": np.concatenate(moves),
        "headings": np.concatenate(middles),
    }


class TestRegression:
    @ways
    def test_the_truth_is_found_without_noise(self, name, heading, noise_model):
        regression = Regression(
            runs_problem(measurement=displacements(noise_model)), drive_of(), name, heading
        )
        nominal = {"right": RADIUS, "left": RADIUS, "track": TRACK}
        estimate = regression.fit(**noise_free(drive_of(), 5, nominal))
        if name == "errors_in_variables":
            # It takes out what noise would have done.
            np.testing.assert_allclose(estimate.values, regression.true, rtol=1e-3)
        else:
            np.testing.assert_allclose(estimate.values, regression.true, rtol=1e-9)
            np.testing.assert_allclose(estimate.residuals, 0, atol=1e-9)

    def test_another_robot_is_found_by_predicted_headings(self):
        regression = Regression(
            runs_problem(measurement=displacements(segments="samples")), drive_of(), "ols", "predicted"
        )
        estimate = regression.fit(**noise_free(drive_of(), 20, TRUTH))
        right, left, track = TRUTH.values()
        expected = [right / track, -left / track, right / 2, left / 2]
        # Chords are those of the robot predicted by the first stage, which is the true one.
        np.testing.assert_allclose(estimate.values, expected, rtol=1e-9)

    @pytest.mark.parametrize(
        ("name", "heading", "noise_model"),
        [way for way in WAYS if way[1] == "known"],
        ids=["ols", "sandwich", "gls"],
    )
    def test_the_promise_is_that_of_the_joint_covariance(self, name, heading, noise_model):
        """Runs in a block each: covariances of increments by hand."""
        regression = Regression(
            runs_problem(measurement=displacements(noise_model)), drive_of(), name, heading
        )
        designs = evaluate(runs_problem(measurement=displacements(noise_model)), drive_of()).design_matrices
        sigma, expected = {"heading": math.radians(0.3), "position": 2e-3}, np.zeros((4, 4))
        for index, (block, coordinates) in enumerate((("heading", 1), ("position", 2))):
            difference = np.diff(np.eye(6), axis=0)
            spread = np.kron(np.eye(2), np.kron(difference @ difference.T, np.eye(coordinates)))
            spread = spread if noise_model == "absolute" else np.eye(len(spread))
            weight = np.linalg.inv(spread) if name == "gls" else np.eye(len(spread))
            inverse = np.linalg.inv(designs[block].T @ weight @ designs[block])
            gain = inverse @ designs[block].T @ weight
            own = slice(2 * index, 2 * index + 2)
            expected[own, own] = sigma[block] ** 2 * gain @ spread @ gain.T
        np.testing.assert_allclose(regression.covariance, expected, rtol=1e-8, atol=1e-18)

    @ways
    def test_estimates_scatter_as_predicted(self, name, heading, noise_model):
        result = validate(
            runs_problem(measurement=displacements(noise_model)),
            drive_of(),
            estimator=name,
            heading=heading,
            replicates=REPLICATES,
            seed=2,
        )
        if (name, heading) == ("ols", "predicted"):
            # Its promise leaves the first stage's errors out.
            np.testing.assert_allclose(result.paired_ratio[:2], 1.0, atol=0.01)
            return
        assert_kept(result)

    def test_simulated_errors_are_shared_within_runs_only(self):
        regression = Regression(runs_problem(measurement=displacements("absolute")), drive_of(), "gls")
        draws = regression._draw(np.random.default_rng(0), "heading", 40_000) / math.radians(0.3)
        expected = np.kron(np.eye(2), 2 * np.eye(5) - np.eye(5, k=1) - np.eye(5, k=-1))
        np.testing.assert_allclose(np.cov(draws, rowvar=False), expected, atol=0.06)

    def test_the_headings_of_a_run_begin_at_its_own_start(self):
        regression = Regression(runs_problem(measurement=displacements()), drive_of(), "ols")
        exact = noise_free(drive_of(), 5, {"right": RADIUS, "left": RADIUS, "track": TRACK})["headings"]
        np.testing.assert_allclose(regression.regressors.directions, exact, rtol=0, atol=1e-9)
