"""`starts: auto`: varied starts, perturbed designs, and a budget of iterations."""

from __future__ import annotations

from itertools import count, islice

import numpy as np
import pytest
from builders import ACCELERATION, problem_of

from oed.kernel.dynamics.space import Spline
from oed.kernel.evaluation import evaluate
from oed.kernel.solution import Status
from oed.optimize import Ipopt, solve
from oed.optimize.exploration import AGAIN, HOPELESS, ROUND, Attempt, Exploration
from oed.optimize.local_results import Sketch
from oed.optimize.transcription.design import DesignExpressions
from oed.optimize.transcription.perturbations import varied_design
from oed.optimize.transcription.starting_points import screen, varied_starts
from oed.robots.limits import WheelSpeed
from oed.robots.space import DesignSpace

SPACE = DesignSpace(duration=6, samples=24, spline=Spline(coefficients=7), rest_to_rest=False)


@pytest.fixture(scope="module")
def design() -> DesignExpressions:
    return DesignExpressions(problem_of(design=SPACE, limits=(WheelSpeed(bounds=(2, 8)), ACCELERATION)))


def exploration(design: DesignExpressions, budget: int = 10**6) -> Exploration:
    screened = screen(design, np.random.default_rng(0))
    fresh = varied_starts(design, screened, np.random.default_rng(1))
    return Exploration(design, fresh, np.random.default_rng(2), budget)


def test_starts_and_perturbed_designs_keep_to_one_sided_ranges(design):
    screened, rng = screen(design, np.random.default_rng(0)), np.random.default_rng(1)
    low, high = design.coefficient_bounds.T
    for start in islice(varied_starts(design, screened, rng), 250):
        for one in (start, varied_design(design, start, rng)):
            assert np.all((low - 1e-12 <= one) & (one <= high + 1e-12))


def test_varied_starts_are_farther_apart_than_the_best_ones(design):
    screened = screen(design, np.random.default_rng(0))
    starts = list(islice(varied_starts(design, screened, np.random.default_rng(1)), 80))
    varied = [start for place, start in enumerate(starts) if place % 4 in (1, 2)]
    best = screened.candidates[np.argsort(-screened.values)[: len(varied)]]

    def nearest(points):
        apart = np.linalg.norm(points[:, None] - points[None], axis=-1)
        return np.median(np.where(np.eye(len(points)) > 0, np.inf, apart).min(axis=0))

    assert nearest(np.array(varied)) > 1.2 * nearest(best)


def test_perturbations_are_of_all_sizes(design):
    rng, base = np.random.default_rng(0), screen(design, np.random.default_rng(0)).candidates[0]
    sizes = [np.linalg.norm(varied_design(design, base, rng) - base) for _ in range(200)]
    assert np.quantile(sizes, 0.9) > 4 * np.quantile(sizes, 0.1)


def test_the_budget_counts_iterations_by_samples(design):
    found = exploration(design, budget=60)
    rising = count()
    found.run(lambda attempts: [Sketch(one.unknowns, next(rising), 50) for one in attempts])
    # 24 samples of 200: 0.12 of an iteration each, so that 500 of them are the budget, up to a round.
    assert 500 <= found.iterations < 500 + ROUND * 50


def test_it_ends_when_the_best_is_found_again_and_again(design):
    found, values = exploration(design), iter([1.0, 2.0] * 4 + [3.0] + [1.0, 3.0] * 100)
    found.run(lambda attempts: [Sketch(one.unknowns, next(values), 50) for one in attempts])
    # Up to a round.
    assert 9 + 2 * AGAIN <= found.solves < 9 + 2 * AGAIN + ROUND


def test_it_ends_where_no_drive_keeps_the_limits(design):
    found = exploration(design)
    found.run(lambda attempts: [Sketch(one.unknowns, -np.inf, 1) for one in attempts])
    assert found.solves == HOPELESS
    assert found.worth_finishing == []


def test_cut_short_it_hands_back_a_drive_met_on_the_way(monkeypatch):
    asked = iter([False, False, False])
    monkeypatch.setattr("oed.optimize.ipopt._Search._out_of_time", lambda _: next(asked, True))
    problem = problem_of(design=SPACE, limits=(WheelSpeed(bounds=(2, 8)), ACCELERATION))
    found = solve(problem, Ipopt(starts="auto", second_stage="none"), seed=0, workers=1)
    assert found.status is Status.TIME_LIMIT
    assert found.evaluation is not None
    assert found.evaluation.feasible


def test_equal_optima_are_one_and_the_best_leads(design):
    found = exploration(design)
    for value in (1.0, 3.0, 2.0, 3.0 + 1e-7, -np.inf):
        found.take(Attempt(np.zeros(2), 0.1), Sketch(np.zeros(2), value, 1))
    assert [one.value for one in found.elite] == [3.0, 2.0, 1.0]


def test_the_result_is_the_same_for_any_number_of_workers(monkeypatch):
    monkeypatch.setattr("oed.optimize.ipopt.POOL_SECONDS", 0.0)
    problem = problem_of(design=SPACE, limits=(WheelSpeed(bounds=(2, 8)), ACCELERATION))
    solver = Ipopt(starts="auto", iterations=30, second_stage="none")
    one, two = (solve(problem, solver, seed=3, workers=workers) for workers in (1, 2))
    assert np.array_equal(one.trajectory.coefficients, two.trajectory.coefficients)
    assert one.detail == two.detail
    assert one.evaluation.objective == evaluate(problem, one.trajectory).objective
    assert "iterations" in one.message
