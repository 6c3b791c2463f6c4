"""Drives that a study compares with: usual ones, and paths of the user's own."""

from __future__ import annotations

from collections.abc import Mapping

from oed.foundation.errors import NotFinite
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.problem import Problem
from oed.kernel.solution import Solution, unscored
from oed.optimize.selection import rate_trajectory, with_readings
from oed.robots.baselines import baselines
from oed.study.study import PathFile, RobotStudyFile, Study
from oed.workflow.studies import Work

IN_PLACE = 0.01
"""Path length [m] of a design below which paths of the same length mean nothing."""


def compared(work: Work, paths: Mapping[str, Trajectory], best: Solution | None) -> list[Solution]:
    """The drives that a study compares with, scored.

    Args:
        work: on the study.
        paths: of the user's own, by their names.
        best: design, whose length baselines have too.
    """
    # Every baseline as large as it can be, and again with the best design's length, as in the paper: where
    # that can be driven, or the study asks for it.
    problem, asked = work.study.problem, work.study.file.baselines
    if not asked:
        return []
    work.progress.begin("score baselines", len(asked))
    length = best.evaluation.path_length if best is not None and best.evaluation is not None else None
    if length is not None and length < IN_PLACE:
        length = None
    found: list[Solution] = []
    for path in asked:
        if isinstance(path, PathFile):
            found.append(_scored_path(problem, paths[path.label], path.label))
        else:
            all_readings = baselines(problem.unselected, path, length=length, seed=work.seed)
            each = (with_readings(problem, one) for one in all_readings)
            own, *same = each
            found += [own, *(one for one in same if _same_length(work.study) or _driven(one))]
        work.progress.advance()
    return found


def _same_length(study: Study) -> bool:
    return isinstance(study.file, RobotStudyFile) and study.file.same_length


def _driven(one: Solution) -> bool:
    return one.evaluation is not None and one.evaluation.feasible


def _scored_path(problem: Problem, path: Trajectory, name: str) -> Solution:
    # What cannot be scored must not take with it what has been found.
    try:
        return rate_trajectory(problem, path, name)
    except NotFinite as error:
        return unscored(name, "path", f"{error}.")
