"""Local searches: of limits at all times they look at ever more instants, until all are kept."""

from __future__ import annotations

import time

import numpy as np
import pytest
from builders import SPEED, problem_of

from oed.kernel.evaluation import evaluate
from oed.kernel.problem import Problem
from oed.kernel.solution import Solution, Status
from oed.optimize import Ipopt, solve
from oed.optimize.local import LocalSearch
from oed.robots.limits import Rectangle
from oed.robots.sensors import Displacements

pytestmark = pytest.mark.usefixtures("few_screened")

OPTIONS = Ipopt(starts=3, perturbations=0, second_stage="none")


@pytest.fixture(scope="module")
def coarse() -> Problem:
    """Few samples at high speed: the box is easily left and entered again between two of them."""
    return problem_of(
        samples=20,
        coefficients=8,
        measurement=Displacements(segments="samples"),
        limits=(SPEED, Rectangle(x=(-0.3, 0.3), y=(-0.3, 0.3))),
    )


def feasible_starts(solution: Solution) -> int:
    """How many searches ended inside, rather than with the drive they began from."""
    inside = (start for start in solution.starts if start.status is not Status.UNIMPROVED)
    return sum(start.objective is not None for start in inside)


@pytest.mark.slow
def test_instants_between_the_samples_are_added(coarse: Problem):
    solution = solve(coarse, OPTIONS, seed=0, workers=1)
    assert feasible_starts(solution) >= 2
    assert evaluate(coarse, solution.trajectory).feasible


@pytest.mark.slow
def test_a_start_has_what_is_left_of_the_whole_time(coarse: Problem):
    # Not the whole limit once more: that is up after a solve.
    ends, began = [], time.perf_counter()
    for left in (-1.0, 100.0):
        options = Ipopt(max_iterations=200, tolerance=1e-6, time_limit=100.0)
        search = LocalSearch(coarse, options, deadline=time.time() + left)
        ends.append(search.maximise(np.random.default_rng(0).uniform(-0.5, 0.5, search.design.terms.size)))
    cut, whole = ends
    assert 0 <= cut.wall_seconds + whole.wall_seconds <= time.perf_counter() - began
    assert whole.status is Status.CONVERGED
    assert cut.status is not Status.CONVERGED
    assert cut.iterations < whole.iterations


@pytest.mark.slow
def test_of_the_first_instants_alone_hardly_a_search_would_end_inside(coarse: Problem, monkeypatch):
    monkeypatch.setattr("oed.optimize.exchange.EXCHANGES", 1)
    monkeypatch.setattr("oed.optimize.local.ROUNDS", 1)
    assert feasible_starts(solve(coarse, OPTIONS, seed=0, workers=1)) <= 1
