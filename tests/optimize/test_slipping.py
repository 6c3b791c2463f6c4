"""Walls thinner than a step: searches do not slip through them between the points that they look at."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import RADIUS, problem_of, random_drive

from oed.foundation.arrays import Array
from oed.kernel.criteria import E
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.evaluation import evaluate
from oed.kernel.problem import Problem
from oed.kernel.results import Evaluation
from oed.kernel.scorer import score
from oed.optimize import Genetic, Ipopt, solve
from oed.optimize.genetic import FINEST, MOST_TIGHTENED, Generations, Population, excess_between
from oed.optimize.solver import Context
from oed.optimize.transcription.coarse import SearchGrid
from oed.robots.limits import BodySpeed, EndPosition, Obstacles, Rectangle, WheelSpeed
from oed.robots.sensors import Poses
from oed.uncertainty.robust import Robust

IPOPT = Ipopt(starts=1, perturbations=0, second_stage="none")
GENETIC = Genetic(population=40, generations=15)
POSES = Poses(noise={"position": 0.01, "heading": 0.02})
THIN, THICK = 0.02, 0.4
"""Of walls across the way [m]; steps are up to half a metre long."""
BEHIND_THICK = 13_100
"""More than Ipopt finds behind a thick wall 1 m wide."""


def behind_a_wall(thickness: float, width: float) -> Problem:
    """Ten steps of a second to a place behind a wall, at whose ends there is room."""
    near, far, half = 0.3, 0.3 + thickness, width / 2
    corners = [(near, -half), (far, -half), (far, half), (near, half)]
    return problem_of(
        samples=10,
        coefficients=6,
        measurement=POSES,
        limits=(
            WheelSpeed(bounds=10),
            Rectangle(x=(-0.3, 1.2), y=(-1, 1)),
            EndPosition(x=0.9, y=0, tolerance=0.3),
            Obstacles(shapes=[{"kind": "polygon", "points": corners}]),
        ),
        criterion=E(),
    )


def found_by(solver: Ipopt | Genetic, seed: int, thickness: float, width: float) -> float | None:
    """The objective of a design that all times say is feasible; None where none is found."""
    problem = behind_a_wall(thickness, width)
    solution = solve(problem, solver, seed=seed, workers=1)
    if solution.trajectory is None:
        return None
    evaluation = evaluate(problem, solution.trajectory)
    assert evaluation.feasible
    return evaluation.objective


@pytest.fixture
def at_few_points(monkeypatch: pytest.MonkeyPatch) -> None:
    """Searches never ask for more points than they begin with."""
    monkeypatch.setattr("oed.optimize.genetic.FINEST", 1)
    monkeypatch.setattr("oed.optimize.local.FINEST", 1)
    monkeypatch.setattr("oed.optimize.exchange.FINE", 1)
    monkeypatch.setattr("oed.optimize.exchange.TIMES", 1)
    # Which limits are in each other's way, where nothing is found, takes longer than the search.
    monkeypatch.setattr("oed.optimize.search.describe_conflict", lambda *_: "")


@pytest.mark.slow
def test_ipopt_drives_around():
    assert found_by(IPOPT, 5, THIN, 1.0) >= BEHIND_THICK


@pytest.mark.slow
def test_as_well_as_around_a_thick_wall():
    assert 0 < found_by(IPOPT, 5, THICK, 1.0) < BEHIND_THICK


@pytest.mark.slow
def test_ipopt_at_few_points_finds_nothing_but_slips(at_few_points: None):
    assert found_by(IPOPT, 5, THIN, 1.0) is None


@pytest.mark.slow
def test_genetic_drives_around():
    assert found_by(GENETIC, 6, THIN, 0.6) > 0


@pytest.mark.slow
def test_genetic_at_few_points_finds_nothing_but_slips(at_few_points: None):
    assert found_by(GENETIC, 6, THIN, 0.6) is None


def more_between(problem: Problem, drive: Trajectory) -> Evaluation:
    """A drive's scores, had every wheel turned a little faster between the points."""
    evaluation = score(problem, drive)
    wheels, *others = evaluation.margins
    wheels = replace(wheels, margin=wheels.margin - 0.03 * wheels.size)
    return replace(evaluation, margins=(wheels, *others))


