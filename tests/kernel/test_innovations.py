"""Information under process noise, against dense generalised least squares on all readings at once."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from builders import RADIUS, TRACK, check_all, problem_of, random_drive
from written_out import WrittenOut, called

from oed.bounds import STEADY, bound
from oed.estimation.methods.nonlinear import Nonlinear
from oed.foundation.errors import ProblemError
from oed.kernel.criteria import A, D, E
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.evaluation import evaluate
from oed.kernel.measurement.filter import filter_of
from oed.kernel.problem import Problem
from oed.kernel.scorer import precision_over_time
from oed.optimize import Ipopt, solve
from oed.optimize.terms.terms import Terms
from oed.robots.sensors import Drift, Poses, RelativePoses, YawRate
from oed.robots.sensors.mounting import LeverArm, Mounting
from oed.simulation.monte_carlo import validate

STEP = 1e-30
"""Of complex steps, whose derivatives are exact."""
REST = 1e-6
"""Added to the squares of speed and yaw rate, so that |.| is smooth at 0."""
DRIFT = Drift(
    ahead_per_metre=0.02,
    ahead_per_radian=0.005,
    sideways_per_metre=0.004,
    heading_per_metre=0.03,
    heading_per_radian=0.02,
    heading_per_root_second=0.003,
)
POSES = Poses(noise={"position": 0.01, "heading": 0.02}, drift=DRIFT)
MOTIONS = RelativePoses(noise={"position": 0.01, "heading": 0.02}, drift=DRIFT, mounting=Mounting(known=True))
SOME = ("wheel_radius_right", "track")
BESIDE = LeverArm(x=0.1, y=0.2, known=False)
Readings = Callable[[np.ndarray, np.ndarray], list[complex]]


def path_of(speeds: np.ndarray, period: float, unknowns: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """Poses (N + 1, 3) of two wheels, period by period with errors (N, 3) of the motion; complex."""
    right, left, track, *start = unknowns[:6]
    poses = [np.array(start)]
    for (fast, slow), error in zip(speeds, errors, strict=True):
        moved = np.array([(right * fast + left * slow) / 2, 0, (right * fast - left * slow) / track])
        forward, lateral, turn = period * moved + error
        x, y, heading = poses[-1]
        half = turn / 2
        gain = np.sin(half) / half if abs(half) > 1e-9 else 1.0
        cosine, sine = np.cos(heading + half), np.sin(heading + half)
        ahead = gain * (forward * cosine - lateral * sine), gain * (forward * sine + lateral * cosine)
        poses.append(np.array([x + ahead[0], y + ahead[1], heading + turn]))
    return np.array(poses)


def variances(drift: Drift, speeds: np.ndarray, period: float) -> np.ndarray:
    """Of all errors, (3 N,), period by period."""
    found = []
    for fast, slow in speeds:
        speed, rate = RADIUS * (fast + slow) / 2, RADIUS * (fast - slow) / TRACK
        way, turn = (period * np.sqrt(one**2 + REST) for one in (speed, rate))
        for name in ("ahead", "sideways", "heading"):
            each = [getattr(drift, f"{name}_per_{cause}") for cause in ("metre", "radian", "root_second")]
            found.append(each[0] ** 2 * way + each[1] ** 2 * turn + each[2] ** 2 * period)
    return np.array(found)


def slopes(function: Callable[[np.ndarray], np.ndarray], at: np.ndarray) -> np.ndarray:
    """Derivatives by complex steps."""
    steps = at + 1j * STEP * np.eye(len(at))
    return np.array([function(one).imag / STEP for one in steps]).T


def dense(
    readings: Callable[[np.ndarray, np.ndarray], np.ndarray], drive: Trajectory, drift: Drift, nuisances: int
) -> np.ndarray:
    """F of (r_R, r_L, track), all else eliminated: J' (1 + L Q L')^-1 J, readings in units of their noise."""
    nominal = np.array([RADIUS, RADIUS, TRACK, *drive.start, *[0.0] * nuisances])
    still = np.zeros(3 * drive.samples)
    jacobian = slopes(lambda at: readings(at, still.reshape(-1, 3)), nominal)
    effect = slopes(lambda at: readings(nominal, at.reshape(-1, 3)), still)
    spread = effect * variances(drift, drive.inputs, drive.period) @ effect.T
    whole = jacobian.T @ np.linalg.solve(np.eye(len(spread)) + spread, jacobian)
    # Relative readings say nothing of the start.
    seen = [place for place in range(3, len(whole)) if whole[place, place] > 1e-6]
    across = whole[:3, seen]
    return whole[:3, :3] - across @ np.linalg.solve(whole[np.ix_(seen, seen)], across.T)


def poses_read(drive: Trajectory, every: int = 1) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Absolute poses in units of 1 cm and 0.02 rad."""

    def found(unknowns: np.ndarray, errors: np.ndarray) -> np.ndarray:
        poses = path_of(drive.inputs, drive.period, unknowns, errors)[::every]
        return (poses / [0.01, 0.01, 0.02]).ravel()

    return found


