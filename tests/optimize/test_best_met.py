"""No search returns less than the best feasible drive that it met."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from builders import BOX, SPEED, problem_of, random_drive
from random_problems import random_problem

from oed.foundation.errors import Issue, NotFinite
from oed.kernel.criteria import E
from oed.kernel.evaluation import evaluate
from oed.kernel.problem import Problem
from oed.kernel.solution import Status
from oed.optimize import Genetic, Ipopt, genetic, local, solve
from oed.optimize.local import LocalSearch
from oed.optimize.lower_level import Instants
from oed.optimize.solver import Context
from oed.optimize.transcription.design import DesignExpressions
from oed.optimize.transcription.program import IpoptOutcome
from oed.optimize.transcription.starting_points import starting_points
from oed.robots.sensors import Displacements, Poses

QUICK = Ipopt(starts=2, perturbations=0, second_stage="none")
CUT_SHORT = Ipopt(starts=1, perturbations=0, second_stage="none", max_iterations=30)
SETTINGS = Ipopt(max_iterations=200)

GIVEN_UP = (0, 19)
"""Problems of feasible starts whose searches ended outside between the samples and were given up."""
WORSE = (126,)
"""Problems whose searches, cut short, end with less than they start from."""


def best_start(problem: Problem, count: int) -> float:
    """The best objective of the feasible starts of a search."""
    design = DesignExpressions(problem)
    found = [
        evaluate(problem, design.trajectory(start))
        for start in starting_points(design, count, Context(0).rng(0))
    ]
    return max((one.objective for one in found if one.feasible and not one.singular), default=-np.inf)


@pytest.mark.parametrize(
    "seed", [GIVEN_UP[0], *(pytest.param(seed, marks=pytest.mark.slow) for seed in (*GIVEN_UP[1:], *WORSE))]
)
@pytest.mark.slow
def test_a_search_ends_with_no_less_than_its_best_feasible_start(seed: int):
    problem = random_problem(seed)
    options = CUT_SHORT if seed in WORSE else QUICK
    least = best_start(problem, options.starts)
    assert np.isfinite(least)
    solution = solve(problem, options, seed=0, workers=1)
    assert solution.status.usable
    assert evaluate(problem, solution.trajectory).feasible
    assert solution.evaluation.objective >= least * (1 - 1e-9 * np.sign(least))
    if seed in GIVEN_UP:
        assert solution.status in (Status.CONVERGED, Status.ACCEPTABLE)
        assert solution.evaluation.objective > least
    else:
        assert solution.status is Status.UNIMPROVED
        assert "best feasible one met" in solution.message


@pytest.mark.slow
@pytest.mark.parametrize("seed", [206])
def test_of_many_problems(seed: int):
    problem = random_problem(seed)
    least = best_start(problem, QUICK.starts)
    solution = solve(problem, QUICK, seed=0, workers=1)
    assert solution.evaluation is not None or not np.isfinite(least)
    assert solution.evaluation is None or solution.evaluation.objective >= least - 1e-9 * abs(least)


def small() -> Problem:
    return problem_of(
        duration=5,
        samples=20,
        coefficients=7,
        measurement=Displacements(segments=4),
        limits=(SPEED, BOX),
    )


def ending(points: list[Any]) -> Any:
    """A search whose rounds end at these points, one after the other."""
    left = list(points)

    def exchanged(self: LocalSearch, *_: Any, **__: Any) -> tuple[IpoptOutcome, Instants]:
        point = left.pop(0) if len(left) > 1 else left[0]
        nothing = np.zeros(0)
        gains = np.zeros(len(self.problem.limits))
        found = IpoptOutcome(point, nothing, "Solve_Succeeded", 1, 1, nothing, nothing, 1.0, gains)
        return found, self.exchange.first_instants()

    return exchanged


def drives(problem: Problem) -> tuple[LocalSearch, Any, Any, Any]:
    """A search, a feasible drive, a better one, and one that leaves the room."""
    search = LocalSearch(problem, SETTINGS)
    unknowns = np.random.default_rng(3).uniform(-1, 1, search.design.terms.size)
    poor, good, outside = 0.1 * unknowns, 0.2 * unknowns, np.ones(len(unknowns))
    found = [evaluate(problem, search.grid.trajectory(one)) for one in (poor, good, outside)]
    assert [one.feasible for one in found] == [True, True, False]
    assert 0 < found[0].objective < found[1].objective
    return search, poor, good, outside


@pytest.mark.slow
def test_of_all_rounds_the_best_feasible_end_counts(monkeypatch: pytest.MonkeyPatch):
    problem = small()
    search, poor, good, outside = drives(problem)
    # Rounds go on while the limits are exceeded: the feasible end is met in the middle on a misled grid.
    monkeypatch.setattr(LocalSearch, "solve_exchanging", ending([good, poor, outside]))
    monkeypatch.setattr(LocalSearch, "_is_misled", lambda *_: True)
    found = search.maximise(0.01 * poor)
    np.testing.assert_array_equal(found.unknowns, good)
    assert found.evaluation.feasible
    # What went wrong from there is not said to have converged.
    assert found.status is Status.ACCEPTABLE


@pytest.mark.slow
def test_a_start_that_is_better_than_every_end_is_returned(monkeypatch: pytest.MonkeyPatch):
    search, poor, good, outside = drives(small())
    for end in (poor, outside):
        monkeypatch.setattr(LocalSearch, "solve_exchanging", ending([end]))
        found = search.maximise(good)
        np.testing.assert_array_equal(found.unknowns, good)
        assert found.status is Status.UNIMPROVED
        assert found.evaluation.feasible
    monkeypatch.setattr(LocalSearch, "solve_exchanging", ending([good]))
    assert search.maximise(poor).status is Status.CONVERGED


def test_what_information_squared_takes_for_nothing_counts_too(monkeypatch: pytest.MonkeyPatch):
    problem = small()
    search, *_ = drives(problem)
    rng = np.random.default_rng(5)
    right, bend = rng.uniform(0.1, 0.3, (2, search.design.terms.size // 2))
    # Almost straight: what tells the track is there, but lost where the Jacobian is squared.
    poor, good = (np.concatenate([right, right + amount * bend]) for amount in (1e-8, 1e-7))
    scores = [evaluate(problem, search.grid.trajectory(one)).objective for one in (poor, good)]
    matrices = search.grid.matrices_of(good, search.grid.no_correction)
    assert search.design.objective(matrices) == 0 < scores[0] < scores[1]
    monkeypatch.setattr(LocalSearch, "solve_exchanging", ending([poor]))
    np.testing.assert_array_equal(search.maximise(good).unknowns, good)


@pytest.mark.slow
def test_standing_still_is_no_drive_to_return(monkeypatch: pytest.MonkeyPatch):
    search, _, _, outside = drives(small())
    monkeypatch.setattr(LocalSearch, "solve_exchanging", ending([outside]))
    found = search.maximise(np.zeros(search.design.terms.size))
    assert (found.evaluation, found.status) == (None, Status.FAILED)


@pytest.mark.slow
def test_where_every_search_fails_the_best_screened_drive_is_returned(monkeypatch: pytest.MonkeyPatch):
    problem = small()
    _, _, _, outside = drives(problem)
    monkeypatch.setattr(LocalSearch, "solve_exchanging", ending([outside]))
    # No start is feasible: all are as far outside.
    monkeypatch.setattr("oed.optimize.search.starting_points", lambda *_: [outside] * QUICK.starts)
    solution = solve(problem, QUICK, seed=0, workers=1)
    assert solution.status is Status.UNIMPROVED
    assert solution.evaluation.feasible
    assert not solution.evaluation.singular
    assert [start.status for start in solution.starts] == [Status.FAILED] * 2


@pytest.mark.slow
def test_drives_refused_between_the_samples_make_room_for_others(monkeypatch: pytest.MonkeyPatch):
    """However many of the best candidates leave the limits there."""
    problem, seen = small(), []

    def refusing(problem: Problem, drive: Any) -> Any:
        found = evaluate(problem, drive)
        if len(seen) < 40:
            seen.append(drive)
            margins = tuple(replace(one, margin=-one.size) for one in found.margins)
            return replace(found, margins=margins)
        return found

    monkeypatch.setattr(genetic, "score", refusing)
    options = Genetic(population=60, generations=3)
    solution = solve(problem, options, seed=0, workers=1)
    assert len({drive.coefficients.tobytes() for drive in seen}) == 40
    assert solution.evaluation is not None
    assert solution.evaluation.feasible


def not_finite(*_: Any) -> Any:
    raise NotFinite(Issue(("robot",), "diverged"))


def refusing(drives: list[Any], search: LocalSearch) -> Any:
    """A scorer to whom these drives, and no others, are not finite."""
    known = {search.grid.trajectory(one).coefficients.tobytes() for one in drives}

    def scored(problem: Problem, drive: Any) -> Any:
        return not_finite() if drive.coefficients.tobytes() in known else evaluate(problem, drive)

    return scored


def test_a_feasible_start_of_a_search_that_ends_not_finite_is_returned(monkeypatch: pytest.MonkeyPatch):
    search, poor, _, outside = drives(small())
    monkeypatch.setattr(LocalSearch, "solve_exchanging", ending([outside]))
    monkeypatch.setattr(local, "score", refusing([outside], search))
    found = search.maximise(poor)
    np.testing.assert_array_equal(found.unknowns, poor)
    assert (found.status, found.reason) == (Status.UNIMPROVED, "")
    # Without a start to return it says why it has failed.
    found = search.maximise(2 * outside)
    assert (found.evaluation, found.status) == (None, Status.FAILED)
    assert "diverged" in found.reason


def test_rounds_before_one_that_is_not_finite_count(monkeypatch: pytest.MonkeyPatch):
    search, poor, good, outside = drives(small())
    monkeypatch.setattr(LocalSearch, "_is_misled", lambda *_: True)
    monkeypatch.setattr(local, "score", refusing([outside], search))
    for search_from, stage in (
        (search.maximise, "program"),
        (lambda one: search.second_stage(one, 0.9), "second"),
    ):
        monkeypatch.setattr(LocalSearch, "solve_exchanging", ending([good, outside]))
        found = search_from(poor)
        np.testing.assert_array_equal(found.unknowns, good, err_msg=stage)
        assert (found.status, found.reason) == (Status.ACCEPTABLE, "")


@pytest.mark.slow
def test_a_second_stage_that_is_not_finite_leaves_the_design_found(monkeypatch: pytest.MonkeyPatch):
    problem, settle = small(), LocalSearch.second_stage
    plain = solve(problem, QUICK, seed=0, workers=1)

    def broken(self: LocalSearch, unknowns: Any, share: float) -> Any:
        with monkeypatch.context() as patch:
            patch.setattr(local, "score", not_finite)
            return settle(self, unknowns, share)

    monkeypatch.setattr(LocalSearch, "second_stage", broken)
    solution = solve(problem, QUICK.model_copy(update={"second_stage": "logdet"}), seed=0, workers=1)
    assert solution.status is plain.status
    assert solution.evaluation.objective == plain.evaluation.objective


def test_genetic_candidates_that_are_not_finite_make_room_for_others(monkeypatch: pytest.MonkeyPatch):
    seen: list[Any] = []

    def scored(problem: Problem, drive: Any) -> Any:
        seen.append(drive)
        return not_finite() if len(seen) <= 5 else evaluate(problem, drive)

    monkeypatch.setattr(genetic, "score", scored)
    solution = solve(small(), Genetic(population=60, generations=3), seed=0, workers=1)
    assert len(seen) > 5
    assert solution.evaluation is not None
    assert solution.evaluation.feasible


@pytest.mark.slow
def test_a_start_that_fewer_samples_see_as_worth_less_is_scored():
    problem = problem_of(
        samples=200,
        measurement=Poses(noise={"position": 0.01, "heading": 0.01}),
        criterion=E(scaling="relative"),
    )
    search = LocalSearch(problem, Ipopt(max_iterations=200, search_samples=8))
    assert search.grid.coarse
    start = search.design.unknowns_of(random_drive(problem, 5, 3.0))
    matrices = search.grid.matrices_of(start, search.grid.no_correction)
    seen, worth = search.design.objective(matrices), evaluate(problem, search.grid.trajectory(start))
    assert worth.feasible
    assert seen < 0.995 * worth.objective
    found = search.improvement(start, (seen + worth.objective) / 2)
    assert found is not None
    assert found.objective == worth.objective
    assert search.improvement(start, worth.objective) is None


@pytest.mark.slow
def test_tightening_leaves_something_between_two_bounds():
    problem = problem_of(limits=(SPEED, BOX))
    search = LocalSearch(problem, SETTINGS)
    outcome = search.solve(
        search.program,
        np.full(search.design.terms.size, 0.1),
        search.grid.no_correction,
        backoff=np.array([1.0, 1.0]),
    )
    assert np.isfinite(outcome.unknowns).all()
