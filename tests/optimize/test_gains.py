"""What looser limits would gain, as searches say it: as much as designing again gains."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from builders import ACCELERATION, SPEED, problem_of
from places import PROBLEMS

from oed.foundation.arrays import Array
from oed.kernel.criteria import A, Criterion, D, E
from oed.kernel.evaluation import evaluate
from oed.kernel.limit import Limit
from oed.kernel.problem import Problem
from oed.optimize import Genetic, Ipopt, solve
from oed.optimize.local import LocalSearch
from oed.optimize.solver import Context
from oed.optimize.transcription.starting_points import starting_points
from oed.robots.limits import (
    EndHeading,
    EndPosition,
    PathLength,
    Rectangle,
    WheelAcceleration,
    WheelSpeed,
)
from oed.robots.limits.workspace import workspace_of
from oed.robots.sensors import Poses
from oed.uncertainty.robust import Robust
from oed.workflow.studies import parse_study

pytestmark = pytest.mark.usefixtures("few_screened")

ONE = Ipopt(starts=1, perturbations=0, second_stage="none")
SETTINGS = Ipopt(max_iterations=200, tolerance=1e-9)
POSES = Poses(noise={"position": 0.01, "heading": 0.02})
ROOM = Rectangle(x=(-0.8, 0.8), y=(-0.8, 0.8))
STEP = 1e-3
"""Share of their sizes by which limits are made wider."""
LARGER: dict[str, tuple[Limit, Limit, float]] = {
    "wheel_speed": (SPEED, WheelSpeed(bounds=10 * (1 + STEP)), 10 * STEP),
    "wheel_acceleration": (
        WheelAcceleration(bounds=6),
        WheelAcceleration(bounds=6 * (1 + STEP)),
        6 * STEP,
    ),
    "workspace": (ROOM, Rectangle(x=(-0.8 - STEP, 0.8 + STEP), y=(-0.8 - STEP, 0.8 + STEP)), STEP),
    "path_length": (PathLength(bounds=1.5), PathLength(bounds=1.5 * (1 + STEP)), 1.5 * STEP),
    "end_position": (
        EndPosition(at="start", tolerance=0.1),
        EndPosition(at="start", tolerance=0.1 + STEP),
        STEP,
    ),
    # Rows measure the sine of half of an angle: half as much as the angle, where that is 120 deg.
    "end_heading": (
        EndHeading(at="start", tolerance=np.pi / 1.5),
        EndHeading(at="start", tolerance=np.pi / 1.5 + STEP),
        STEP,
    ),
}
"""Limits by name, each with the same one a little wider, and by how much in its SI unit."""
SEEDS = {"end_heading": 2, "path_length": 1}
"""Of searches whose best drive is held by the limit, where the usual one's is not."""


def limited(limit: Limit, **parts: Any) -> Problem:
    usual = [one for one in (SPEED, ACCELERATION, ROOM) if one.name != limit.name]
    small = {"samples": 8, "coefficients": 6}
    usual_parts = {"measurement": POSES, "criterion": E(), **small}
    return problem_of(limits=(*usual, limit), **{**usual_parts, **parts})


def begun(problem: Problem) -> tuple[LocalSearch, Array]:
    """A search, and where its best start ended."""
    search = LocalSearch(problem, SETTINGS)
    rng = Context(seed=SEEDS.get(problem.limits[-1].name, 0)).rng(0)
    (start,) = starting_points(search.design, 1, rng)
    return search, search.maximise(start).unknowns


def require_gained(problem: Problem, wider: Problem, name: str, step: float, rel: float = 0.02) -> float:
    """That a search says what the best drive near its end gains in a wider problem; returns that share."""
    search, unknowns = begun(problem)
    found, instants = search.solve_exchanging(
        search.program, unknowns, search.grid.correction(unknowns), search.exchange.first_instants()
    )
    gains = search.gains(found)
    assert set(gains) == {one.name for one in problem.limits}
    drive = search.grid.trajectory(found.unknowns)
    other = LocalSearch(wider, SETTINGS)
    begin = other.design.unknowns_of(drive)
    larger, _ = other.solve_exchanging(other.program, begin, other.grid.correction(begin), instants, found)
    before, after = (
        evaluate(problem, one).objective for one in (drive, other.grid.trajectory(larger.unknowns))
    )
    size = sum(len(one.judged) for one in problem.any_estimations)
    more = problem.objective.change(after, before, size)
    assert more == pytest.approx(step * gains[name], rel=rel)
    return more


