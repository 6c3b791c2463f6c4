"""`evaluate`: every number that anything reports about a trajectory comes from here."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from oed.foundation.arguments import typed
from oed.foundation.errors import NotFinite
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.problem import Problem
from oed.kernel.results import Evaluation, Steps
from oed.kernel.scorer import score

FACTOR = 4
"""Number of times that the next steps are finer: errors are 16 to 1000 times smaller with those."""
FINEST = 64
"""Number of times that steps are finer than the study's at most."""
AGREEMENT = 0.01
"""Share of the information, of a standard error and of a limit's size by which results of two step lengths
may differ where the steps are called fine enough.
"""


@typed
def evaluate(problem: Problem, trajectory: Trajectory) -> Evaluation:
    """Score any trajectory by a problem's measurement, criterion and limits.

    The trajectory keeps its own duration and samples; where it breaks the study's duration, start or
    rest, that is a violation like any other. Integration steps are made finer until results no longer change:
    see `Evaluation.steps`. Steps of weighted readings are at least as fine as those of all readings, by which
    the weights are chosen.

    Raises:
        ValueError: inputs or states that do not match the robot's, another number of runs.
        NotFinite: a drive, or what is measured of it, that is not finite; says what, and when.
        WrongKind: no problem, or no trajectory.
    """
    if not problem.system.integrates:
        return score(problem, trajectory)
    study_score = coarse = _finite(problem, trajectory)
    times, settled = FACTOR, False
    if trajectory.weights is not None:
        times = times_finer(problem.unselected, replace(trajectory, weights=None))
        coarse = _finite(problem.refined(times // FACTOR), trajectory)
    while True:
        fine = _finite(problem.refined(times), trajectory)
        settled = coarse is not None and fine is not None and _agree(coarse, fine)
        if settled or times >= FINEST:
            break
        coarse, times = fine, FACTOR * times
    if fine is None:
        fine = score(problem.refined(times), trajectory)
    change = np.inf if study_score is None else _change(study_score, fine)
    return replace(fine, steps=Steps(times, times // FACTOR, change, settled))


def _finite(problem: Problem, trajectory: Trajectory) -> Evaluation | None:
    # Steps that are too coarse may not even be stable: None.
    try:
        return score(problem, trajectory)
    except NotFinite:
        return None


def resolved(problem: Problem, trajectory: Trajectory) -> Problem:
    """The problem with the integration steps by which `evaluate` scores a trajectory.

    Args:
        problem: problem that scores it.
        trajectory: trajectory to score.

    Raises:
        ValueError, NotFinite: see `evaluate`.
    """
    return problem.refined(times_finer(problem, trajectory))


def times_finer(problem: Problem, trajectory: Trajectory) -> int:
    """Return the number of times that `evaluate` divides the study's integration steps; 1 without any.

    Args:
        problem: problem that scores it.
        trajectory: trajectory to score.

    Raises:
        ValueError, NotFinite: see `evaluate`.
    """
    steps = evaluate(problem, trajectory).steps if problem.system.integrates else None
    return 1 if steps is None else steps.times


def _agree(coarse: Evaluation, fine: Evaluation) -> bool:
    # To a share of all that is reported, and in which limits are satisfied.
    alike = all(
        margin.satisfied == exact.satisfied
        for margin, exact in zip(coarse.margins, fine.margins, strict=True)
    )
    return alike and _change(coarse, fine) <= AGREEMENT


def _change(coarse: Evaluation, fine: Evaluation) -> float:
    # The largest of the differences of the information, of standard errors and of margins.
    margins = (
        abs(margin.margin - exact.margin) / exact.size
        for margin, exact in zip(coarse.margins, fine.margins, strict=True)
        if exact.size > 0 and margin.margin != exact.margin
    )
    errors = coarse.standard_deviations
    deviations = (
        abs(errors[name] / exact - 1) if exact > 0 and np.isfinite(exact) else np.inf
        for name, exact in fine.standard_deviations.items()
        if errors[name] != exact
    )
    information = (_difference(coarse.information[name], exact) for name, exact in fine.information.items())
    return float(max([0.0, *margins, *deviations, *information]))


def _difference(coarse: np.ndarray, fine: np.ndarray) -> float:
    # The largest |F - F'|_ij / sqrt(F'_ii F'_jj).
    sizes = np.sqrt(np.diag(fine))
    units = np.outer(sizes, sizes)
    difference = (np.abs(coarse - fine) / np.where(units > 0, units, 1.0)).max(initial=0.0)
    return float(difference) if np.isfinite(difference) else np.inf