def information_of(problem: Problem, drive: Trajectory) -> np.ndarray:
    """F on the radii and the track, SI."""
    return evaluate(problem, drive).full_square_roots["joint"].matrix


def assert_close(found: np.ndarray, expected: np.ndarray, share: float = 1e-8) -> None:
    sizes = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(found / np.outer(sizes, sizes), expected / np.outer(sizes, sizes), atol=share)


@pytest.mark.slow
@pytest.mark.parametrize("every", [1, 4])
def test_poses_say_what_generalised_least_squares_would(every):
    problem = problem_of(measurement=POSES.model_copy(update={"every": every}), criterion=E())
    drive = random_drive(problem, 1)
    expected = dense(poses_read(drive, every), drive, DRIFT, 0)
    assert_close(information_of(problem, drive), expected)
    blind = problem_of(measurement=POSES.model_copy(update={"every": every, "drift": None}), criterion=E())
    assert np.all(np.linalg.eigvalsh(information_of(blind, drive) - expected) > 0)


@pytest.mark.slow
def test_precision_over_time_is_that_of_the_readings_so_far():
    problem = problem_of(measurement=POSES, criterion=E())
    drive = random_drive(problem, 1)
    read, periods = poses_read(drive), np.array([10, 25, drive.samples])
    found = precision_over_time(problem, drive, drive.period * periods)
    for row, period in zip(found, periods, strict=True):
        until = 3 * (period + 1)
        expected = dense(lambda at, errors, until=until: read(at, errors)[:until], drive, DRIFT, 0)
        np.testing.assert_allclose(row, np.sqrt(np.diag(np.linalg.inv(expected))), rtol=1e-6)
    np.testing.assert_allclose(found[-1], list(evaluate(problem, drive).standard_deviations.values()))
    assert np.all(np.isinf(precision_over_time(problem, drive, np.array([0.0]))))


@pytest.mark.slow
def test_a_sensor_that_does_not_read_at_the_end_says_nothing_there():
    seldom = POSES.model_copy(update={"every": 3})
    problem = problem_of(measurement=[seldom, POSES.model_copy(update={"every": 2})], criterion=E())
    drive = random_drive(problem, 8)
    assert (drive.samples % 3, drive.samples % 2) == (1, 0)
    both = [poses_read(drive, every) for every in (3, 2)]

    def readings(unknowns: np.ndarray, errors: np.ndarray) -> np.ndarray:
        return np.concatenate([read(unknowns, errors) for read in both])

    assert_close(information_of(problem, drive), dense(readings, drive, DRIFT, 0))


@pytest.mark.slow
def test_drift_of_nothing_is_none_and_the_filter_without_errors_is_least_squares():
    silent = problem_of(measurement=POSES.model_copy(update={"drift": Drift()}), criterion=E())
    blind = problem_of(measurement=POSES.model_copy(update={"drift": None}), criterion=E())
    faint = problem_of(
        measurement=POSES.model_copy(update={"drift": Drift(heading_per_metre=1e-12)}), criterion=E()
    )
    drive = random_drive(blind, 2)
    expected = information_of(blind, drive)
    np.testing.assert_array_equal(information_of(silent, drive), expected)
    assert_close(information_of(faint, drive), expected, 1e-9)


