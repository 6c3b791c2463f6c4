"""`coefficients: auto`: every level begins with the design of the one before, and none is worse."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from builders import problem_of

from oed.kernel.criteria import D
from oed.kernel.dynamics.space import Spline
from oed.kernel.evaluation import evaluate
from oed.kernel.problem import Problem
from oed.kernel.solution import Solution, Status
from oed.optimize import Genetic, Ipopt, solve
from oed.optimize.refinement import ENOUGH, finer_splines, on_spline, plan, search_with_refinement
from oed.optimize.solver import Context, earlier_design
from oed.optimize.transcription.design import DesignExpressions
from oed.robots.sensors import Displacements
from oed.uncertainty.robust import Robust

QUICK = Ipopt(starts=1, perturbations=0, second_stage="none")
HEADINGS = Displacements(segments=4, regressor="heading")


def problem(**parts) -> Problem:
    spline = Spline(degree=parts.pop("degree", 3), coefficients="auto")
    return problem_of(**{"duration": 4, "samples": 32, "measurement": HEADINGS, "spline": spline, **parts})


@pytest.fixture(scope="module")
def found() -> Solution:
    return solve(problem(), QUICK, seed=0, workers=1)


@pytest.fixture(scope="module")
def alone() -> Solution:
    """The search on the first spline, no finer."""
    return solve(on_spline(problem(), Spline(coefficients=16)), QUICK, seed=0, workers=1)


def test_levels_double_the_pieces_until_there_is_a_coefficient_for_every_sample():
    counts = [one.count for one in finer_splines(problem())]
    assert counts == [29, 55]
    assert [one.count - 3 for one in finer_splines(problem(samples=200))] == [26, 52, 104, 208]
    assert [one.count for one in finer_splines(problem(samples=16))] == []


@pytest.mark.parametrize("degree", [0, 1, 3])
@pytest.mark.parametrize("runs", [1, 2])
def test_a_finer_spline_begins_exactly_where_the_coarser_one_ended(degree, runs):
    coarse = problem(degree=degree, runs=runs, rest_to_rest=degree > 0)
    fine = on_spline(coarse, next(finer_splines(coarse)))
    table = np.random.default_rng(1).uniform(-2, 2, (coarse.design.all_coefficients, 2))
    if degree:
        table[[0, 15] if runs == 1 else [0, 15, 16, 31]] = 0.0
    drive = coarse.design.trajectory(table, np.zeros((runs, 3)))
    design = DesignExpressions(fine)
    same = design.trajectory(design.unknowns_of(drive))
    assert same.knots.shape == fine.design.knots.shape
    np.testing.assert_allclose(same.inputs, drive.inputs, rtol=0, atol=1e-12)
    was, now = evaluate(coarse, drive), evaluate(fine, same)
    assert now.objective == pytest.approx(was.objective, rel=1e-9)
    for before, after in zip(was.margins, now.margins, strict=True):
        assert after.violation <= before.violation + 1e-9


@pytest.mark.slow
def test_every_level_is_at_least_as_good_and_keeps_the_limits(found):
    assert len(found.levels) > 1
    for before, after in pairwise(found.levels):
        assert after.objective >= before.objective * (1 - 1e-9)
        assert after.coefficients == 2 * before.coefficients - 3
    for level in found.levels:
        scored = evaluate(problem(), level.trajectory)
        assert scored.feasible
        assert scored.objective == level.objective
    assert found.evaluation.objective == found.levels[-1].objective
    assert len(found.trajectory.coefficients) == found.levels[-1].coefficients
    assert len(found.starts) == QUICK.starts


@pytest.mark.slow
def test_the_first_level_is_the_search_on_its_spline(found, alone):
    assert alone.evaluation.objective == found.levels[0].objective
    assert not alone.levels


@pytest.mark.slow
def test_it_ends_where_a_doubling_gains_too_little(found):
    *gains, last = [after.objective / before.objective - 1 for before, after in pairwise(found.levels)]
    assert all(gain >= ENOUGH for gain in gains)
    assert last < ENOUGH or found.levels[-1].coefficients >= 32
    assert f"{found.levels[-1].coefficients} coefficients" in found.detail


def test_history_goes_on_from_level_to_level(found):
    for before, after in pairwise(found.history):
        assert after.objective > before.objective
        assert after.seconds >= before.seconds
        assert after.evaluations >= before.evaluations
    assert found.history[-1].objective == pytest.approx(found.evaluation.objective)
    assert found.history[-1].seconds <= found.wall_seconds


@pytest.mark.slow
def test_the_same_for_any_number_of_workers():
    options, short = QUICK.model_copy(update={"max_iterations": 5}), problem(samples=20)
    one, two = (solve(short, options, seed=0, workers=workers) for workers in (1, 2))
    assert len(one.levels) > 1
    np.testing.assert_array_equal(one.trajectory.coefficients, two.trajectory.coefficients)


@pytest.mark.slow
def test_a_search_that_starts_from_a_refined_one_takes_its_design_on_the_same_spline(found):
    # Few iterations: those from a start of its own would end below.
    own = {"start_from": "ipopt", "name": "second", "max_iterations": 3}
    options = QUICK.model_copy(update=own)
    again = solve(problem(), options, seed=5, workers=1, earlier={"ipopt": found})
    assert again.levels[0].objective >= found.levels[0].objective * (1 - 1e-6)


@pytest.mark.slow
def test_another_search_starts_from_the_design_or_the_finest_of_those_before_it_that_it_can_drive(found):
    """By what a search comes to, a coarser start is not told from a finer one."""
    assert len(found.levels) > 1
    for level in found.levels:
        own = DesignExpressions(on_spline(problem(), Spline(coefficients=level.coefficients)))
        start = earlier_design({"ipopt": found}, "ipopt", own)
        np.testing.assert_array_equal(start, own.unknowns_of(level.trajectory))
    # As if the finest had come to less.
    first = replace(found, trajectory=found.levels[0].trajectory)
    start = earlier_design({"ipopt": first}, "ipopt", own)
    np.testing.assert_array_equal(start, own.unknowns_of(first.trajectory))


@pytest.mark.slow
def test_a_fixed_finer_spline_starts_from_a_coarser_design(alone):
    fine = on_spline(problem(), Spline(coefficients=29))
    options = Ipopt(starts=1, perturbations=0, second_stage="none", start_from="ipopt", name="second")
    found = solve(fine, options, seed=0, workers=1, earlier={"ipopt": alone})
    assert found.evaluation.objective >= alone.evaluation.objective
    with pytest.raises(ValueError, match="expected knots that have all those of the curves"):
        solve(on_spline(problem(), Spline(coefficients=20)), options, workers=1, earlier={"ipopt": alone})


@pytest.mark.slow
def test_by_another_criterion_levels_are_in_its_numbers():
    options = QUICK.model_copy(update={"criterion": D(scaling="none")})
    short = problem(samples=20)
    found = solve(short, options, seed=0, workers=1)
    own = replace(short, criterion=D(scaling="none"))
    assert len(found.levels) > 1
    assert found.levels[-1].objective == evaluate(own, found.trajectory).objective
    assert found.evaluation.objective == evaluate(short, found.trajectory).objective


def test_populations_stay_on_the_first_spline_and_say_so():
    options = Genetic(population=20, generations=2)
    found = solve(problem(samples=40), options, seed=0, workers=1)
    assert len(found.trajectory.coefficients) == 16
    assert "genetic searches on the first spline only" in found.detail
    assert plan(problem(), [QUICK, options]).endswith("genetic on 16 only")


def test_what_auto_means_is_said():
    assert plan(problem(), [QUICK]) == "16 coefficients, then 29, 55 as long as that gains 0.5 %"
    assert plan(on_spline(problem(), Spline()), [QUICK]) == ""


def test_a_search_out_of_time_keeps_the_levels_that_it_has():
    options = QUICK.model_copy(update={"time_limit": 1e-9})
    found = solve(problem(), options, seed=0, workers=1)
    assert found.status is Status.TIME_LIMIT
    assert len(found.levels) <= 1


def after_first(found: Solution, other: Solution) -> Solution:
    # What is made of a search whose further solves end so.
    answers = iter([replace(found, trajectory=found.levels[0].trajectory, levels=()), other])
    return search_with_refinement(QUICK, problem(), Context(workers=1), lambda *_: next(answers))


def test_a_search_that_ends_while_it_refines_keeps_the_levels_before(found):
    for status in (Status.TIME_LIMIT, Status.INTERRUPTED):
        made = after_first(found, replace(found, trajectory=None, evaluation=None, status=status))
        assert made.status is status
        assert [one.coefficients for one in made.levels] == [16]
        assert made.evaluation.objective == found.levels[0].objective


@pytest.mark.slow
def test_a_search_that_was_interrupted_on_the_first_spline_goes_on_no_finer(found, alone):
    def first_only(options, problem, context):
        assert problem.design.spline.count == found.levels[0].coefficients
        return replace(alone, status=Status.INTERRUPTED)

    assert found.problem.design.spline.first == alone.problem.design.spline
    ended = search_with_refinement(QUICK, found.problem, Context(0), first_only)
    assert ended.status is Status.INTERRUPTED
    assert [one.coefficients for one in ended.levels] == [found.levels[0].coefficients]
    assert ended.detail.endswith("were searched; the search ended before it was refined.")


def test_a_level_that_is_worse_is_not_taken(found):
    worse = on_spline(problem(), Spline(coefficients=29)).design.trajectory(np.zeros((29, 2)), np.zeros(3))
    made = after_first(found, replace(found, trajectory=worse))
    assert made.evaluation.objective == found.levels[0].objective
    assert len(made.trajectory.coefficients) == 16
    assert [one.coefficients for one in made.levels] == [16, 29]


@pytest.mark.slow
def test_a_robust_design_is_refined_and_still_keeps_its_limits():
    uncertain = {"within": {"wheel_radius_right": "5 %"}, "robust": Robust(confidence=0.95, draws=200)}
    robust = problem(duration=6, samples=20, **uncertain)
    found = solve(robust, QUICK, seed=0, workers=1)
    assert found.status.usable
    assert len(found.levels) > 1
    assert found.violation.surely_below(0.05)
    for before, after in pairwise(found.levels):
        assert after.objective >= before.objective * (1 - 1e-3)


@pytest.mark.slow
def test_a_finer_level_begins_with_limits_as_tight_as_they_had_to_be(found):
    asked = problem(within={"wheel_radius_right": "5 %"}, robust=Robust(confidence=0.95, draws=200))
    tighter, given = asked.robust.tighter(np.zeros((1, 2))), []

    def search(options, problem, context):
        given.append(problem.robust)
        return replace(found, trajectory=found.levels[0].trajectory, robust=tighter, levels=())

    search_with_refinement(QUICK, asked, Context(workers=1), search)
    assert given == [asked.robust, tighter]


SORTS = {
    "runs": {"runs": 2, "start": "free"},
    "polygons": {"degree": 1},
    "steps": {"degree": 0, "rest_to_rest": False},
    "midpoint": {"integration": "midpoint"},
}


@pytest.mark.parametrize(
    ("sort", "starts"), [("runs", 1), ("polygons", 1), ("steps", 1), ("midpoint", "auto")]
)
@pytest.mark.slow
def test_drives_of_every_sort_are_refined(sort, starts):
    made = problem(samples=20, **SORTS[sort])
    own = {"iterations": 3} if starts == "auto" else {"perturbations": 0}
    if sort != "steps":
        own["second_stage"] = "none"
    options = Ipopt(starts=starts, **own)
    found = solve(made, options, seed=1, workers=1)
    assert found.status.usable
    assert len(found.levels) > 1
    assert evaluate(made, found.trajectory).feasible
    # The second stage may give up a little on every level.
    assert found.evaluation.objective >= found.levels[0].objective * (1 - 1e-9)
