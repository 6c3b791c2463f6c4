"""Certificates of chosen readings: of one trajectory's, no weights within the budgets are better."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from oed.bounds.certificate import Certificate, raised
from oed.foundation.arguments import typed
from oed.foundation.arrays import Array
from oed.foundation.presenting import Brief
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.equivalence import directional_derivatives
from oed.kernel.problem import Problem
from oed.optimize.selection import Selected, select

UNDETERMINED = "all readings together leave parameters undetermined: no choice of them is bounded"
"""Where nothing is proved."""
METHOD = "directional derivatives at the best weights [Kiefer and Wolfowitz, 1960], {count} weights"


@dataclass(frozen=True, repr=False)
class Certified(Brief):
    """Readings chosen for a trajectory, with what proves how good they are.

    Attributes:
        selected: the readings.
        bound: no weights within the budgets have more.
        derivatives: of the criterion, linearised at the relaxed weights, by every weight, (n,).
    """

    selected: Selected
    bound: float
    derivatives: Array


@typed
def certified_selection(problem: Problem, trajectory: Trajectory) -> Certified | None:
    """The best readings of a trajectory within the problem's selection, and what no others exceed; None where
    all of them together leave undetermined what the criterion asks for.

    Args:
        problem: with a selection.
        trajectory: whose readings they are.

    Raises:
        UserMistake: a criterion that is not concave, or a problem without a selection.
        ProblemError: readings that do not add up.
    """
    found = select(problem, trajectory)
    if found is None:
        return None
    slopes = directional_derivatives(found.parts, found.relaxed.values, found.relaxed.gradient)
    return Certified(found, found.bound, slopes)


def selection_certificate(problem: Problem, trajectory: Trajectory) -> Certificate:
    """What no choice of the readings of a trajectory exceeds."""
    found = certified_selection(problem, trajectory)
    if found is None:
        return Certificate(np.inf, UNDETERMINED, (), criterion=problem.criterion)
    count, judged = len(found.derivatives), found.selected.parts.judged
    return Certificate(
        raised(found.bound, problem.criterion, judged),
        METHOD.format(count=count),
        ("readings of this experiment within the budget of weights",),
        found.selected.relaxed.gradient,
        criterion=problem.criterion,
        judged=judged,
    )