@pytest.mark.slow
def test_a_gyroscope_sees_the_turns_that_drift_adds():
    sensors = [POSES.model_copy(update={"every": 5}), YawRate(noise=0.03)]
    problem = problem_of(measurement=sensors, criterion=E())
    drive = random_drive(problem, 3)

    def readings(unknowns: np.ndarray, errors: np.ndarray) -> np.ndarray:
        poses = path_of(drive.inputs, drive.period, unknowns, errors)
        rates = np.diff(poses[:, 2]) / drive.period + unknowns[6]
        return np.concatenate([(poses[::5] / [0.01, 0.01, 0.02]).ravel(), rates / 0.03])

    assert_close(information_of(problem, drive), dense(readings, drive, DRIFT, 1))


def motions_read(drive: Trajectory, every: int) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Relative poses over so many samples in units of 1 cm and 0.02 rad."""

    def found(unknowns: np.ndarray, errors: np.ndarray) -> np.ndarray:
        x, y, heading = path_of(drive.inputs, drive.period, unknowns, errors)[::every].T
        ways = np.diff(x), np.diff(y)
        cosine, sine = np.cos(heading[:-1]), np.sin(heading[:-1])
        seen = [cosine * ways[0] + sine * ways[1], cosine * ways[1] - sine * ways[0], np.diff(heading)]
        return (np.array(seen).T / [0.01, 0.01, 0.02]).ravel()

    return found


@pytest.mark.slow
@pytest.mark.parametrize("every", [1, 3])
def test_relative_poses_see_the_motion_as_it_was(every):
    problem = problem_of(measurement=MOTIONS.model_copy(update={"every": every}), criterion=E())
    drive = random_drive(problem, 4)
    assert_close(information_of(problem, drive), dense(motions_read(drive, every), drive, DRIFT, 0))


@pytest.mark.slow
def test_motions_over_different_times_are_remembered_beside_poses():
    sensors = [POSES.model_copy(update={"every": 6})]
    sensors += [MOTIONS.model_copy(update={"every": every}) for every in (1, 4, 7)]
    problem = problem_of(measurement=sensors, criterion=E())
    drive = random_drive(problem, 3)

    def readings(unknowns: np.ndarray, errors: np.ndarray) -> np.ndarray:
        each = [motions_read(drive, every)(unknowns, errors) for every in (1, 4, 7)]
        return np.concatenate([poses_read(drive, 6)(unknowns, errors), *each])

    assert_close(information_of(problem, drive), dense(readings, drive, DRIFT, 0))


@pytest.mark.slow
def test_a_marker_beside_the_origin_is_a_nuisance():
    arm = LeverArm(x=0.0, y=0.0, known=False)
    problem = problem_of(measurement=POSES.model_copy(update={"lever_arm": arm}), criterion=E())
    drive = random_drive(problem, 5)

    def readings(unknowns: np.ndarray, errors: np.ndarray) -> np.ndarray:
        x, y, heading = path_of(drive.inputs, drive.period, unknowns, errors).T
        cosine, sine = np.cos(heading), np.sin(heading)
        x, y = x + cosine * unknowns[6] - sine * unknowns[7], y + sine * unknowns[6] + cosine * unknowns[7]
        return (np.array([x, y, heading]).T / [0.01, 0.01, 0.02]).ravel()

    assert_close(information_of(problem, drive), dense(readings, drive, DRIFT, 2), 1e-7)


@pytest.mark.slow
def test_runs_drift_each_for_itself():
    problem = problem_of(measurement=POSES, criterion=E(), runs=2)
    drive = random_drive(problem, 6)
    each = [dense(poses_read(one), one, DRIFT, 0) for one in drive.each]
    assert_close(information_of(problem, drive), each[0] + each[1])


@pytest.mark.slow
def test_a_correlated_rate_of_drift_is_that_of_its_matrix():
    matrix = np.array([[4e-4, 1e-4, 0.0], [1e-4, 1e-4, 1e-4], [0.0, 1e-4, 9e-4]])
    drift = Drift(covariance_rate=tuple(map(tuple, matrix)))
    problem = problem_of(measurement=POSES.model_copy(update={"drift": drift}), criterion=E())
    drive = random_drive(problem, 7)
    nominal = np.array([RADIUS, RADIUS, TRACK, *drive.start])
    still = np.zeros(3 * drive.samples)
    read = poses_read(drive)
    jacobian = slopes(lambda at: read(at, still.reshape(-1, 3)), nominal)
    effect = slopes(lambda at: read(nominal, at.reshape(-1, 3)), still)
    spread = effect @ np.kron(np.eye(drive.samples), drive.period * matrix) @ effect.T
    whole = jacobian.T @ np.linalg.solve(np.eye(len(spread)) + spread, jacobian)
    expected = whole[:3, :3] - whole[:3, 3:] @ np.linalg.solve(whole[3:, 3:], whole[3:, :3])
    assert_close(information_of(problem, drive), expected)


@pytest.mark.slow
def test_every_criterion_judges_the_information_under_drift():
    for criterion in (E(), D(), A()):
        problem = problem_of(measurement=POSES, criterion=criterion)
        drive = random_drive(problem, 8)
        scaled = dense(poses_read(drive), drive, DRIFT, 0) * np.outer(*[[RADIUS, RADIUS, TRACK]] * 2)
        values = np.linalg.eigvalsh(scaled)
        expected = {"E": values[0], "D": np.log(values).sum(), "A": -(1 / values).sum()}[criterion.kind]
        assert evaluate(problem, drive).objective == pytest.approx(expected, rel=1e-8)


def test_filters_are_kept():
    problem = problem_of(measurement=POSES, criterion=E())
    sensors = problem.sensors
    first, again = (filter_of(sensors, problem.system, DRIFT) for _ in range(2))
    assert first is again


@pytest.mark.slow
@pytest.mark.parametrize(
    ("sensors", "size"),
    [
        (
            [
                POSES.model_copy(update={"every": 2, "initial_pose": "known", "lever_arm": BESIDE}),
                YawRate(noise=0.03),
            ],
            2,
        ),
        ([RelativePoses(noise={"position": 0.01, "heading": 0.02}, drift=DRIFT)], 2),
        ([MOTIONS.model_copy(update={"every": 2}), POSES.model_copy(update={"every": 4})], 4),
        ([POSES, POSES, POSES], 2),
    ],
    ids=["known start, lever arm, gyroscope", "relative poses", "across samples", "many"],
)
def test_condensed_drives_are_what_they_are_written_out(sensors, size: int):
    # Of three parameters one is not asked for.
    parts = {"samples": 3 * size, "period": 0.3, "coefficients": 6, "estimate": SOME}
    problem = problem_of(measurement=sensors, criterion=E(), **parts)
    terms, written_out = Terms(problem), WrittenOut(problem)
    whole, own = written_out.functions(), called(terms)
    rng = np.random.default_rng(0)
    at, weights = rng.uniform(-0.6, 0.6, terms.size), rng.normal(size=terms.entry_count)
    none = np.zeros(len(np.array(whole.values(at)[1])))
    for found, expected in (
        (own.values(at)[0][:, None], whole.values(at)[0]),
        (own.jacobian(at)[0], whole.jacobian(at)[0]),
        (own.hessian(at, weights, none), whole.hessian(at, weights, none)),
    ):
        table = np.array(expected)
        np.testing.assert_allclose(np.array(found), table, rtol=0, atol=1e-12 * np.abs(table).max())


@pytest.mark.slow
@pytest.mark.parametrize(
    "sensors",
    [
        [POSES.model_copy(update={"every": 5}), YawRate(noise=0.03)],
        [MOTIONS.model_copy(update={"every": 4})],
    ],
    ids=["gyroscope", "across samples"],
)
def test_readings_are_weighted_by_the_walk_and_the_walk_is_what_is_simulated(sensors):
    problem = problem_of(measurement=sensors, criterion=E(), samples=12)
    drive = random_drive(problem, 3)
    estimator = Nonlinear(problem, drive)
    filtered = evaluate(problem, drive).covariances["joint"]
    np.testing.assert_allclose(estimator.covariance, filtered, rtol=1e-9)
    found = validate(problem, drive, replicates=200, seed=0)
    assert found.passed
    assert np.all(np.abs(found.paired_ratio - 1) < 0.01)


@pytest.mark.slow
def test_readings_of_a_drive_that_drifts_are_estimated_from():
    problem = problem_of(measurement=POSES, criterion=E())
    estimator = Nonlinear(problem, random_drive(problem, 3))
    exact = estimator.fit(estimator.predicted())
    assert exact.converged
    np.testing.assert_allclose(exact.values, [RADIUS, RADIUS, TRACK], rtol=1e-9)
    np.testing.assert_allclose(exact.residuals, 0, atol=1e-7)
    readings, _ = estimator._readings.simulated(np.random.default_rng(0))
    found = estimator.fit(readings)
    assert found.converged
    off = (found.values - [RADIUS, RADIUS, TRACK]) / np.sqrt(np.diag(found.covariance))
    assert np.all(np.abs(off) < 4)
    # Innovations are white: the sum of their squares is that of as many normal numbers, less the unknowns.
    freedom = len(readings) - 6
    assert abs(found.residuals @ found.residuals - freedom) < 5 * np.sqrt(2 * freedom)
    with pytest.raises(ProblemError, match="robust loss"):
        Nonlinear(problem, random_drive(problem, 3), "huber")


@pytest.mark.slow
def test_what_drift_blind_errors_would_be_is_not_what_they_are():
    problem = problem_of(measurement=POSES, criterion=E())
    drive = random_drive(problem, 3)
    estimates, _ = Nonlinear(problem, drive).simulate(np.random.default_rng(0), 200)
    blind = evaluate(problem.steady, drive).covariances["joint"]
    checks = check_all(estimates - [RADIUS, RADIUS, TRACK], blind, 0.01)
    assert not all(check.passed for check in checks)


@pytest.mark.slow
def test_bounds_without_drift_hold_with_it_and_say_so():
    problem = problem_of(measurement=POSES, criterion=E(), samples=10)
    found, steady = (bound(one, nodes=1) for one in (problem, problem.steady))
    assert found.upper_bound == steady.upper_bound
    assert STEADY in found.assumptions
    assert STEADY not in steady.assumptions
    assert all(
        evaluate(problem, random_drive(problem, seed)).objective < found.upper_bound for seed in range(5)
    )


@pytest.mark.slow
def test_a_search_that_leaves_drift_out_is_scored_with_it():
    problem = problem_of(measurement=POSES, criterion=A(), samples=6, coefficients=6, estimate=SOME)
    search = Ipopt(starts=1, perturbations=0, second_stage="none", max_iterations=20)
    aware, blind = (
        solve(problem, search.model_copy(update={"without_drift": without}), seed=0)
        for without in (False, True)
    )
    alone = solve(problem.steady, search, seed=0)
    np.testing.assert_array_equal(blind.trajectory.coefficients, alone.trajectory.coefficients)
    assert blind.evaluation.objective == evaluate(problem, alone.trajectory).objective
    assert blind.evaluation.objective < aware.evaluation.objective


class TestIssues:
    def test_what_does_not_go_with_drift_is_refused(self):
        together = Poses(noise={"covariance": np.eye(3 * 41)}, drift=DRIFT)
        with pytest.raises(ProblemError, match="drift") as refused:
            problem_of(measurement=together, criterion=E())
        assert refused.value.issues[0].key[:2] == ("measurement", "noise")

    def test_a_robot_drifts_in_one_way(self):
        other = POSES.model_copy(update={"drift": Drift(heading_per_metre=0.01)})
        with pytest.raises(ProblemError, match="one way"):
            problem_of(measurement=[POSES, other], criterion=E())
