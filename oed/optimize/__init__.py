"""Searches for the best drive. A new solver is a file here and a name in `SOLVERS`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from oed.foundation.arguments import WrongKind, require_count, typed
from oed.foundation.errors import ProblemError
from oed.foundation.shown import written
from oed.foundation.work.cluster import Cluster
from oed.foundation.work.parallel import Workers, default_workers
from oed.foundation.work.progress import Progress, Silent
from oed.foundation.work.signals import interrupts_answered
from oed.kernel.cards import limits_text
from oed.kernel.evaluation import evaluate
from oed.kernel.identifiability import require_identifiable
from oed.kernel.problem import Problem
from oed.kernel.solution import Solution, Status, scored
from oed.optimize.assurance import search_with_assurance
from oed.optimize.enough_steps import search_with_enough_steps
from oed.optimize.genetic import Genetic
from oed.optimize.ipopt import Ipopt
from oed.optimize.lifted import lift, lower
from oed.optimize.refinement import ENDED, search_with_refinement
from oed.optimize.selection import with_readings
from oed.optimize.solver import Context, Solver

SOLVERS: tuple[type[Solver], ...] = (Ipopt, Genetic)


@typed
@interrupts_answered()
def solve(
    problem: Problem,
    solver: Solver | str | None = None,
    *,
    seed: int = 0,
    workers: Workers | None = None,
    progress: Progress | None = None,
    earlier: Mapping[str, Solution] | None = None,
) -> Solution:
    """Return the best drive that `solver` (by default `Ipopt()`) finds for `problem`.

    Args:
        problem: problem to be solved.
        solver: a frozen set of options, e.g. `Ipopt(starts=12)`, or the name of one, "ipopt".
        seed: seed of all random numbers; the same seed gives the same design.
        workers: processes, or a cluster; by default one per processor. Does not change the result.
        progress: informed how far the search is.
        earlier: solutions by name, for a solver that starts from one (`Ipopt(start_from=...)`).

    Raises:
        ProblemError: parameters that no drive makes identifiable, which it names; a problem without a drive.
        WrongKind: arguments that are something else.
    """
    require_count("seed", seed)
    options = _solver(solver)
    stream = seed if options.seed is None else options.seed
    context = Context(stream, workers or default_workers(), progress or Silent(), earlier or {})
    searched = options.problem_to_search(problem)
    searched.require_designed()
    require_identifiable(searched)
    integrates = searched.system.integrates
    if integrates:
        solution = search_with_enough_steps(_search, options, searched, context)
    else:
        solution = _search(options, searched, context)
    same = searched is problem
    if same and not integrates:
        return replace(solution, problem=problem)
    # The search had another measure of quality, or other steps; the score is the problem's.
    evaluation = None
    if solution.trajectory is not None and solution.status is not Status.UNSCORED:
        evaluation = evaluate(problem, solution.trajectory)
        if integrates and solution.status not in ENDED and not evaluation.feasible:
            # By its own steps the search had satisfied the limits.
            exceeded = f"With fine integration steps, limits are not satisfied: {limits_text(evaluation)}."
            detail = f"{solution.detail} {exceeded}".strip()
            solution = replace(solution, status=Status.INFEASIBLE, detail=detail)
    solution = replace(solution, evaluation=evaluation, problem=problem)
    if same:
        return solution
    kind = None if options.criterion is None else options.criterion.kind
    return replace(solution, criterion=kind, gains={})


def _search(options: Solver, problem: Problem, context: Context) -> Solution:
    # The trajectory, unless there is only one; then the readings, where they are chosen.
    bare = problem.unselected
    if problem.design.only is not None:
        only = scored(bare, problem.design.only, options.label)
        solution = replace(only, kind=options.kind, seed=context.seed, status=Status.CONVERGED)
    elif (together := lift(problem)) is not None:
        _require_no_start(options)
        solution = lower(bare, search_with_assurance(options, together, context))
    elif bare.design.spline.refines:
        solution = search_with_refinement(options, bare, context, search_with_assurance)
    else:
        solution = search_with_assurance(options, bare, context)
    return solution if problem.selection is None else with_readings(problem, solution)


def _require_no_start(options: Solver) -> None:
    # An earlier design has neither the weights nor the pace that are further inputs of this search.
    if getattr(options, "start_from", None) is not None:
        text = (
            "a search that chooses readings or the duration along with inputs begins with no earlier design"
        )
        raise ProblemError.about(("solvers", "start_from"), f"{text}: leave it out")


def _solver(solver: Solver | str | None) -> Solver:
    if isinstance(solver, str):
        kinds = {kind.model_fields["kind"].default: kind for kind in SOLVERS}
        if solver not in kinds:
            raise WrongKind(f"solver: expected one of {', '.join(kinds)}, got {written(solver)}")
        return kinds[solver](kind=solver)
    return solver or Ipopt()


__all__ = [
    "SOLVERS",
    "Cluster",
    "Context",
    "Genetic",
    "Ipopt",
    "Progress",
    "Silent",
    "Solver",
    "Workers",
    "default_workers",
    "solve",
]
