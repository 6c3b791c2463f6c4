"""A search from a baseline that is better than all that the study's searches have found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from oed.foundation.text import words
from oed.foundation.work.progress import Once
from oed.kernel.dynamics.space import Space, Spline
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.evaluation import evaluate
from oed.kernel.solution import Solution, Status
from oed.optimize import Ipopt, solve
from oed.optimize.lifted import lifted
from oed.study.study import Study
from oed.workflow.studies import Work

MOST = 500
"""Coefficients of all inputs and runs that are searched at most.

402 take 32 s, of a robust study 6 minutes; 802 take more than 6 minutes in any case.
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
    # Of a feasible drive readers have heard.
    listener = Once(work.progress)
    listener.said = True
    found = solve(
        replace(problem, design=finer),
        options,
        seed=work.seed,
        workers=work.workers,
        progress=listener,
        earlier={best.name: near},
    )
    return _if_better(found, best, work), found.status is Status.INTERRUPTED


def options_from(study: Study, best: Solution | None) -> Ipopt | None:
    """The search that begins with the best drive; None where that is no baseline, where no search by Ipopt is
    for the study's own criterion and drift, or where inputs are held, or readings or the duration chosen.

    Args:
        study: with its searches.
        best: drive of it.
    """
    problem = study.problem
    alike = (one for one in study.solvers if one.criterion is None and not one.without_drift)
    options = next((one for one in alike if isinstance(one, Ipopt)), None)
    if options is None or best is None or best.kind != "baseline":
        return None
    if problem.selection is not None or lifted(problem) is not None or problem.design.own_spline.degree == 0:
        return None
    name = f"{options.label}_from_{best.name}"
    return options.again().model_copy(update={"name": name, "start_from": best.name, "second_stage": "none"})


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
        f"A baseline is the best drive. A search that begins with it was left out: its splines would have "
        f"{count} coefficients, more than {MOST}. With fewer samples there is one."
    ]


def _finer(study: Study) -> Space:
    space = study.problem.design
    return space.with_spline(Spline(degree=1, coefficients=2 * space.samples + 1))


def _if_better(found: Solution, best: Solution, work: Work) -> list[Solution]:
    if found.trajectory is None:
        return []
    assert best.evaluation is not None
    problem = work.study.problem
    evaluation = evaluate(problem, found.trajectory)
    if not evaluation.feasible or evaluation.objective <= best.evaluation.objective:
        return []
    said = (
        f"Begun from the baseline {words(best.name)}, which was better than what searches found on the "
        "study's splines; this drive is on splines of degree 1 with two knots a sample."
    )
    detail = f"{found.detail} {said}".strip()
    return [replace(found, evaluation=evaluation, detail=detail, problem=problem)]


def _on_knots(trajectory: Trajectory, space: Space) -> Trajectory:
    # As a spline of degree 1 is: its coefficients are its values at the knots.
    knots = [np.linspace(0.0, one.duration, space.own_spline.count) for one in trajectory.each]
    table = np.concatenate([one.inputs_at(times) for one, times in zip(trajectory.each, knots, strict=True)])
    return space.trajectory(table, trajectory.starts)
