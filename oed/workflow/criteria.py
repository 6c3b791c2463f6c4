"""Criteria by which the results of a run are compared, and their values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from oed.kernel.criteria import A, Criterion, D, E
from oed.kernel.evaluation import evaluate
from oed.kernel.solution import Solution
from oed.study.study import Study


def criteria_of(study: Study) -> dict[str, Criterion]:
    """Return E, D and A in the study's scaling, and the criteria that its solvers search by."""
    own = study.problem.criterion
    common = {"scaling": own.scaling, "subset": own.subset}
    judges: dict[str, Criterion] = {kind.__name__: kind(**common) for kind in (E, D, A)}
    judges[own.kind] = own
    for solver in study.solvers:
        if solver.criterion is not None:
            judges.setdefault(solver.criterion.kind, solver.criterion)
    return judges


def scores_by_criteria(
    study: Study, judges: Mapping[str, Criterion], solution: Solution
) -> dict[str, float | None]:
    """Return the values of several criteria at a solution of the nominal system; {} where there is no design.

    Args:
        study: that was solved.
        judges: criteria by name.
        solution: that is judged.
    """
    evaluation, trajectory = solution.evaluation, solution.trajectory
    if evaluation is None or trajectory is None:
        return {}
    values: dict[str, float | None] = {}
    # Of the nominal robot, whichever the objective is of.
    problem = replace(study.problem, robust=None)
    for name, criterion in judges.items():
        own = study.problem.criterion
        same = (criterion.scaling, criterion.subset) == (own.scaling, own.subset)
        # The same information serves every criterion that sees the parameters alike.
        value = (
            float(problem.judging(criterion).judge(list(evaluation.square_roots.values())))
            if same
            else evaluate(replace(problem, criterion=criterion), trajectory).objective
        )
        values[name] = value
    return values
