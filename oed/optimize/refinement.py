"""`coefficients: auto`: a search on a coarse spline, then solves from its design on ever finer splines.

Every spline contains all curves of the one before, so that a solve starts exactly at the last design.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial

from oed.foundation.text import listing, significant
from oed.kernel.dynamics.space import Spline
from oed.kernel.problem import Problem
from oed.kernel.scorer import score
from oed.kernel.solution import RefinementLevel, Solution, Status
from oed.optimize.solver import Context, Solver

ENOUGH = 0.005
"""Gain of the last doubling, as a share of the objective, below which a spline is fine enough.

Where gains halve from one doubling to the next, as they mostly do, all further doublings together gain about
as much again; a different kind of design that only a finer spline can represent may still gain more.
"""
ENDED = (Status.INTERRUPTED, Status.TIME_LIMIT)
"""Statuses of a search that must not continue."""
STAGE = "refined_spline"
"""Name of the stage in solutions."""

SearchFunction = Callable[[Solver, Problem, Context], Solution]
"""Function that searches a problem with a fixed spline."""


def plan(problem: Problem, solvers: Sequence[Solver]) -> str:
    """Return a description of `coefficients: auto` for a problem and its searches; "" for a fixed spline.

    Args:
        problem: problem to be solved.
        solvers: searches of the problem.
    """
    spline = problem.design.spline
    if not spline.refines or not problem.designed:
        return ""
    first, *finer = (str(level.count) for level in (spline.first, *finer_splines(problem)))
    text = f"{first} coefficients" + (f", then {', '.join(finer)} as long as that gains {100 * ENOUGH:g} %")
    staying = [solver.label for solver in solvers if not solver.refines]
    return f"{text}; {listing(staying)} on {first} only" if staying else text


def finer_splines(problem: Problem) -> Iterator[Spline]:
    """Yield ever finer splines, up to one with a coefficient per sample, which represents all inputs."""
    spline = problem.design.spline.first
    while spline.count < problem.design.samples:
        spline = spline.finer
        yield spline


def on_spline(problem: Problem, spline: Spline) -> Problem:
    """Return the problem with another spline."""
    return replace(problem, design=problem.design.with_spline(spline))


def search_with_refinement(
    options: Solver, problem: Problem, context: Context, search: SearchFunction
) -> Solution:
    """Return the best design of a problem whose spline is refined, with all levels of refinement.

    Args:
        options: options of the search.
        problem: problem to be solved.
        context: seed, workers, progress, earlier solutions.
        search: function that searches a problem with a fixed spline.
    """
    began, spline = time.perf_counter(), problem.design.spline.first
    best = search(options, on_spline(problem, spline), context)
    if not best.status.usable or best.trajectory is None:
        return best
    best = _score(problem, best)
    levels = [_level(spline, best)]
    finer: Iterator[Spline] = iter(())
    if best.status is Status.INTERRUPTED:
        reason = "the search ended before it was refined"
    elif not options.refines:
        reason = f"{options.kind} searches on the first spline only"
    else:
        finer = finer_splines(problem)
        reason = f"there are as many as the {problem.design.samples} samples of a run"
    for spline in finer:
        # Limits of a robust problem start with the tightening of the coarser spline.
        robust = problem.robust if best.robust is None else best.robust
        further = replace(context.with_earlier(best), refining_since=began)
        solution = search(options, replace(on_spline(problem, spline), robust=robust), further)
        ended = solution.status in ENDED
        if solution.trajectory is None:
            reason = f"no design with {spline.count} coefficients was found"
            best = replace(best, status=solution.status) if ended else best
            break
        solution = _score(problem, solution)
        levels.append(_level(spline, solution))
        gain = _gain(problem, levels[-1], levels[-2])
        best = _join(best, solution) if gain > 0 else replace(best, status=solution.status)
        if gain < ENOUGH or ended:
            reason = ""
            break
    detail = f"{best.detail} {_summary(problem, levels, reason)}".strip()
    seconds = time.perf_counter() - began
    return replace(best, levels=tuple(levels), detail=detail, wall_seconds=seconds)


def _score(problem: Problem, solution: Solution) -> Solution:
    # The score is by the limits of the study, not by tightened ones.
    assert solution.trajectory is not None
    return replace(solution, evaluation=score(problem, solution.trajectory))


def _level(spline: Spline, solution: Solution) -> RefinementLevel:
    assert solution.evaluation is not None
    assert solution.trajectory is not None
    iterations = sum(start.iterations for start in solution.starts)
    return RefinementLevel(spline.count, solution.evaluation.objective, iterations, solution.trajectory)


def _gain(problem: Problem, level: RefinementLevel, before: RefinementLevel) -> float:
    size = sum(len(estimation.judged) for estimation in problem.any_estimations)
    return problem.objective.change(level.objective, before.objective, size)


def _join(before: Solution, solution: Solution) -> Solution:
    # The finer design, with the history of the search before it.
    assert solution.evaluation is not None
    spent = before.history[-1].evaluations if before.history else 0
    reference = before.history[-1].objective if before.history else -float("inf")
    risen = (
        replace(point, evaluations=point.evaluations + spent)
        for point in solution.history
        if point.objective > reference
    )
    return replace(
        solution,
        starts=before.starts,
        stages={**before.stages, STAGE: solution.evaluation.objective},
        history=(*before.history, *risen),
        detail=before.detail,
    )


def _summary(problem: Problem, levels: Sequence[RefinementLevel], reason: str) -> str:
    counts = listing([str(level.coefficients) for level in levels])
    text = f"Splines of {counts} coefficients were searched"
    if len(levels) > 1:
        gain = partial(_gain, problem, levels[-1])
        total, last = (f"{significant(2)(100 * gain(level))} %" for level in (levels[0], levels[-2]))
        text += f": refining gained {total}, the last doubling {last}"
    return f"{text}; {reason}." if reason else f"{text}."
