"""Displacements of measured poses: neighbours share an error, and what that does to the information."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from builders import RADIUS, SPEED, TRACK, problem_of
from hypothesis import given, settings
from hypothesis import strategies as st
from sample_robots import ROBOTS, TWO_SIDED, Example, cases, draw_inputs
from scipy.linalg import block_diag

from oed.foundation.errors import PartError
from oed.kernel.criteria import E
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.evaluation import evaluate
from oed.kernel.problem import Problem
from oed.kernel.results import Evaluation
from oed.robots.sensors import Displacements
from oed.robots.space import DesignSpace

SAMPLES, DURATION, START = 23, 5.0, (0.2, -0.1, 0.4)
NOISE = {"position": 2e-3, "heading": 0.01}
COORDINATES = {"position": 2, "heading": 1}

robots = pytest.mark.parametrize("example", cases(TWO_SIDED))
rules = pytest.mark.parametrize("rule", ["arc", "midpoint"])
estimators = pytest.mark.parametrize("estimator", ["gls", "ols"])
seeds = st.integers(0, 2**32 - 1)


@cache
def problem_for(
    model=ROBOTS[0].model,
    rule: str = "arc",
    segments=5,
    *,
    samples: int = SAMPLES,
    scaling: str = "none",
    noisy: bool = True,
    **measurement,
) -> Problem:
    return problem_of(
        model=model,
        design=DesignSpace(
            duration=DURATION, samples=samples, integration=rule, rest_to_rest=False, start="free"
        ),
        measurement=Displacements(
            segments=segments, regressor="both", noise=NOISE if noisy else {}, **measurement
        ),
        limits=(SPEED,),
        criterion=E(scaling=scaling),
    )


def driven(problem: Problem, inputs: np.ndarray) -> Evaluation:
    return evaluate(problem, Trajectory.from_samples(inputs, DURATION, START, rest_to_rest=False))


def some_inputs(example: Example = ROBOTS[0], seed: int = 4) -> np.ndarray:
    return draw_inputs(np.random.default_rng(seed), SAMPLES, example.model)


def differences(rows: int, coordinates: int) -> np.ndarray:
    """What takes the coordinates of all poses between segments, one after the other, to the rows of W."""
    segments = rows // coordinates
    matrix = np.zeros((rows, rows + coordinates))
    for segment in range(segments):
        for coordinate in range(coordinates):
            row = segment * coordinates + coordinate
            matrix[row, row] = -1.0
            matrix[row, row + coordinates] = 1.0
    return matrix


def direct(design: np.ndarray, coordinates: int, estimator: str) -> np.ndarray:
    """Information in units of sigma: of generalised, or of ordinary least squares (sandwich)."""
    difference = differences(len(design), coordinates)
    spread = difference @ difference.T
    if estimator == "gls":
        return design.T @ np.linalg.inv(spread) @ design
    bread = np.linalg.inv(design.T @ design)
    return np.linalg.inv(bread @ design.T @ spread @ design @ bread)


# What is made of the rows knows nothing of the robot that they are of.
@pytest.mark.parametrize(
    ("example", "rule", "estimator", "segments"),
    [
        *((example, "arc", "gls", 5) for example in TWO_SIDED),
        (TWO_SIDED[0], "arc", "ols", "samples"),
        (TWO_SIDED[0], "midpoint", "gls", "samples"),
        (TWO_SIDED[0], "midpoint", "ols", 5),
    ],
    ids=lambda one: getattr(one, "name", str(one)),
)
def test_information_is_numpys(example: Example, rule: str, estimator: str, segments):
    problem = problem_for(example.model, rule, segments, noise_model="absolute", estimator=estimator)
    found = driven(problem, some_inputs(example))
    for name, coordinates in COORDINATES.items():
        expected = direct(found.design_matrices[name], coordinates, estimator)
        sizes = np.sqrt(np.diag(expected))
        scale = np.outer(sizes, sizes)
        np.testing.assert_allclose(found.information[name] / scale, expected / scale, rtol=0, atol=1e-9)


@estimators
@pytest.mark.parametrize("noise_model", ["increments", "absolute"])
@pytest.mark.slow
def test_scaling_none_leaves_the_noise_out_and_relative_does_not(noise_model: str, estimator: str):
    way = {"noise_model": noise_model, "estimator": estimator}
    inputs = some_inputs()
    raw, silent, relative = (
        driven(problem_for(**way, **parts), inputs)
        for parts in ({}, {"noisy": False}, {"scaling": "relative"})
    )
    nominal = {"heading": RADIUS / TRACK, "position": RADIUS / 2}
    for name, sigma in NOISE.items():
        np.testing.assert_array_equal(silent.information[name], raw.information[name])
        scaled = raw.information[name] * (nominal[name] / sigma) ** 2
        np.testing.assert_allclose(relative.information[name], scaled, rtol=1e-12)
        covariance = sigma**2 * np.linalg.inv(raw.information[name])
        np.testing.assert_allclose(raw.covariances[name], covariance, rtol=1e-9)
        np.testing.assert_allclose(relative.covariances[name], covariance, rtol=1e-9)
    assert silent.covariances == {}


@pytest.mark.slow
@given(seed=seeds, segments=st.sampled_from([2, 5, SAMPLES]))
def test_generalised_least_squares_tell_no_less_than_ordinary_ones(seed: int, segments: int):
    gls, ols = (
        driven(
            problem_for(segments=segments, noise_model="absolute", estimator=estimator),
            some_inputs(seed=seed),
        )
        for estimator in ("gls", "ols")
    )
    for name in COORDINATES:
        sizes = np.sqrt(np.diag(gls.information[name]))
        gap = (gls.information[name] - ols.information[name]) / np.outer(sizes, sizes)
        assert np.linalg.eigvalsh(gap)[0] >= -1e-9


@robots
def test_the_estimator_is_of_no_matter_to_independent_increments(example: Example):
    problems = [problem_for(example.model)]
    problems += [
        problem_for(example.model, noise_model="increments", estimator=estimator)
        for estimator in ("gls", "ols")
    ]
    plain, gls, ols = (driven(problem, some_inputs(example)) for problem in problems)
    for name, design in plain.design_matrices.items():
        np.testing.assert_allclose(plain.information[name], design.T @ design, rtol=1e-13)
        np.testing.assert_array_equal(gls.information[name], plain.information[name])
        np.testing.assert_array_equal(ols.information[name], plain.information[name])


@estimators
def test_one_segment_has_the_errors_of_two_poses(estimator: str):
    space = DesignSpace(duration=DURATION, samples=SAMPLES, rest_to_rest=False, start="free")
    problem = problem_of(
        design=space,
        measurement=Displacements(segments=1, noise_model="absolute", estimator=estimator),
        limits=(SPEED,),
    )
    found = driven(problem, some_inputs())
    design = found.design_matrices["position"]
    np.testing.assert_allclose(found.information["position"], design.T @ design / 2, rtol=1e-9)


@settings(max_examples=10)
@given(turn=st.floats(-7, 7), x=st.floats(-20, 20), segments=st.sampled_from([2, 5, SAMPLES]))
@estimators
@pytest.mark.slow
def test_where_the_drive_begins_is_of_no_matter(estimator: str, turn: float, x: float, segments: int):
    problem = problem_for(segments=segments, noise_model="absolute", estimator=estimator)
    here = driven(problem, some_inputs()).information["position"]
    drive = Trajectory.from_samples(some_inputs(), DURATION, (x, 0, turn), rest_to_rest=False)
    there = evaluate(problem, drive).information["position"]
    np.testing.assert_allclose(there, here, rtol=0, atol=1e-9 * np.trace(here))


class TestNaiveVariance:
    """A long smooth drive with a row per sample, whose noise is that of the poses: sigma^2 (W'W)^-1 is far
    off, and ordinary least squares waste what the generalised ones use.
    """

    COUNT, REPLICATES = 60, 20_000

    @classmethod
    def drive(cls, **measurement) -> Evaluation:
        times = np.linspace(0, 2 * np.pi, cls.COUNT)
        inputs = np.column_stack([6 + 3 * np.sin(times), 6 - 3 * np.sin(times + 0.5)])
        return driven(problem_for(segments="samples", samples=cls.COUNT, **measurement), inputs)

    def test_it_is_much_too_large(self):
        naive = self.drive().covariances["position"]
        sandwich = self.drive(noise_model="absolute", estimator="ols").covariances["position"]
        gls = self.drive(noise_model="absolute").covariances["position"]
        assert (np.diag(naive) > 10 * np.diag(sandwich)).all()
        assert (np.diag(sandwich) > 1.5 * np.diag(gls)).all()
        assert np.linalg.eigvalsh(sandwich - gls)[0] > 0

    @pytest.mark.parametrize("name", ["position", "heading"])
    @estimators
    @pytest.mark.slow
    def test_simulated_estimates_scatter_as_promised(self, name: str, estimator: str):
        found = self.drive(noise_model="absolute", estimator=estimator)
        design, difference = (
            found.design_matrices[name],
            differences(self.COUNT * COORDINATES[name], COORDINATES[name]),
        )
        weight = np.linalg.inv(difference @ difference.T) if estimator == "gls" else np.eye(len(design))
        gain = np.linalg.solve(design.T @ weight @ design, design.T @ weight)
        errors = np.random.default_rng(0).normal(0, NOISE[name], (self.REPLICATES, difference.shape[1]))
        sampled = np.cov((errors @ difference.T @ gain.T).T)
        promised = found.covariances[name]
        # A variance of 20,000 replicates is off by 1 % (standard deviation).
        np.testing.assert_allclose(np.diag(sampled), np.diag(promised), rtol=0.05)
        whitened = np.linalg.solve(np.linalg.cholesky(promised), sampled)
        np.testing.assert_allclose(
            np.linalg.solve(np.linalg.cholesky(promised), whitened.T), np.eye(2), atol=0.05
        )


@pytest.mark.slow
def test_both_coordinates_add_up():
    found = driven(problem_for(noise_model="absolute"), some_inputs())
    design = found.design_matrices["position"]
    apart = [direct(design[coordinate::2], 1, "gls") for coordinate in range(2)]
    np.testing.assert_allclose(found.information["position"], sum(apart), rtol=1e-9)
    stacked = np.vstack([design[0::2], design[1::2]])
    spread = block_diag(*[differences(5, 1) @ differences(5, 1).T] * 2)
    np.testing.assert_allclose(
        found.information["position"], stacked.T @ np.linalg.inv(spread) @ stacked, rtol=1e-9
    )


@pytest.mark.parametrize("wrong", [{"noise_model": "drift"}, {"estimator": "ridge"}])
def test_unknown_ways_are_refused(wrong):
    with pytest.raises(PartError, match=next(iter(wrong))):
        Displacements(**wrong)
