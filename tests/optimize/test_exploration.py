"""`starts: auto`: varied starts, perturbed designs, and a budget of iterations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import chain, count, islice, repeat

import numpy as np
import pytest
import yaml
from builders import ACCELERATION, problem_of
from studies import small

from oed.foundation.arrays import Array
from oed.foundation.errors import StudyError
from oed.kernel.dynamics.space import Spline
from oed.kernel.evaluation import evaluate
from oed.kernel.solution import Status
from oed.optimize import Genetic, Ipopt, solve
from oed.optimize.exploration import (
    AGAIN,
    HOPELESS,
    LEAST,
    ROUND,
    SHARE,
    Attempt,
    Exploration,
)
from oed.optimize.ipopt_options import BUDGET, with_shared_budget
from oed.optimize.local import LocalSearch
from oed.optimize.results import LocalResult
from oed.optimize.search import IpoptSearch, TimeUp
from oed.optimize.transcription.design import DesignExpressions
from oed.optimize.transcription.perturbations import varied_design
from oed.optimize.transcription.starting_points import Screening, screen, varied_starts
from oed.robots.limits import Rectangle, WheelSpeed
from oed.robots.space import DesignSpace
from oed.workflow.studies import parse_study

SPACE = DesignSpace(duration=6, samples=24, spline=Spline(coefficients=7), rest_to_rest=False)


def sketch(unknowns: Array, value: float, iterations: int) -> LocalResult:
    return LocalResult(unknowns, iterations, 0.0, Status.ACCEPTABLE, sketched=value)


def run(exploration: Exploration, solve: Callable[[Sequence[Attempt]], list[LocalResult]]) -> None:
    """Explore until done, `solve` making the solves of a round."""
    while not exploration.done:
        attempts = exploration.next_round()
        for attempt, result in zip(attempts, solve(attempts), strict=True):
            exploration.take(attempt, result)


@pytest.fixture(scope="module")
def design() -> DesignExpressions:
    return DesignExpressions(problem_of(design=SPACE, limits=(WheelSpeed(bounds=(2, 8)), ACCELERATION)))


def exploration(design: DesignExpressions, budget: int = 10**6) -> Exploration:
    screened = screen(design, np.random.default_rng(0))
    fresh = varied_starts(design, screened, np.random.default_rng(1))
    return Exploration(design, fresh, np.random.default_rng(2), budget)


@pytest.mark.slow
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


def test_varied_starts_begin_within_the_room():
    room = Rectangle(x=(-0.3, 0.3), y=(0.1, 0.4))
    limits = (room, WheelSpeed(bounds=(2, 8)), ACCELERATION)
    problem = problem_of(design=SPACE.model_copy(update={"start": "free"}), limits=limits)
    design = DesignExpressions(problem)
    screened = screen(design, np.random.default_rng(0))
    starts = list(islice(varied_starts(design, screened, np.random.default_rng(1)), 12))
    places = np.array([design.trajectory(start).starts[0, :2] for start in starts])
    assert np.all((np.array([-0.3, 0.1]) <= places) & (places <= np.array([0.3, 0.4])))
    assert len(np.unique(places, axis=0)) == len(starts)


def test_every_fourth_varied_start_is_the_best_of_those_left(design):
    drawn = screen(design, np.random.default_rng(0))
    # All alike in how they keep the limits: the criterion alone says which are best.
    screened = Screening(drawn.candidates, drawn.values, np.zeros_like(drawn.violations))
    ranked = list(screened.candidates[np.argsort(-screened.values, kind="stable")])
    starts = list(islice(varied_starts(design, screened, np.random.default_rng(1)), 12))
    taken = set[bytes]()
    for place, start in enumerate(starts):
        if place % 4 == 0:
            best = next(one for one in ranked if one.tobytes() not in taken)
            np.testing.assert_array_equal(start, best)
        taken.add(start.tobytes())


def test_perturbations_are_of_all_sizes(design):
    rng, base = np.random.default_rng(0), screen(design, np.random.default_rng(0)).candidates[0]
    sizes = [np.linalg.norm(varied_design(design, base, rng) - base) for _ in range(200)]
    assert np.quantile(sizes, 0.9) > 4 * np.quantile(sizes, 0.1)


def test_a_drive_whose_time_is_warped_begins_and_ends_as_it_did(design):
    low, high = design.coefficient_bounds.T
    half = len(low) // 2
    # Both inputs rise all the time: they still do where nothing but their time has changed.
    rising = np.concatenate([np.linspace(0.1, 0.9, half)] * 2) * (high - low) + low
    rng, before = np.random.default_rng(0), rising.reshape(2, half)
    drawn = [varied_design(design, rising, rng).reshape(2, half) for _ in range(200)]
    warped = [one for one in drawn if np.all(np.diff(one) >= 0) and np.array_equal(one[:, 0], before[:, 0])]
    assert len(warped) > 20
    # Some of those that are drawn anew may have risen by chance.
    kept = [np.array_equal(one[:, -1], before[:, -1]) for one in warped]
    assert np.mean(kept) > 0.9
    # Both inputs alike as often as each apart, up to three standard deviations of such a share.
    alike = [np.array_equal(*one) for one in warped]
    assert np.mean(alike) == pytest.approx(0.5, abs=1.5 / np.sqrt(len(alike)))


def test_after_the_first_round_one_start_of_a_round_is_fresh(design):
    found, rounds = exploration(design, budget=60), []
    rising = count()

    def solved(attempts):
        rounds.append([one.perturbed for one in attempts])
        return [sketch(one.unknowns, next(rising), 50) for one in attempts]

    run(found, solved)
    fresh = [not any(one) for one in rounds]
    assert len(rounds) > 1
    assert fresh == [place < 1 for place in range(len(rounds))]
    assert all(one == [True] * (ROUND - 1) + [False] for one in rounds[1:])


def test_it_ends_when_the_best_is_found_again_and_again(design):
    found, values = exploration(design, budget=700), iter([1.0, 2.0] * 4 + [3.0] + [1.0, 3.0] * 100)
    run(found, lambda attempts: [sketch(one.unknowns, next(values), 50) for one in attempts])
    # Up to a round.
    assert 9 + 2 * AGAIN <= found.solves < 9 + 2 * AGAIN + ROUND


def test_a_best_found_late_is_looked_for_half_as_long_again(design):
    found, values = exploration(design, budget=700), chain(np.linspace(2.0, 1.0, 60), repeat(3.0))
    run(found, lambda attempts: [sketch(one.unknowns, next(values), 50) for one in attempts])
    # First found by solve 61, and again ever since: more often than `again` says before that is enough.
    assert 61 + AGAIN + ROUND < 61 * 3 / 2 <= found.solves < 61 * 3 / 2 + ROUND


def test_where_solves_are_cheap_it_goes_on_for_more_of_them(design):
    found = exploration(design, budget=150)
    run(found, lambda attempts: [sketch(one.unknowns, 1.0, 10) for one in attempts])
    assert LEAST <= found.iterations < LEAST + ROUND * 10 < 150 / (24 / 200)
    large = exploration(design, budget=BUDGET)
    run(large, lambda attempts: [sketch(one.unknowns, 1.0, 10) for one in attempts])
    assert SHARE * BUDGET <= large.spent < SHARE * BUDGET + 10


def test_it_ends_where_no_drive_keeps_the_limits(design):
    found = exploration(design)
    run(found, lambda attempts: [sketch(one.unknowns, -np.inf, 1) for one in attempts])
    assert found.solves == HOPELESS
    assert found.worth_finishing == []


@pytest.mark.slow
def test_on_coarse_grids_limits_hold_at_all_samples_at_once():
    room = Rectangle(x=(-0.3, 0.3), y=(-0.3, 0.3))
    space = SPACE.model_copy(update={"samples": 72})
    problem = problem_of(design=space, limits=(room, WheelSpeed(bounds=(2, 8)), ACCELERATION))
    search = LocalSearch(problem, Ipopt(max_iterations=500, search_samples=24))
    drawn = screen(search.design, np.random.default_rng(0))
    starts = islice(varied_starts(search.design, drawn, np.random.default_rng(1)), 2)
    sketches = [search.sketch(one, 1e-3) for one in starts]
    kept = [one.unknowns for one in sketches if np.isfinite(one.objective)]
    assert kept
    for unknowns in kept:
        path = evaluate(search.design.problem, search.design.trajectory(unknowns)).states[:, :2]
        assert len(path) == 24 + 1
        # As far as limits allow, and no farther.
        assert np.abs(path).max() == pytest.approx(0.3, abs=1e-6)


def end_after(monkeypatch: pytest.MonkeyPatch, checks: int) -> None:
    """Let the time be up after so many checks of it."""
    left = iter(range(checks))

    def check(_: IpoptSearch) -> None:
        if next(left, None) is None:
            raise TimeUp

    monkeypatch.setattr(IpoptSearch, "_check_time", check)


@pytest.mark.usefixtures("few_screened")
@pytest.mark.slow
def test_cut_short_it_hands_back_a_drive_met_on_the_way(monkeypatch):
    end_after(monkeypatch, 3)
    problem = problem_of(design=SPACE, limits=(WheelSpeed(bounds=(2, 8)), ACCELERATION))
    found = solve(problem, Ipopt(starts="auto", second_stage="none"), seed=0, workers=1)
    assert found.status is Status.TIME_LIMIT
    assert found.evaluation is not None
    assert found.evaluation.feasible


@pytest.mark.usefixtures("few_screened")
@pytest.mark.slow
def test_cut_short_in_a_round_it_hands_back_the_best_that_had_ended(monkeypatch):
    ended = []
    end_after(monkeypatch, 2)
    take = Exploration.take
    monkeypatch.setattr(
        Exploration,
        "take",
        lambda self, attempt, one: (ended.append(one.objective), take(self, attempt, one)),
    )
    problem = problem_of(design=SPACE, limits=(WheelSpeed(bounds=(2, 8)), ACCELERATION))
    found = solve(problem, Ipopt(starts="auto", second_stage="none"), seed=0, workers=1)
    assert found.status is Status.TIME_LIMIT
    assert found.explored.solves == len(ended) == 2
    assert found.evaluation.objective == pytest.approx(max(ended), rel=1e-6)


@pytest.mark.usefixtures("few_screened")
@pytest.mark.slow
def test_an_earlier_design_stands_where_exploring_finds_none(monkeypatch):
    # On a coarse grid of its own, that is: there the ends are finished together, of none the first was asked.
    monkeypatch.setattr(Exploration, "worth_finishing", property(lambda _: []))
    space = SPACE.model_copy(update={"samples": 72})
    problem = problem_of(design=space, limits=(WheelSpeed(bounds=(2, 8)), ACCELERATION))
    first = solve(problem, Ipopt(starts=1, perturbations=0, second_stage="none"), seed=0, workers=1)
    solver = Ipopt(starts="auto", iterations=3, second_stage="none", start_from="first")
    found = solve(problem, solver, seed=0, workers=1, earlier={"first": first})
    assert found.evaluation.objective >= first.evaluation.objective * (1 - 1e-6)


def test_equal_optima_are_one_and_the_best_leads(design):
    found = exploration(design)
    for value in (1.0, 3.0, 2.0, 3.0 + 1e-7, 2.0 - 1e-6, -np.inf):
        found.take(Attempt(np.zeros(2), 0.1), sketch(np.zeros(2), value, 1))
    assert [one.objective for one in found.elite] == [3.0 + 1e-7, 2.0, 1.0]


@pytest.mark.slow
def test_the_result_is_the_same_for_any_number_of_workers(monkeypatch):
    monkeypatch.setattr("oed.optimize.search.POOL_SECONDS", 0.0)
    problem = problem_of(design=SPACE, limits=(WheelSpeed(bounds=(2, 8)), ACCELERATION))
    solver = Ipopt(starts="auto", iterations=30, second_stage="none")
    one, two = (solve(problem, solver, seed=3, workers=workers) for workers in (1, 2))
    assert np.array_equal(one.trajectory.coefficients, two.trajectory.coefficients)
    assert one.explored == two.explored
    assert one.explored.budget == 30
    assert one.explored.spent == pytest.approx(one.explored.iterations * 24 / 200)
    assert one.evaluation.objective == evaluate(problem, one.trajectory).objective
    assert "iterations" in one.message


def shared(*solvers):
    return [getattr(one, "iterations", None) for one in with_shared_budget(solvers)]


def test_searches_of_a_study_share_one_budget():
    auto, own, few = Ipopt(starts="auto"), Ipopt(starts="auto", iterations=70), Ipopt(starts=3)
    assert shared(auto) == [BUDGET]
    assert shared(auto, own, few, auto, Genetic()) == [BUDGET // 2, 70, None, BUDGET // 2, None]
    assert shared(few) == [None]
    assert auto.budget == BUDGET


def test_a_study_gives_its_searches_their_shares():
    study = parse_study(
        small(solvers="{kind: ipopt, starts: auto}, {kind: ipopt, name: other, starts: auto}")
    )
    assert [one.iterations for one in study.solvers] == [BUDGET // 2] * 2
    again = parse_study(yaml.safe_dump(study.echo()))
    assert again.solvers == study.solvers


def test_searches_explore_and_give_nothing_away_by_default():
    solver = parse_study(small(solvers="{kind: ipopt, iterations: 500}")).solvers[0]
    assert (solver.starts, solver.iterations, solver.second_stage) == ("auto", 500, "none")


@pytest.mark.parametrize(
    ("options", "key"),
    [
        ("starts: auto, perturbations: 3", "perturbations"),
        ("starts: auto, perturbations: 0", "perturbations"),
        ("starts: 3, iterations: 500", "iterations"),
        ("perturbations: 3", "perturbations"),
    ],
)
def test_keys_of_the_other_kind_of_starts_are_refused(options, key):
    with pytest.raises(StudyError, match=rf"study:\d+: solvers\.0\.{key}: .*starts: auto"):
        parse_study(small(solvers=f"{{kind: ipopt, {options}}}"))
