"""Searches whose integration steps are refined until they are fine enough for the design."""

from __future__ import annotations

import time
from dataclasses import replace

from oed.foundation.errors import NotFinite
from oed.kernel.evaluation import evaluate
from oed.kernel.problem import Problem
from oed.kernel.solution import Solution, Status
from oed.optimize.lifted import lift
from oed.optimize.refinement import ENDED, SearchFunction
from oed.optimize.solver import Context, Solver

FINEST_SEARCHED = 16
"""Largest refinement of the integration steps of a search, whose duration grows by the same factor."""
NEARLY = 0.1
"""Relative change of the results with finer steps up to which a search from the design alone suffices."""
COARSER = "A search with finer integration steps found no design; this one is of coarser steps."
"""Note on a design that a search with finer steps could not improve on."""


def search_with_enough_steps(
    search: SearchFunction, options: Solver, problem: Problem, context: Context
) -> Solution:
    """Return the design of a search with steps so fine that information and limits no longer depend on them.

    The detail of the solution notes any refinement of the steps.

    Args:
        search: function that searches a problem with the steps of its system.
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
        again = options if lift(problem) is not None else options.again(quick=quick)
        further = search(again, problem.refined(times), context.with_earlier(solution))
        if further.trajectory is None:
            # The design of coarser steps remains, and is scored with finer ones.
            status = further.status if further.status in ENDED else solution.status
            return replace(solution, status=status, detail=f"{solution.detail} {COARSER}".strip())
        solution = replace(further, wall_seconds=time.perf_counter() - began)
    if times == 1:
        return solution
    finer = f"Searched with integration steps {times} times finer than those of the study."
    return replace(solution, detail=f"{solution.detail} {finer}".strip())
