"""What several runs tell together: the sum of what each tells, less what is unknown of each and of all."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import numpy as np
import pytest
from builders import RADIUS, SPEED, TRACK, problem_of
from sample_robots import ROBOTS, draw_inputs, motion_by_parameters
from scipy.linalg import block_diag
from sensors import PERIOD, Example, Experiment, named

from oed.foundation.errors import ProblemError
from oed.kernel.criteria import E
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.evaluation import evaluate
from oed.kernel.problem import Problem
from oed.kernel.results import Evaluation
from oed.records.outcomes import nuisance_table
from oed.robots.sensors import Displacements, Poses, Several

SAMPLES, RUNS = 11, 3
STARTS = np.array([[0.2, -0.1, 0.4], [-0.5, 0.3, 2.0], [1.0, 0.7, -1.2]])
LENGTHS = ("wheel_radius_right", "wheel_radius_left", "track")
ROBOT = ROBOTS[0]

SUITES = {
    "poses": ("poses",),
    "known start": ("poses_of_known_start",),
    "start known roughly": ("some_quantities",),
    "unknown arm": ("unknown_arm",),
    "arm known roughly": ("arm_known_roughly",),
    "noise that grows": ("noise_grows_with_speed",),
    "correlated quantities": ("correlated_quantities",),
    "correlated over time": ("correlated_over_time",),
    "ranges": ("ranges",),
    "ranges with arm": ("ranges_with_arm",),
    "poses and gyro": ("poses", "yaw_rate"),
    "arm, gyro and headings": ("unknown_arm", "yaw_rate", "headings"),
    "gyro known roughly": ("correlated_quantities", "yaw_rate_bias_known_roughly"),
}
suites = pytest.mark.parametrize("names", SUITES.values(), ids=SUITES.keys())


runs_problem = partial(
    problem_of,
    model=ROBOT.model,
    period=PERIOD,
    samples=SAMPLES,
    rest_to_rest=False,
    start="free",
    runs=RUNS,
    criterion=E(scaling="none"),
    limits=(SPEED,),
)


def some_inputs(seed: int = 3, runs: int = RUNS) -> np.ndarray:
    return draw_inputs(np.random.default_rng(seed), runs * SAMPLES, ROBOT.model)


def driven(problem: Problem, inputs: np.ndarray, starts: np.ndarray) -> Evaluation:
    runs = problem.design.runs
    start = starts if runs > 1 else starts.ravel()
    drive = Trajectory.from_samples(
        inputs, PERIOD * len(inputs), start, rest_to_rest=problem.design.rest_to_rest, runs=runs
    )
    return evaluate(problem, drive)


def measurement_of(names: Sequence[str]):
    sensors = tuple(named(name).sensor for name in names)
    if len(sensors) == 1:
        return sensors[0]
    # Sensors that the initial pose concerns have to agree on it.
    return Several(sensors=sensors)


def experiment(names: Sequence[str], inputs: np.ndarray, start: np.ndarray) -> Experiment:
    examples: tuple[Example, ...] = tuple(named(name) for name in names)
    return Experiment(
        motion=motion_by_parameters(ROBOT),
        parameters=np.array(ROBOT.model.nominal),
        sensors=examples,
        inputs=inputs,
        start=start,
        rule="arc",
    )


def together(experiments: Sequence[Experiment]) -> np.ndarray:
    """Information on the parameters, from the matrix of all unknowns of all runs written by hand.

    In the order: parameters, the sensors' own nuisances, then the initial pose of each run.
    """
    size = len(experiments[0].parameters)
    unknown = experiments[0].known > 0
    poses = int(unknown[size : size + 3].sum())
    own = int(unknown[size + 3 :].sum())
    common = size + own
    whole = np.zeros((common + poses * len(experiments),) * 2)
    for run, one in enumerate(experiments):
        jacobian = one.white_jacobian
        place = common + poses * run
        rows = np.zeros((len(jacobian), len(whole)))
        rows[:, :size] = jacobian[:, :size]
        rows[:, size:common] = jacobian[:, size + poses :]
        rows[:, place : place + poses] = jacobian[:, size : size + poses]
        whole += rows.T @ rows
        start = one.known[size : size + 3]
        whole[place : place + poses, place : place + poses] += np.diag(start[start > 0] ** -2)
    deviations = experiments[0].known[size + 3 :]
    whole[size:common, size:common] += np.diag(deviations[deviations > 0] ** -2)
    return eliminated(whole, size)


def eliminated(whole: np.ndarray, kept: int) -> np.ndarray:
    """What is left on the first unknowns; a covariance cut out and inverted."""
    scale = np.sqrt(np.diag(whole))
    inverse = np.linalg.pinv(whole / np.outer(scale, scale), rcond=1e-13, hermitian=True)
    cut = inverse[:kept, :kept] / np.outer(scale[:kept], scale[:kept])
    return np.linalg.inv(cut)


def assert_same(found: np.ndarray, expected: np.ndarray, tolerance: float = 1e-6) -> None:
    sizes = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(
        found / np.outer(sizes, sizes), expected / np.outer(sizes, sizes), rtol=0, atol=tolerance
    )


def assert_at_least(more: np.ndarray, less: np.ndarray) -> None:
    """In the order of Loewner, but for rounding."""
    sizes = np.sqrt(np.diag(more))
    assert np.linalg.eigvalsh((more - less) / np.outer(sizes, sizes))[0] >= -1e-9


class TestSensors:
    @suites
    @pytest.mark.slow
    def test_information_is_that_of_the_joint_matrix(self, names: tuple[str, ...]):
        inputs = some_inputs()
        found = driven(runs_problem(measurement=measurement_of(names)), inputs, STARTS).information["joint"]
        parts = np.split(inputs, RUNS)
        expected = together(
            [experiment(names, part, start) for part, start in zip(parts, STARTS, strict=True)]
        )
        assert_same(found, expected, 1e-4)

    @suites
    def test_the_white_design_is_the_runs_one_below_the_other(self, names: tuple[str, ...]):
        """Sensor by sensor, each sensor's runs in turn."""
        measurement, inputs = measurement_of(names), some_inputs()
        found = driven(runs_problem(measurement=measurement), inputs, STARTS)
        single = runs_problem(measurement=measurement, runs=1)
        parts = zip(np.split(inputs, RUNS), STARTS, strict=True)
        each = [driven(single, part, start) for part, start in parts]
        rows = np.vstack([one.design_matrices["joint"] for one in each])
        own = found.design_matrices["joint"]
        assert own.shape == rows.shape
        order = [np.lexsort(np.round(table, 6).T) for table in (own, rows)]
        np.testing.assert_allclose(own[order[0]], rows[order[1]], rtol=1e-7, atol=1e-5)
        assert found.norm_y == pytest.approx(math.hypot(*(one.norm_y for one in each)), rel=1e-9)

    @pytest.mark.parametrize("names", [SUITES["poses"], SUITES["known start"], SUITES["noise that grows"]])
    def test_without_common_nuisances_it_adds_up(self, names: tuple[str, ...]):
        inputs, single = some_inputs(), runs_problem(measurement=measurement_of(names), runs=1)
        found = driven(runs_problem(measurement=measurement_of(names)), inputs, STARTS).information["joint"]
        parts = zip(np.split(inputs, RUNS), STARTS, strict=True)
        assert_same(found, sum(driven(single, *part).information["joint"] for part in parts), 1e-9)

    @pytest.mark.parametrize("names", [SUITES["unknown arm"], SUITES["poses and gyro"]])
    def test_a_common_nuisance_is_worth_more_than_one_in_every_run(self, names: tuple[str, ...]):
        inputs, single = some_inputs(), runs_problem(measurement=measurement_of(names), runs=1)
        found = driven(runs_problem(measurement=measurement_of(names)), inputs, STARTS).information["joint"]
        apart = sum(
            driven(single, part, start).information["joint"]
            for part, start in zip(np.split(inputs, RUNS), STARTS, strict=True)
        )
        assert_at_least(found, apart)
        assert np.linalg.eigvalsh(found - apart)[-1] > 1e-3 * np.linalg.eigvalsh(apart)[0]

    @suites
    def test_equal_runs_tell_that_often(self, names: tuple[str, ...]):
        """With what is unknown of all runs as well as of each; what is known beforehand counts once."""
        measurement, inputs = measurement_of(names), some_inputs(runs=1)
        single = driven(runs_problem(measurement=measurement, runs=1), inputs, STARTS[0]).information["joint"]
        found = driven(runs_problem(measurement=measurement), np.tile(inputs, (RUNS, 1)), STARTS[[0, 0, 0]])
        examples = [named(name) for name in names]
        if any(0 < deviation < math.inf for one in examples for _, deviation in one.own):
            assert_at_least(RUNS * single, found.information["joint"])
        else:
            assert_same(found.information["joint"], RUNS * single, 1e-7)

    def test_knowing_less_tells_less(self):
        """Starts known, known roughly, unknown; and a run longer, which has only one start to find."""
        noise, inputs = {"position": 1e-3, "heading": 0.01}, some_inputs()
        known, roughly, unknown = (
            driven(
                runs_problem(measurement=Poses(noise=noise, initial_pose=pose)), inputs, STARTS
            ).information["joint"]
            for pose in ("known", {"position": 1e-3, "heading": 0.01}, "unknown")
        )
        assert_at_least(known, roughly)
        assert_at_least(roughly, unknown)
        assert np.linalg.eigvalsh(known - unknown)[0] > 0

    def test_starts_of_their_own_tell_less_than_one_unknown_start_of_all(self):
        """The same readings, with one displacement of all runs unknown instead of one of each."""
        inputs, names = some_inputs(), ("poses",)
        each = [
            experiment(names, part, start) for part, start in zip(np.split(inputs, RUNS), STARTS, strict=True)
        ]
        jacobians = [one.white_jacobian for one in each]
        shared = np.vstack(jacobians)
        found = driven(runs_problem(measurement=named("poses").sensor), inputs, STARTS).information["joint"]
        assert_at_least(eliminated(shared.T @ shared, 3) * (1 + 1e-6), found)

    def test_the_nuisances_names(self):
        sensors = (named("unknown_arm").sensor, named("yaw_rate").sensor)
        names = [
            row.name for row in nuisance_table(runs_problem(measurement=Several(sensors=sensors), runs=2))
        ]
        poses = [f"initial_pose_{run}.{state}" for run in (1, 2) for state in ("x", "y", "heading")]
        assert names == [*poses, "poses.lever_arm.x", "poses.lever_arm.y", "yaw_rate.bias"]
        known = named("poses_of_known_start").sensor
        assert nuisance_table(runs_problem(measurement=known)) == []

    def test_a_covariance_of_all_readings_is_that_of_one_run(self):
        sensor = named("correlated_over_time").sensor
        assert len(sensor.noise.covariance) == 2 * len(range(0, SAMPLES + 1, sensor.every))
        runs_problem(measurement=sensor)
        covariance = block_diag(*[sensor.noise.covariance] * RUNS).tolist()
        with pytest.raises(ProblemError, match=r"or 6 \(all readings\), got 18"):
            runs_problem(measurement=Poses(quantities=("x", "y"), noise={"covariance": covariance}, every=5))


