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
from oed.workflow.studies import Work

MOST = 500
"""Coefficients of all inputs and runs from which such a search takes too long."""


def searched_from_baseline(work: Work, best: Solution | None) -> list[Solution]:
    """What the first search by Ipopt finds from the best baseline, where that is the best drive of all.

    Baselines turn on the spot between straight lines, which splines of few coefficients cannot: this search
    is for splines of degree 1 with knots at all samples and halfway between, as baselines have them. Nothing
    where it finds no better drive, where no search is by Ipopt, where readings are chosen with the drive, or
    where the splines would have more than `MOST` coefficients.

    Args:
        work: on the study.
        best: drive of the study, baselines included.

    Raises:
        KeyboardInterrupt: the search was interrupted.
    """
    problem, space = work.study.problem, work.study.problem.design
    options = next((one for one in work.study.solvers if isinstance(one, Ipopt)), None)
    if options is None or best is None or best.kind != "baseline" or best.trajectory is None:
        return []
    finer = space.with_spline(Spline(degree=1, coefficients=2 * space.samples + 1))
    chosen = problem.selection is not None or lifted(problem) is not None
    if chosen or space.spline.degree == 0 or finer.all_coefficients * len(problem.model.inputs) > MOST:
        return []
    near = replace(best, trajectory=_on_samples(best.trajectory, finer))
    # Of a feasible drive readers have heard.
    listener = Once(work.progress)
    listener.said = True
    found = solve(
        replace(problem, design=finer),
        options.again().model_copy(
            update={
                "name": f"{options.label}_from_{best.name}",
                "start_from": best.name,
                "second_stage": "none",
            }
        ),
        seed=work.seed,
        workers=work.workers,
        progress=listener,
        earlier={best.name: near},
    )
    if found.status is Status.INTERRUPTED:
        raise KeyboardInterrupt
    return [] if found.trajectory is None else _if_better(found, best, work)


def _if_better(found: Solution, best: Solution, work: Work) -> list[Solution]:
    assert found.trajectory is not None
    assert best.evaluation is not None
    problem = work.study.problem
    evaluation = evaluate(problem, found.trajectory)
    if not evaluation.feasible or evaluation.objective <= best.evaluation.objective:
        return []
    said = (
        f"Begun from the baseline {words(best.name)}, which was better than what searches found on the "
        "study's splines; its own are of degree 1 with two knots a sample."
    )
    detail = f"{found.detail} {said}".strip()
    return [replace(found, evaluation=evaluation, detail=detail, problem=problem)]


def _on_samples(trajectory: Trajectory, space: Space) -> Trajectory:
    runs = [one.inputs_at(np.linspace(0.0, one.duration, space.own_spline.count)) for one in trajectory.each]
    table = np.concatenate(runs)
    return space.trajectory(table, trajectory.starts)
