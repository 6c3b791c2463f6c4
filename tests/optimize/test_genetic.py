"""Searches without derivatives: how near they come to the cap, how they end, handing over to Ipopt."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from builders import SPEED, problem_of, upper_bound
from listeners import Listener, interrupt

from oed.foundation.errors import Failure, PartError, ProblemError
from oed.kernel.dynamics.compiled import compiler
from oed.kernel.dynamics.space import Spline
from oed.kernel.evaluation import evaluate
from oed.kernel.problem import Problem
from oed.kernel.solution import Solution, Status
from oed.optimize import Genetic, Ipopt, solve
from oed.optimize.transcription.design import DesignExpressions
from oed.robots.limits import Rectangle, WheelSpeed
from oed.robots.sensors import Displacements
from oed.robots.space import DesignSpace

PROBLEM = problem_of()
TINY = Genetic(population=20, generations=4)


@pytest.fixture(scope="module")
def searched() -> Solution:
    return solve(PROBLEM, Genetic(population=60, generations=40), seed=0, workers=1)


@pytest.fixture(scope="module")
def genetic() -> Solution:
    return solve(PROBLEM, TINY, seed=0, workers=1)


@pytest.mark.slow
class TestOptimum:
    """Four segments in a 2 m box: lambda_min is at most 2 P (B / r)^2."""

    def test_a_good_share_of_the_cap_is_reached_and_it_is_not_exceeded(self, searched: Solution):
        assert 0.9 * upper_bound(4) <= searched.evaluation.objective <= upper_bound(4) * (1 + 1e-9)

    def test_the_design_is_feasible_by_evaluate(self, searched: Solution):
        evaluation = evaluate(PROBLEM, searched.trajectory)
        assert evaluation.feasible
        assert evaluation.objective == searched.evaluation.objective

    def test_no_optimum_is_claimed(self, searched: Solution):
        assert searched.status is Status.SEARCHED
        assert "nothing says that it is an optimum" in searched.message
        assert searched.starts == ()

    def test_history_rises(self, searched: Solution):
        history = searched.history
        assert len(history) > 3
        for before, after in itertools.pairwise(history):
            assert before.evaluations <= after.evaluations
            assert before.seconds <= after.seconds
            assert before.objective <= after.objective
        assert history[-1].objective == searched.evaluation.objective
        assert history[-1].seconds <= searched.wall_seconds

    @pytest.mark.slow
    @pytest.mark.parametrize("space", ["free", "moving", "held"])
    def test_other_design_spaces(self, space: str):
        designs = {
            "free": DesignSpace(duration=10, samples=40, spline=Spline(coefficients=8), start="free"),
            "moving": DesignSpace(duration=10, samples=40, spline=Spline(coefficients=8), rest_to_rest=False),
            "held": DesignSpace(duration=10, samples=40, spline=Spline(degree=0, coefficients=10)),
        }
        limits = (SPEED, Rectangle(x=(0, 1), y=(-1, 1)))
        problem = problem_of(design=designs[space], limits=limits)
        solution = solve(problem, Genetic(population=40, generations=15), seed=0, workers=1)
        assert solution.evaluation.feasible
        assert 0.3 * upper_bound(4) <= solution.evaluation.objective <= upper_bound(4) * (1 + 1e-9)


class TestOptions:
    @pytest.mark.parametrize(
        "wrong",
        [
            {"population": 3},
            {"population": 10_001},
            {"generations": 0},
            {"evaluations": 0},
            {"time_limit": "0 s"},
            {"starts": 3},
            {"crossover": "uniform"},
        ],
        ids=str,
    )
    def test_wrong_options_are_refused(self, wrong):
        with pytest.raises(PartError, match=next(iter(wrong))):
            Genetic(**wrong)


class TestEnd:
    def test_by_generations_each_scored_at_once(self, monkeypatch: pytest.MonkeyPatch):
        calls, score_many = [], DesignExpressions.score_many

        def counted(self, candidates, *more):
            calls.append(len(candidates))
            return score_many(self, candidates, *more)

        monkeypatch.setattr(DesignExpressions, "score_many", counted)
        listener = Listener()
        solution = solve(PROBLEM, TINY, seed=0, workers=1, progress=listener)
        assert len(calls) == listener.steps == listener.total == TINY.generations
        assert sum(calls) == solution.history[-1].evaluations
        assert set(calls[1:]) == {TINY.population}

    def test_by_evaluations(self):
        options = TINY.model_copy(update={"generations": 1000, "evaluations": 50})
        listener = Listener()
        solution = solve(PROBLEM, options, seed=0, workers=1, progress=listener)
        assert solution.status is Status.SEARCHED
        assert 50 <= solution.history[-1].evaluations < 50 + TINY.population
        assert listener.steps in (3, 4)

    def test_by_time(self):
        options = TINY.model_copy(update={"generations": 1000, "time_limit": 1e-6})
        listener = Listener()
        solution = solve(PROBLEM, options, seed=0, workers=1, progress=listener)
        assert listener.steps == 1
        assert solution.status is (Status.TIME_LIMIT if solution.trajectory else Status.FAILED)

    def test_the_time_limit_is_said(self):
        options = Genetic(population=40, generations=1000, time_limit=1e-6)
        solution = solve(PROBLEM, options, seed=0, workers=1)
        assert solution.status is Status.TIME_LIMIT
        assert "raise time_limit" in solution.message
        assert solution.evaluation.feasible

    @pytest.mark.slow
    def test_a_compiler_that_does_not_end_is_not_waited_for(self, tmp_path, monkeypatch):
        tool = tmp_path / "cc"
        tool.write_text("#!/bin/sh\n[ $1 = --version ] || sleep 600\n")
        tool.chmod(0o755)
        monkeypatch.setenv("CC", str(tool))
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
        options = Genetic(population=400, generations=100_000, time_limit=1)
        solution = solve(PROBLEM, options, seed=0, workers=1)
        assert solution.status is Status.TIME_LIMIT
        assert solution.wall_seconds < 30

    def test_interrupted_it_keeps_the_best(self):
        options = Genetic(population=40, generations=1000)
        listener = Listener(3, interrupt)
        solution = solve(PROBLEM, options, seed=0, workers=1, progress=listener)
        assert solution.status is Status.INTERRUPTED
        assert listener.steps == 3
        three = solve(PROBLEM, Genetic(population=40, generations=3), seed=0, workers=1)
        np.testing.assert_array_equal(solution.trajectory.coefficients, three.trajectory.coefficients)
        assert evaluate(PROBLEM, solution.trajectory).feasible

    def test_no_feasible_drive(self):
        problem = problem_of(
            duration=20,
            rest_to_rest=False,
            limits=(WheelSpeed(bounds=(3, 10)), Rectangle(x=(-0.1, 0.1), y=(-0.1, 0.1))),
        )
        solution = solve(problem, TINY, seed=0, workers=1)
        assert solution.status is Status.FAILED
        assert (solution.trajectory, solution.evaluation, solution.history) == (None, None, ())

    def test_parameters_that_no_drive_tells_apart(self):
        problem = problem_of(
            duration=4,
            samples=20,
            spline=Spline(degree=0, coefficients=1),
            rest_to_rest=False,
            measurement=Displacements(segments=2, regressor="heading"),
            limits=(SPEED,),
        )
        solution = solve(problem, TINY, seed=0, workers=1)
        assert solution.status is Status.SINGULAR
        assert solution.trajectory is None


class TestSeed:
    @pytest.mark.slow
    def test_the_same_seed_gives_the_same_design(self):
        first, again, other = (solve(PROBLEM, TINY, seed=seed, workers=1) for seed in (3, 3, 4))
        np.testing.assert_array_equal(first.trajectory.coefficients, again.trajectory.coefficients)
        assert [point.objective for point in first.history] == [point.objective for point in again.history]
        assert np.abs(first.trajectory.coefficients - other.trajectory.coefficients).max() > 1e-3
        assert (first.seed, other.seed) == (3, 4)

    def test_workers_make_no_difference(self, genetic: Solution):
        double = solve(PROBLEM, TINY, seed=0, workers=2)
        np.testing.assert_array_equal(double.trajectory.coefficients, genetic.trajectory.coefficients)

    def test_numpys_own_random_state_is_left_alone(self):
        np.random.seed(1)  # noqa: NPY002
        before = np.random.get_state()[1].copy()  # noqa: NPY002
        solve(PROBLEM, TINY, seed=0, workers=1)
        np.testing.assert_array_equal(np.random.get_state()[1], before)  # noqa: NPY002


def polish(problem: Problem, earlier: Solution) -> Solution:
    solver = Ipopt(starts=1, perturbations=0, second_stage="none", start_from=earlier.name)
    return solve(problem, solver, seed=0, workers=1, earlier={earlier.name: earlier})


@pytest.fixture(scope="module")
def polished(genetic: Solution) -> Solution:
    return polish(PROBLEM, genetic)


class TestPolish:
    """Ipopt from the genetic search's design: at least as good, with one start and nothing else."""

    @pytest.mark.slow
    def test_it_ends_at_least_as_good(self, genetic: Solution, polished: Solution):
        assert polished.evaluation.feasible
        assert polished.evaluation.objective >= genetic.evaluation.objective * (1 - 1e-9)
        assert polished.evaluation.objective >= 0.999 * upper_bound(4)
        assert len(polished.starts) == 1

    @pytest.mark.slow
    def test_it_starts_there(self, genetic: Solution, polished: Solution):
        # The unknowns of the design are those it was found with; one iteration does not lead far away.
        design = DesignExpressions(PROBLEM)
        again = design.trajectory(design.unknowns_of(genetic.trajectory))
        np.testing.assert_allclose(again.coefficients, genetic.trajectory.coefficients, atol=1e-12)
        free = solve(PROBLEM, Ipopt(starts=1, perturbations=0, second_stage="none"), seed=0, workers=1)
        assert np.abs(polished.trajectory.coefficients - free.trajectory.coefficients).max() > 1e-3

    @pytest.mark.slow
    def test_with_a_free_start(self):
        problem = problem_of(samples=12, coefficients=6, start="free")
        earlier = solve(problem, TINY, seed=0, workers=1)
        again = polish(problem, earlier)
        assert again.evaluation.objective >= earlier.evaluation.objective * (1 - 1e-9)

    @pytest.mark.slow
    def test_an_unknown_search(self, genetic: Solution):
        options = Ipopt(starts=1, start_from="nobody")
        with pytest.raises(ProblemError, match=r"earlier search \(genetic\), got 'nobody'"):
            solve(PROBLEM, options, workers=1, earlier={"genetic": genetic})

    def test_a_search_without_a_design(self):
        nothing = Solution("genetic", "genetic", None, None, Status.FAILED)
        options = Ipopt(starts=1, start_from="genetic")
        with pytest.raises(Failure, match="genetic found no design to start from"):
            solve(PROBLEM, options, workers=1, earlier={"genetic": nothing})


