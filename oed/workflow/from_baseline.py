"""A search from a baseline that is better than all that the study's searches have found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from oed.foundation.text import words
from oed.foundation.work.progress import Once
from oed.kernel.dynamics.space import Space, Spline
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.solution import Solution, Status
from oed.optimize import Ipopt, solve
from oed.optimize.lifted import lift
from oed.study.study import Study
from oed.workflow.studies import Work

MOST = 500
"""Coefficients of all inputs and runs that are searched at most.

402 take 32 s, of a robust study 6 minutes; 802 take more than 6 minutes in any case.
"""

CLOSE = 1e-4
"""Tolerance of Ipopt in such a search, at least.

On so many coefficients the last digits take most iterations, and a robust search tightens its limits after
each solve: it takes 20 s for a tricycle, 107 s with 1e-8.
"""


def searched_from_baseline(work: Work, best: Solution | None) -> tuple[list[Solution], bool]:
    """What a search by Ipopt finds from the best baseline, where that is the best drive of all.

    Baselines turn on the spot between straight lines, which splines of few coefficients cannot: this search
    is for splines of degree 1 with knots at all samples and halfway between, as baselines have them. Nothing
    where it finds no better drive, or where none is begun: see `options_from` and `left_out`.

    Args:
        work: on the study.
        best: drive of the study, baselines included.

    Returns:
        The better drive, if there is one; whether an interrupt ended the search.
    """
    options, problem = options_from(work.study, best), work.study.problem
    if options is None or best is None or best.trajectory is None or left_out(work.study, best):
        return [], False
    finer = _finer(work.study)
    near = replace(best, trajectory=_on_knots(best.trajectory, finer))
    # The first feasible drive has been announced already.
    listener = Once(work.progress)
    listener.said = True
    solution = solve(
        replace(problem, design=finer),
        options,
        seed=work.seed,
        workers=work.workers,
        progress=listener,
        earlier={best.name: near},
    )
    return _if_better(solution, best, work), solution.status is Status.INTERRUPTED


def options_from(study: Study, best: Solution | None) -> Ipopt | None:
    """The search that begins with the best drive; None where that is no baseline, where no search by Ipopt is
    for the study's own criterion and drift, or where inputs are held, or readings or the duration chosen.

    Args:
        study: with its searches.
        best: drive of it.
    """
    problem = study.problem
    for_study = (solver for solver in study.solvers if solver.criterion is None and not solver.without_drift)
    options = next((solver for solver in for_study if isinstance(solver, Ipopt)), None)
    if options is None or best is None or best.kind != "baseline":
        return None
    if problem.selection is not None or lift(problem) is not None or problem.design.stored_spline.degree == 0:
        return None
    name, tolerance = f"{options.label}_from_{best.name}", max(options.tolerance, CLOSE)
    changes = {"name": name, "start_from": best.name, "second_stage": "none", "tolerance": tolerance}
    return options.again().model_copy(update=changes)


def left_out(study: Study, best: Solution | None) -> list[str]:
    """A note that no search begins with the best baseline, whose splines would be too fine; [] if one does.

    Args:
        study: with its searches.
        best: drive of it.
    """
    if options_from(study, best) is None:
        return []
    count = _finer(study).all_coefficients * len(study.problem.model.inputs)
    if count <= MOST:
        return []
    return [
        "The best drive is a baseline. No search began with it to improve it: the splines would have "
        f"{count} coefficients, and {MOST} is the most that is searched. Fewer samples allow it."
    ]


def _finer(study: Study) -> Space:
    space = study.problem.design
    return space.with_spline(Spline(degree=1, coefficients=2 * space.samples + 1))


def _if_better(solution: Solution, best: Solution, work: Work) -> list[Solution]:
    # Scored by the finer splines' problem, which has the limits and sensors of the study's.
    evaluation = solution.evaluation
    assert best.evaluation is not None
    if evaluation is None or not evaluation.feasible or evaluation.objective <= best.evaluation.objective:
        return []
    origin = (
        f"Begun from the baseline {words(best.name)}, which was better than what searches found on the "
        "study's splines; this drive is on splines of degree 1 with two knots a sample."
    )
    return [replace(solution, detail=f"{solution.detail} {origin}".strip(), problem=work.study.problem)]


def _on_knots(trajectory: Trajectory, space: Space) -> Trajectory:
    # The coefficients of a spline of degree 1 are its values at the knots.
    count = space.stored_spline.count
    tables = [run.inputs_at(np.linspace(0.0, run.duration, count)) for run in trajectory.each]
    return space.trajectory(np.concatenate(tables), trajectory.starts)
