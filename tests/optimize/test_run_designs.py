"""Designs of several runs: feasible, each in its room and at rest at its ends, up to the known optimum."""

from __future__ import annotations

from functools import cache, partial
from typing import Any

import numpy as np
import oracle
import pytest
from builders import RADIUS, TRACK, problem_of, random_drive, upper_bound

from oed.kernel.dynamics.space import Spline
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.evaluation import evaluate
from oed.kernel.solution import Solution, Status
from oed.optimize import Genetic, Ipopt, solve
from oed.optimize.transcription.design import DesignExpressions
from oed.optimize.transcription.starting_points import random_starts, start_bounds
from oed.robots.sensors import Displacements, Poses
from oed.robots.space import DesignSpace, StartPose

pytestmark = pytest.mark.usefixtures("few_screened")

RUNS, SEGMENTS, HALF_SIDE = 3, 2, 1.0
LISTED = (StartPose(), StartPose(x=0.5, y=-0.5, heading=1.0), StartPose(x=-0.7, heading=-2.0))
STARTS: dict[str, Any] = {"fixed": StartPose(x=0.2), "listed": LISTED, "free": "free"}
SEARCHES = {
    "ipopt": Ipopt(starts=1, perturbations=0, second_stage="none"),
    "genetic": Genetic(population=40, generations=10),
}
starts = pytest.mark.parametrize("start", STARTS)


runs_problem = partial(
    problem_of,
    duration=4,
    samples=8,
    coefficients=7,
    start=STARTS["fixed"],
    runs=RUNS,
    measurement=Displacements(segments=SEGMENTS),
)


@cache
def solved(search: str, start: str) -> Solution:
    return solve(runs_problem(start=STARTS[start]), SEARCHES[search], seed=1, workers=1)


def by_oracle(drive: Trajectory, segments: int) -> tuple[np.ndarray, np.ndarray]:
    """Information of the position regressor, added up over the runs, and all places visited, by loops."""
    count = drive.samples // drive.runs
    edges = np.rint(np.linspace(0, count, segments + 1)).astype(int)
    total, path = np.zeros((2, 2)), []
    for run in range(drive.runs):
        held = drive.inputs[run * count : (run + 1) * count]
        twists = np.array([oracle.differential_twist(row, RADIUS, RADIUS, TRACK) for row in held])
        poses = oracle.roll_out(twists, drive.start[run], drive.period, "arc")
        _, design = oracle.segment_regressors(held, poses[:-1, 2], twists[:, 2], drive.period, edges, "arc")
        total += design.T @ design
        path.append(oracle.fine_path(twists, drive.start[run], drive.period, "arc", 10)[:, :2])
    return total, np.array(path)