@pytest.mark.slow
def test_a_drive_of_many_samples_is_searched_on_fewer():
    space = DesignSpace(duration=6, samples=720, spline=Spline(coefficients=7))
    problem = problem_of(design=space)
    found = solve(problem, Genetic(population=20, generations=5), seed=0, workers=1)
    assert found.trajectory.samples == 720
    assert found.evaluation.feasible
    assert found.evaluation.objective == evaluate(problem, found.trajectory).objective


@pytest.mark.slow
@pytest.mark.skipif(compiler() is None, reason="no C compiler on this machine")
def test_generated_c_changes_no_design(monkeypatch, tmp_path):
    options = Genetic(population=20, generations=4)
    plain = solve(PROBLEM, options, seed=1, workers=1)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    # However little it spares.
    monkeypatch.setattr("oed.kernel.dynamics.direct_call.PAYS", 0.0)
    quick = solve(PROBLEM, options, seed=1, workers=1)
    assert list((tmp_path / "oed").iterdir())
    np.testing.assert_array_equal(quick.trajectory.coefficients, plain.trajectory.coefficients)
    assert quick.evaluation.objective == plain.evaluation.objective


def test_threads_change_no_score():
    design = DesignExpressions(PROBLEM, 2)
    drives = np.random.default_rng(0).uniform(-0.3, 0.3, (7, design.terms.size))
    for alone, shared in zip(design.score_many(drives), design.score_many(drives, 3), strict=True):
        assert np.array_equal(alone, shared)
