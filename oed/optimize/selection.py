"""Readings chosen for a trajectory, by weights that are best for it."""

from __future__ import annotations

import pickle
from dataclasses import dataclass, replace
from weakref import WeakKeyDictionary

import numpy as np

from oed.foundation.arguments import typed
from oed.foundation.errors import UserMistake
from oed.foundation.presenting import Brief
from oed.kernel.criteria import Criterion
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.equivalence import weight_bound
from oed.kernel.evaluation import evaluate
from oed.kernel.parts import Budget, Cost, Parts
from oed.kernel.problem import Problem
from oed.kernel.repetitions import costs_of
from oed.kernel.selection import Selection
from oed.kernel.solution import Solution, scored
from oed.kernel.taken_apart import parts_of
from oed.optimize.exact import Exact, exact_weights
from oed.optimize.weights import Weights, best_weights, whole_weights


@dataclass(frozen=True, repr=False)
class Selected(Brief):
    """Readings chosen within a problem's budget.

    Attributes:
        criterion: by which.
        parts: what has weights.
        budgets: of these.
        costs: of limits on all trials together.
        relaxed: the best weights, not whole.
        exact: whole readings, and what no others exceed; None where the problem asks for none.
    """

    criterion: Criterion
    parts: Parts
    budgets: tuple[Budget, ...]
    costs: tuple[Cost, ...]
    relaxed: Weights
    exact: Exact | None

    @property
    def chosen(self) -> Weights:
        """What is to be done."""
        return self.relaxed if self.exact is None else self.exact.weights

    @property
    def bound(self) -> float:
        """What the criterion of no choice exceeds, whole where whole ones are asked for."""
        if self.exact is not None:
            return self.exact.bound
        return weight_bound(
            self.criterion, self.parts, self.relaxed.values, self.relaxed.gradient, self.budgets, self.costs
        )


@typed
def select(problem: Problem, trajectory: Trajectory) -> Selected | None:
    """The best readings of a trajectory within the problem's `selection`; None where all of them together
    leave undetermined what the criterion asks for: then no choice is better than another.

    Args:
        problem: with a selection.
        trajectory: whose readings they are; weights that it has are of no matter.

    Raises:
        UserMistake: a criterion that is not concave, or a problem without a selection.
        ProblemError: readings that do not add up.
    """
    if problem.selection is None:
        raise UserMistake("the problem's readings are all taken: give it a selection")
    # A search asks first, then whoever scores the drive, and the record each time that it is saved.
    known = _KNOWN.setdefault(problem, {})
    key = pickle.dumps(replace(trajectory, weights=None))
    if key not in known:
        known[key] = _selected(problem, problem.selection, trajectory)
    return known[key]


_KNOWN: WeakKeyDictionary[Problem, dict[bytes, Selected | None]] = WeakKeyDictionary()


def _selected(problem: Problem, selection: Selection, trajectory: Trajectory) -> Selected | None:
    parts = selection.parts(parts_of(problem, trajectory))
    budgets, criterion = selection.budgets(parts), problem.objective
    if not criterion.identifiable([parts.root(np.ones(len(parts.readings)))]):
        return None
    costs = costs_of(problem, trajectory, parts)
    relaxed = best_weights(criterion, parts, budgets, costs)
    if not selection.whole:
        return Selected(criterion, parts, budgets, costs, relaxed, None)
    near = whole_weights(criterion, parts, relaxed.values, budgets)
    # Of a search that ended where less is identifiable.
    relaxed = near if near.value > relaxed.value else relaxed
    return Selected(criterion, parts, budgets, costs, relaxed, exact_weights(criterion, parts, near, budgets))


def rated(problem: Problem, trajectory: Trajectory, name: str) -> Solution:
    """A trajectory that nobody searched for, scored with the readings that are best for it.

    Args:
        problem: that scores it.
        trajectory: of which all readings, or those with weights, may be taken.
        name: of the solution.
    """
    if problem.selection is None or trajectory.weights is not None:
        return scored(problem, trajectory, name)
    return with_readings(problem, scored(replace(problem, selection=None), trajectory, name))


def with_readings(problem: Problem, solution: Solution) -> Solution:
    """A solution with the readings that are best for its trajectory, scored anew.

    Args:
        problem: with a selection.
        solution: of the same without one.
    """
    if solution.trajectory is None or problem.selection is None:
        return solution
    found = select(problem, solution.trajectory)
    if found is not None:
        weights = found.parts.of_every_reading(found.chosen.values)
    else:
        parts = problem.selection.parts(parts_of(problem, solution.trajectory))
        even = np.zeros(len(parts.readings))
        for one in problem.selection.budgets(parts):
            even[list(one.places)] = one.even * one.upper
        weights = parts.of_every_reading(even)
    trajectory = replace(solution.trajectory, weights=weights)
    evaluation = evaluate(problem, trajectory)
    return replace(solution, trajectory=trajectory, evaluation=evaluation, problem=problem)