@pytest.mark.slow
@pytest.mark.parametrize("search", SEARCHES)
@starts
class TestDesigns:
    def test_feasible_by_evaluate(self, search: str, start: str):
        solution = solved(search, start)
        found = evaluate(runs_problem(start=STARTS[start]), solution.trajectory)
        assert found.feasible
        assert found.objective == pytest.approx(solution.evaluation.objective, rel=1e-12)
        assert solution.trajectory.runs == RUNS

    def test_the_oracle_agrees(self, search: str, start: str):
        solution = solved(search, start)
        information, path = by_oracle(solution.trajectory, SEGMENTS)
        least = np.linalg.eigvalsh(information)[0]
        assert solution.evaluation.objective == pytest.approx(least, rel=1e-8)
        assert path.shape[0] == RUNS
        assert np.abs(path).max() <= HALF_SIDE * (1 + 1e-3)

    def test_each_run_starts_where_it_should_and_rests_at_its_ends(self, search: str, start: str):
        drive = solved(search, start).trajectory
        for run, one in enumerate(drive.each):
            np.testing.assert_allclose(one.inputs_at(np.array([0.0, one.duration])), 0, atol=1e-12)
            assert np.abs(one.inputs).max() > 1.0
            if start != "free":
                np.testing.assert_array_equal(one.start, runs_problem(start=STARTS[start]).fixed_starts[run])
        if start == "free":
            assert len(np.unique(drive.start[:, 0])) == RUNS

    def test_the_cap_is_not_exceeded(self, search: str, start: str):
        assert solved(search, start).evaluation.objective <= upper_bound(RUNS * SEGMENTS) * (1 + 1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("search", SEARCHES)
def test_the_number_of_workers_changes_nothing(search: str, monkeypatch: pytest.MonkeyPatch):
    for place in ("search.POOL_SECONDS", "candidate_scores.WORTH", "candidate_scores.WRITING"):
        monkeypatch.setattr(f"oed.optimize.{place}", 0.0)
    # Three starts, of which the first is done alone; few steps.
    less = {"ipopt": {"starts": 3, "perturbations": 0, "max_iterations": 10}, "genetic": {"generations": 3}}
    options, problem = SEARCHES[search].model_copy(update=less[search]), runs_problem(start="free")
    one, two = (solve(problem, options, seed=1, workers=workers) for workers in (1, 2))
    np.testing.assert_array_equal(one.trajectory.coefficients, two.trajectory.coefficients)
    np.testing.assert_array_equal(one.trajectory.start, two.trajectory.start)


@pytest.mark.slow
def test_the_optimum_of_all_runs_is_reached():
    """Every segment of every run turns half round: lambda_min is 2 (3 P) (B / r)^2 and cannot be more."""
    space = DesignSpace(duration=8, samples=32, spline=Spline(coefficients=10), runs=RUNS)
    problem = problem_of(design=space, measurement=Displacements(segments=4))
    solution = solve(problem, Ipopt(starts=1, perturbations=0, second_stage="none"), seed=0, workers=1)
    assert (
        0.999 * upper_bound(4 * RUNS) <= solution.evaluation.objective <= upper_bound(4 * RUNS) * (1 + 1e-9)
    )
    assert solution.status is Status.CONVERGED
    information, _ = by_oracle(solution.trajectory, 4)
    assert np.linalg.eigvalsh(information)[0] == pytest.approx(solution.evaluation.objective, rel=1e-8)


@pytest.mark.slow
def test_sensors_with_unknown_starts():
    measurement = Poses(noise={"position": 1e-3, "heading": 0.01})
    problem = runs_problem(start=STARTS["listed"], measurement=measurement, samples=8)
    solution = solve(problem, Ipopt(starts=1, perturbations=0, second_stage="none"), seed=0, workers=1)
    assert evaluate(problem, solution.trajectory).feasible
    best = solution.evaluation.objective
    assert best > max(evaluate(problem, random_drive(problem, seed)).objective for seed in range(5))


class TestProgram:
    @starts
    @pytest.mark.parametrize("rest", [True, False])
    def test_unknowns_and_drives_are_each_others_inverse(self, start: str, rest: bool):
        space = runs_problem(start=STARTS[start]).design.model_copy(update={"rest_to_rest": rest})
        problem = runs_problem(start=STARTS[start], design=space)
        design = DesignExpressions(problem)
        free = 7 - 2 * rest
        assert design.terms.size == RUNS * 2 * free + (3 * RUNS if start == "free" else 0)
        unknowns = np.random.default_rng(0).uniform(-1, 1, design.terms.size)
        drive = design.trajectory(unknowns)
        np.testing.assert_allclose(design.unknowns_of(drive), unknowns, rtol=1e-14)
        again = design.trajectory(design.unknowns_of(random_drive(problem, 2)))
        np.testing.assert_allclose(again.coefficients, random_drive(problem, 2).coefficients, rtol=1e-14)
        np.testing.assert_array_equal(again.start, random_drive(problem, 2).start)

    @pytest.mark.slow
    @starts
    @pytest.mark.parametrize("degree", [0, 1, 3])
    def test_it_scores_as_evaluate(self, start: str, degree: int):
        spline = Spline(degree=degree, coefficients=7)
        space = runs_problem(start=STARTS[start]).design.model_copy(update={"spline": spline})
        problem = runs_problem(start=STARTS[start], design=space)
        design = DesignExpressions(problem)
        drives = [random_drive(problem, seed, 4.0) for seed in range(5)]
        values, violations = design.score_many(np.array([design.unknowns_of(drive) for drive in drives]))
        violations = np.maximum(0.0, violations)
        found = [evaluate(problem, drive) for drive in drives]
        np.testing.assert_allclose(values, [one.objective for one in found], rtol=1e-9)
        for row, one in zip(violations, found, strict=True):
            margins = {margin.name: margin.violation / margin.size for margin in one.margins}
            # At the samples only; between them the room may be exceeded by more.
            assert row[2] <= margins["workspace"] + 1e-9
            # A hull holds the curve.
            assert row[0] >= margins["wheel_speed"] - 1e-9
            assert row[1] >= margins["wheel_acceleration"] - 1e-9

    def test_another_spaces_drive_is_refused(self):
        design = DesignExpressions(runs_problem())
        one = runs_problem(start=STARTS["free"], design=runs_problem().design.model_copy(update={"runs": 1}))
        with pytest.raises(ValueError, match="not those of the design space"):
            design.unknowns_of(random_drive(one, 0))

    def test_random_starts_fill_the_room_in_every_run(self):
        design = DesignExpressions(runs_problem(start=STARTS["free"]))
        bounds = start_bounds(design)
        np.testing.assert_array_equal(bounds, np.tile([[-1, 1], [-1, 1], [-np.pi, np.pi]], (RUNS, 1)))
        poses = random_starts(design, 2000, np.random.default_rng(0))
        assert poses.shape == (2000, 3 * RUNS)
        np.testing.assert_allclose(poses.min(axis=0), bounds[:, 0], rtol=0.02)
        np.testing.assert_allclose(poses.max(axis=0), bounds[:, 1], rtol=0.02)
        assert np.abs(np.corrcoef(poses.T) - np.eye(3 * RUNS)).max() < 0.1
