"""Searches that look at fewer samples than the drive has."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import ACCELERATION, SPEED, problem_of

from oed.kernel.coarser import MOST_SEARCHED, USUAL, coarse_samples
from oed.kernel.criteria import D, E
from oed.kernel.dynamics.space import Spline
from oed.kernel.evaluation import evaluate
from oed.kernel.problem import Problem
from oed.optimize import Ipopt, solve
from oed.optimize.local import MISLED, LocalSearch
from oed.optimize.transcription.coarse import SearchGrid
from oed.optimize.transcription.starting_points import random_drives
from oed.robots.sensors import Displacements, Poses, Several, YawRate
from oed.robots.space import DesignSpace
from oed.uncertainty.robust import Robust
from oed.uncertainty.uncertainty import Uncertainty

pytestmark = pytest.mark.usefixtures("few_screened")

POSES = Poses(noise={"position": 0.01, "heading": 0.02}, every=2)

MEASUREMENTS = {
    "segments": Displacements(segments=6, regressor="both"),
    "samples": Displacements(segments="samples"),
    "poses": POSES,
    "two sensors": Several(sensors=(POSES, YawRate(noise=0.01, every=2))),
}
measurements = pytest.mark.parametrize("measurement", MEASUREMENTS.values(), ids=MEASUREMENTS.keys())


def fine_problem(samples: int = 240, **overrides: object) -> Problem:
    space = {"duration": 6, "samples": samples, "spline": Spline(coefficients=7)}
    return problem_of(**{"design": DesignSpace(**space), **overrides})


def some_drive(grid: SearchGrid, seed: int = 0) -> np.ndarray:
    return random_drives(grid.design, np.array([0.5]), np.random.default_rng(seed))[0]


@pytest.mark.parametrize(
    ("samples", "segments", "expected"),
    [
        (200, 10, 200),
        (MOST_SEARCHED, 10, MOST_SEARCHED),
        (1000, 10, USUAL),
        (20000, "samples", USUAL),
        (5000, 7, 406),
    ],
)
def test_segments_of_a_coarse_grid_are_equally_long(samples: int, segments, expected: int):
    space = DesignSpace(duration=20, samples=samples)
    problem = problem_of(design=space, measurement=Displacements(segments=segments))
    assert coarse_samples(problem) == expected


def test_splines_of_many_coefficients_need_a_finer_grid():
    space = DesignSpace(duration=20, samples=20000, spline=Spline(coefficients=100))
    assert coarse_samples(problem_of(design=space)) == 1200


def test_up_to_600_samples_are_looked_at_one_by_one():
    grid = SearchGrid(fine_problem())
    assert not grid.coarse
    assert grid.design.problem is grid.problem
    assert grid.corrections.numel() == 0


@measurements
@pytest.mark.parametrize("runs", [1, 2])
@pytest.mark.slow
def test_corrected_it_tells_what_all_samples_tell(measurement, runs: int):
    design = fine_problem().design.model_copy(update={"runs": runs})
    grid = SearchGrid(fine_problem(design=design, measurement=measurement), 60)
    assert grid.coarse
    unknowns = some_drive(grid)
    drive = grid.trajectory(unknowns)
    assert drive.samples == 240 * runs
    evaluation = evaluate(grid.problem, drive)
    found = grid.matrices_of(unknowns, grid.correction(unknowns))[0]
    for matrix, told in zip(found, evaluation.information.values(), strict=True):
        np.testing.assert_allclose(matrix, told, rtol=1e-9, atol=1e-9 * np.abs(told).max())
    # Nearby as well, to second order.
    step = 1e-4 * np.random.default_rng(1).standard_normal(len(unknowns))
    near = evaluate(grid.problem, grid.trajectory(unknowns + step)).information.values()
    found = grid.matrices_of(unknowns + step, grid.correction(unknowns))[0]
    for matrix, told in zip(found, near, strict=True):
        np.testing.assert_allclose(matrix, told, rtol=0, atol=1e-6 * np.abs(told).max())
    # It was close before: the correction mends a few percent, for this drive and for others.
    for seed in (0, 1):
        other = some_drive(grid, seed)
        rough = grid.matrices_of(other, grid.no_correction)[0]
        for matrix, told in zip(
            rough, evaluate(grid.problem, grid.trajectory(other)).information.values(), strict=True
        ):
            assert np.linalg.norm(matrix - told) < 0.1 * np.linalg.norm(told)


@pytest.mark.slow
@pytest.mark.parametrize(
    "overrides",
    [
        {"measurement": Poses(noise={"covariance": np.eye(3 * 81) * 1e-4})},
        {
            "measurement": POSES,
            "criterion": E(),
            "uncertainty": Uncertainty(within={"track": 0.05}),
            "robust": Robust(objective="mean"),
        },
    ],
    ids=["a covariance of all readings", "several robots judged"],
)
def test_what_needs_all_samples_gets_them(overrides: dict):
    assert not SearchGrid(fine_problem(samples=80, **overrides), 20).coarse


@pytest.mark.slow
@pytest.mark.parametrize(
    ("measurement", "criterion"),
    [(MEASUREMENTS["samples"], E(scaling="none")), (POSES, D())],
    ids=["samples", "poses, D"],
)
def test_a_search_on_few_samples_ends_where_one_on_all_does(measurement, criterion):
    problem = fine_problem(48, measurement=measurement, criterion=criterion)
    whole = solve(problem, Ipopt(starts=1, perturbations=0, second_stage="none"), seed=0, workers=1)
    # From the same design, lest another of many optima is found.
    plain = {"perturbations": 0, "second_stage": "none"}
    quick = Ipopt(starts=1, start_from="whole", search_samples=24, **plain)
    few = solve(problem, quick, seed=0, workers=1, earlier={"whole": whole})
    assert few.trajectory.samples == 48
    assert few.evaluation.feasible
    assert few.evaluation.objective == evaluate(problem, few.trajectory).objective
    best = whole.evaluation.objective
    # Limits are tightened a little more where the path is seen at fewer points.
    assert few.evaluation.objective >= best - 2e-3 * abs(best)


@pytest.mark.slow
def test_where_a_search_on_few_samples_ends_nothing_is_left_to_gain_on_all():
    # Limits on inputs alone, which are the same on every grid.
    few, whole = (
        LocalSearch(
            fine_problem(24, measurement=MEASUREMENTS["samples"], limits=(SPEED, ACCELERATION)),
            Ipopt(max_iterations=200, search_samples=samples),
        )
        for samples in (8, 24)
    )
    assert few.grid.coarse
    assert not whole.grid.coarse
    end = few.maximise(some_drive(few.grid))
    # A small barrier keeps to where it begins, lest another of many optima is found.
    assert whole.maximise(end.unknowns, barrier=1e-5).objective <= end.objective * (1 + MISLED)


@pytest.mark.slow
def test_a_long_drive_is_designed_as_well_as_a_short_one():
    options = Ipopt(starts=1, perturbations=0, second_stage="none")
    problem = fine_problem(samples=720)
    solution = solve(problem, options, seed=0, workers=1)
    assert solution.trajectory.samples == 720
    assert solution.evaluation.feasible
    short = replace(problem, design=problem.design.model_copy(update={"samples": 200}))
    again = solve(short, options, seed=0, workers=1)
    assert solution.evaluation.objective == pytest.approx(again.evaluation.objective, rel=2e-3)


@pytest.mark.parametrize(("wanted", "expected"), [(60, 60), (50, 54), (4, 6)])
def test_a_grid_asked_for_has_segments_of_equal_length_too(wanted: int, expected: int):
    grid = SearchGrid(fine_problem(measurement=MEASUREMENTS["segments"]), wanted)
    assert grid.design.problem.design.samples == expected