@pytest.mark.parametrize("name", LARGER)
@pytest.mark.slow
def test_a_gain_is_what_designing_again_gains(name: str):
    limit, larger, step = LARGER[name]
    assert require_gained(limited(limit), limited(larger), name, step) > 1e-6


@pytest.mark.parametrize("criterion", [D(), A()], ids=["D", "A"])
@pytest.mark.slow
def test_gains_are_in_efficiency_whatever_the_criterion(criterion: Criterion):
    wider, step = LARGER["workspace"][1:]
    problems = [limited(one, criterion=criterion) for one in (ROOM, wider)]
    assert require_gained(*problems, "workspace", step) > 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["chance", "scenarios"])
def test_gains_of_robust_drives_are_those_under_tightened_limits(kind: str):
    wider, step = LARGER["workspace"][1:]
    # Gains are of the search alone: no robots are asked whether they keep the drive's limits.
    few = Robust(kind=kind, confidence=0.9, draws=300)
    robust = {"robust": few, "within": {"track": 0.05}}
    problems = [limited(one, **robust) for one in (ROOM, wider)]
    assert require_gained(*problems, "workspace", step) > 1e-4


@pytest.mark.slow
def test_gains_of_a_search_on_fewer_samples_are_those_of_all():
    problem = limited(ROOM, samples=24)
    search, unknowns = begun(problem)
    fewer = LocalSearch(problem, SETTINGS.model_copy(update={"search_samples": 12}))
    assert fewer.grid.coarse
    # Close to where the first search ended.
    both = [
        one.solve_exchanging(
            one.program, unknowns, one.grid.correction(unknowns), one.exchange.first_instants(), barrier=1e-3
        )[0]
        for one in (search, fewer)
    ]
    whole, own = (one.gains(end)["workspace"] for one, end in zip((search, fewer), both, strict=True))
    assert own == pytest.approx(whole, rel=0.05)


@pytest.mark.slow
def test_a_search_says_what_its_first_stage_gained():
    problem = limited(ROOM)
    plain, decided = (
        solve(problem, ONE.model_copy(update={"second_stage": stage}), seed=1, workers=1)
        for stage in ("none", "logdet")
    )
    assert decided.gains == plain.gains
    assert "second_stage" in decided.stages


@pytest.mark.slow
def test_searches_that_cannot_know_say_nothing():
    problem = limited(ROOM)
    assert solve(problem, Genetic(generations=3, population=8), workers=1).gains == {}
    assert solve(problem, ONE.model_copy(update={"criterion": D()}), seed=1, workers=1).gains == {}
    # Cut short, a search has multipliers of no optimum.
    assert solve(problem, ONE.model_copy(update={"max_iterations": 3}), seed=1, workers=1).gains == {}


@pytest.mark.slow
def test_gains_of_a_shipped_study_hold_at_the_step_that_reports_state():
    # A tenth of the samples and few coefficients: in a fraction of the time.
    text = (PROBLEMS / "tricycle.yaml").read_text()
    text = re.sub(r"samples: (\d+)\n", lambda found: f"samples: {int(found[1]) // 10}\n", text)
    text = re.sub(r"coefficients: \d{2,}", "coefficients: 10", text)
    problem = parse_study(text).problem
    # Without drift: under it a centimetre is a large step for a drive of so few coefficients.
    problem = replace(problem, measurement=problem.measurement.steady())
    room = workspace_of(problem.limits)
    (left, right), (low, high) = room.x, room.y
    wider = room.model_copy(update={"x": (left - 0.01, right + 0.01), "y": (low - 0.01, high + 0.01)})
    limits = tuple(wider if one is room else one for one in problem.limits)
    assert require_gained(problem, replace(problem, limits=limits), "workspace", 0.01, rel=0.05) > 1e-3
