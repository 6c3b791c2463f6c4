"""Searches by integration steps that are fine enough for the design that they end with."""

from __future__ import annotations

import time
from dataclasses import replace

from oed.foundation.errors import NotFinite
from oed.kernel.evaluation import evaluate
from oed.kernel.problem import Problem
from oed.kernel.solution import Solution, Status
from oed.optimize.lifted import lifted
from oed.optimize.refinement import ENDED, Search
from oed.optimize.solver import Context, Solver

FINEST_SEARCHED = 16
"""Number of times that steps of a search are finer than the study's at most: it takes as much longer."""
NEARLY = 0.1
"""Share by which results may change with finer steps where a search from the design alone will do."""
COARSER = "A search with finer integration steps found no design; this one is of coarser steps."
"""Note on a design whose search could not be taken up again."""


def by_enough_steps(search: Search, options: Solver, problem: Problem, context: Context) -> Solution:
    """Return the design of a search whose steps are made finer until information and limits no longer depend
    on them; the detail of the solution says so where that was necessary.

    Args:
        search: search of a problem, by its own steps.
        options: options of the search.
        problem: problem whose system is integrated numerically.
        context: seed, workers, progress, earlier solutions.
    """
    began, times = time.perf_counter(), 1
    solution = search(options, problem, context)
    while solution.trajectory is not None and solution.status not in ENDED:
        try:
            steps = evaluate(problem.refined(times), solution.trajectory).steps
        except NotFinite as error:
            return replace(solution, evaluation=None, status=Status.UNSCORED, detail=f"{error}.")
        assert steps is not None
        if steps.enough == 1 or times == FINEST_SEARCHED:
            break
        quick = steps.change <= NEARLY
        times = min(times * (2 if quick else steps.enough), FINEST_SEARCHED)
        again = options if lifted(problem) is not None else options.again(quick=quick)
        further = search(again, problem.refined(times), context.with_earlier(solution))
        if further.trajectory is None:
            # The design of coarser steps stays, and is scored by finer ones.
            status = further.status if further.status in ENDED else solution.status
            return replace(solution, status=status, detail=f"{solution.detail} {COARSER}".strip())
        solution = replace(further, wall_seconds=time.perf_counter() - began)
    if times == 1:
        return solution
    finer = f"Searched with integration steps {times} times finer than those of the study."
    return replace(solution, detail=f"{solution.detail} {finer}".strip())