def best_found(monkeypatch: pytest.MonkeyPatch, slipped: float) -> float:
    """By a search whose limits are tightened by at most that share of their size."""
    monkeypatch.setattr("oed.optimize.genetic.MOST_TIGHTENED", slipped)
    monkeypatch.setattr("oed.optimize.genetic.score", more_between)
    problem = problem_of(measurement=POSES, limits=(WheelSpeed(bounds=10),))
    search = Genetic(population=40, generations=100)
    return search.search(problem, Context(seed=0, workers=1)).evaluation.objective


@pytest.mark.slow
def test_limits_that_are_exceeded_a_little_between_the_points_are_tightened(monkeypatch: pytest.MonkeyPatch):
    """Else all that a search goes on from exceeds them there, and it finds no better drive any more."""
    assert best_found(monkeypatch, MOST_TIGHTENED) > 1.1 * best_found(monkeypatch, 0)


def test_drives_through_walls_tighten_no_limit():
    """One that exceeds a limit by more than it may be tightened by leaves the tightening of others alone."""
    problem = problem_of(measurement=POSES, limits=(WheelSpeed(bounds=10), Rectangle(x=(-3, 3), y=(-3, 3))))
    evaluation = score(problem, random_drive(problem, 0))
    wheels, room, *conditions = evaluation.margins
    exceeded = replace(wheels, margin=-0.03 * wheels.size), replace(room, margin=-0.2 * room.size)
    evaluation = replace(evaluation, margins=(*exceeded, *conditions))
    np.testing.assert_allclose(excess_between(evaluation, np.array([-0.01, -0.02])), [0.04, 0])
    np.testing.assert_allclose(excess_between(evaluation, np.array([0.0, 0.15])), [0.03, 0.05])


@pytest.mark.slow
def test_limits_are_tightened_by_as_much_as_slips(monkeypatch: pytest.MonkeyPatch):
    """Candidates and their children are judged by the same limits; those kept between the points stay."""
    tighten, advance, totals = Generations.tighten, Generations.advance, []

    def watched(generations: Generations, tightening: Array) -> None:
        tighten(generations, tightening)
        unknowns, excess = generations._algorithm.pop.get("X", "G")
        np.testing.assert_allclose(excess, generations._scorer.score(unknowns)[1], atol=1e-12)
        totals.append(tightening)

    def advanced(generations: Generations) -> Population:
        candidates = advance(generations)
        # What pymoo selects by is what the candidates exceed.
        violations = generations._algorithm.pop.get("CV")[:, 0]
        np.testing.assert_allclose(violations, np.maximum(candidates.excess, 0).sum(axis=1), atol=1e-12)
        return candidates

    monkeypatch.setattr(Generations, "tighten", watched)
    monkeypatch.setattr(Generations, "advance", advanced)
    monkeypatch.setattr("oed.optimize.genetic.score", more_between)
    problem = problem_of(measurement=POSES, limits=(WheelSpeed(bounds=1), BodySpeed(bounds=RADIUS)))
    Genetic(population=40, generations=40).search(problem, Context(seed=0, workers=1))
    wheels, body = totals[-1]
    assert 0 < wheels <= 0.03 + 1e-9
    assert body == 0


def test_a_search_looks_at_no_more_points_than_the_most(monkeypatch: pytest.MonkeyPatch):
    """Those of a robust problem begin with one a sample."""
    points = []

    def watched(problem: Problem, refine: int) -> SearchGrid:
        points.append(refine)
        return SearchGrid(problem, refine=refine)

    def slipping(problem: Problem, drive: Trajectory) -> Evaluation:
        evaluation = score(problem, drive)
        violated = tuple(replace(margin, margin=-margin.size) for margin in evaluation.margins)
        return replace(evaluation, margins=violated)

    monkeypatch.setattr("oed.optimize.genetic.SearchGrid", watched)
    monkeypatch.setattr("oed.optimize.genetic.score", slipping)
    problem = problem_of(
        samples=8,
        coefficients=6,
        measurement=POSES,
        limits=(WheelSpeed(bounds=10), Rectangle(x=(-3, 3), y=(-3, 3))),
        within={"track": "2 %"},
        robust=Robust(kind="chance"),
    )
    Genetic(population=4, generations=2).search(problem, Context(seed=1, workers=1))
    assert points[0] == 1
    assert points[-1] == FINEST
