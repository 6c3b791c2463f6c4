"""Certificates of selected readings: upper bounds on all weights within the budgets."""

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
"""Method of certificates without a bound."""
METHOD = "directional derivatives at the best weights [Kiefer and Wolfowitz, 1960], {count} weights"


@dataclass(frozen=True, repr=False)
class Certified(Brief):
    """Readings selected for a trajectory, with an upper bound on all selections.

    Attributes:
        selected: selected readings.
        bound: upper bound on the criterion over all weights within the budgets.
        derivatives: derivatives of the criterion by the weights, at the relaxed weights, (n,).
    """

    selected: Selected
    bound: float
    derivatives: Array


@typed
def certified_selection(problem: Problem, trajectory: Trajectory) -> Certified | None:
    """Select the best readings of a trajectory, and bound the criterion over all selections.

    Args:
        problem: problem with a selection.
        trajectory: trajectory with the readings.

    Returns:
        The readings with their bound; None if all readings together leave parameters undetermined that the
        criterion judges.

    Raises:
        UserMistake: the criterion is not concave, or the problem has no selection.
        ProblemError: the information of the readings does not add up.
    """
    selected = select(problem, trajectory)
    if selected is None:
        return None
    slopes = directional_derivatives(selected.parts, selected.relaxed.values, selected.relaxed.gradient)
    return Certified(selected, selected.bound, slopes)


def selection_certificate(problem: Problem, trajectory: Trajectory) -> Certificate:
    """Return the certificate of all selections of readings of a trajectory."""
    certified = certified_selection(problem, trajectory)
    if certified is None:
        return Certificate(np.inf, UNDETERMINED, (), criterion=problem.criterion)
    count, judged = len(certified.derivatives), certified.selected.parts.judged
    return Certificate(
        raised(certified.bound, problem.criterion, judged),
        METHOD.format(count=count),
        ("readings of this experiment within the budget of weights",),
        certified.selected.relaxed.gradient,
        criterion=problem.criterion,
        judged=judged,
    )