NOISE = {"position": 2e-3, "heading": 0.01}
KINDS = [("increments", "gls"), ("absolute", "gls"), ("absolute", "ols")]
COORDINATES = {"position": 2, "heading": 1}


def regression(kind: tuple[str, str], segments=4) -> Displacements:
    return Displacements(
        segments=segments, regressor="both", noise=NOISE, noise_model=kind[0], estimator=kind[1]
    )


def spread_of(rows: int, coordinates: int) -> np.ndarray:
    """Covariance of one run's increments in units of a pose's error."""
    segments = rows // coordinates
    difference = np.eye(segments + 1)[1:] - np.eye(segments + 1)[:-1]
    return np.kron(difference @ difference.T, np.eye(coordinates))


class TestRegressions:
    @pytest.mark.parametrize("kind", KINDS, ids="-".join)
    @pytest.mark.parametrize("segments", [4, "samples"])
    def test_designs_and_information(self, kind: tuple[str, str], segments):
        measurement, inputs = regression(kind, segments), some_inputs()
        found = driven(runs_problem(measurement=measurement), inputs, STARTS)
        single = runs_problem(measurement=measurement, runs=1)
        parts = zip(np.split(inputs, RUNS), STARTS, strict=True)
        each = [driven(single, part, start) for part, start in parts]
        for name, coordinates in COORDINATES.items():
            designs = [one.design_matrices[name] for one in each]
            stacked = np.vstack(designs)
            np.testing.assert_allclose(found.design_matrices[name], stacked, rtol=0, atol=1e-10)
            spread = block_diag(*(spread_of(len(design), coordinates) for design in designs))
            if kind[0] == "increments":
                spread = np.eye(len(stacked))
            if kind[1] == "gls":
                expected = stacked.T @ np.linalg.solve(spread, stacked)
            else:
                inverse = np.linalg.inv(stacked.T @ stacked)
                expected = np.linalg.inv(inverse @ stacked.T @ spread @ stacked @ inverse)
            np.testing.assert_allclose(found.information[name], expected, rtol=1e-8)
            full = expected / NOISE[name] ** 2
            np.testing.assert_allclose(found.full_information[name], full, rtol=1e-8)

    @pytest.mark.parametrize("kind", KINDS, ids="-".join)
    def test_equal_runs_tell_that_often_wherever_they_start(self, kind: tuple[str, str]):
        measurement, inputs = regression(kind), some_inputs(runs=1)
        single = driven(runs_problem(measurement=measurement, runs=1), inputs, STARTS[0])
        found = driven(runs_problem(measurement=measurement), np.tile(inputs, (RUNS, 1)), STARTS)
        for name in COORDINATES:
            expected = RUNS * single.information[name]
            np.testing.assert_allclose(found.information[name], expected, rtol=1e-8)

    def test_segments_do_not_cross_runs(self):
        edges = regression(KINDS[0]).segment_edges(SAMPLES, RUNS)
        assert len(edges) == 4 * RUNS + 1
        assert {0, SAMPLES, 2 * SAMPLES, 3 * SAMPLES} <= set(edges.tolist())
        own = np.diff(edges).reshape(RUNS, 4)
        assert np.all(own == own[0])
        assert own[0].max() - own[0].min() <= 1

    def test_what_one_run_does_leaves_the_others_rows_alone(self):
        measurement, inputs = regression(KINDS[0]), some_inputs()
        changed = inputs.copy()
        changed[SAMPLES : 2 * SAMPLES] *= 0.5
        problem = runs_problem(measurement=measurement)
        before, after = (
            driven(problem, rows, STARTS).design_matrices["position"] for rows in (inputs, changed)
        )
        different = np.abs(before - after).max(axis=1) > 1e-12
        assert different[8:16].all()
        assert not different[:8].any()
        assert not different[16:].any()

    def test_the_papers_robot(self):
        """A straight run and a turn on the spot, each told by one direction alone: sizes by hand."""
        problem = runs_problem(measurement=Displacements(segments=1), runs=2)
        inputs = np.vstack([np.full((SAMPLES, 2), 4.0), np.tile([4.0, -4.0], (SAMPLES, 1))])
        found = driven(problem, inputs, STARTS[:2]).information["position"]
        time = PERIOD * SAMPLES
        length = 4.0 * time
        turn = 2 * RADIUS * length / TRACK
        chord = 2 * math.sin(turn / 2) * TRACK / (2 * RADIUS)
        ones, opposite = np.ones((2, 2)), np.array([[1.0, -1.0], [-1.0, 1.0]])
        np.testing.assert_allclose(found, length**2 * ones + chord**2 * opposite, rtol=1e-9)
