"""Readings chosen for a trajectory, by weights that are best for it."""

from __future__ import annotations

import pickle
from dataclasses import dataclass, replace
from weakref import WeakKeyDictionary

import numpy as np

from oed.foundation.arguments import typed
from oed.foundation.arrays import Bools
from oed.foundation.errors import UserMistake
from oed.foundation.presenting import Brief
from oed.kernel.criteria import Criterion
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.equivalence import weight_bound
from oed.kernel.evaluation import evaluate, resolved
from oed.kernel.parts import Budget, Cost, Parts
from oed.kernel.problem import Problem
from oed.kernel.reading_parts import parts_of
from oed.kernel.repetitions import costs_of, periods_of, spent_at_most, with_candidates
from oed.kernel.results import TOLERANCE
from oed.kernel.scorer import limits_exceeded
from oed.kernel.selection import Selection
from oed.kernel.solution import Solution, scored
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
    parts, budgets, costs = _within(problem, selection, trajectory)
    criterion, largest = problem.objective, np.zeros(len(parts.readings))
    for budget in budgets:
        largest[list(budget.places)] = budget.upper
    if not criterion.identifiable([parts.root(largest)]):
        return None
    relaxed = best_weights(criterion, parts, budgets, costs)
    if not selection.whole:
        return Selected(criterion, parts, budgets, costs, relaxed, None)
    near = whole_weights(criterion, parts, relaxed.values, budgets)
    # A search may end where less is identifiable.
    relaxed = near if near.value > relaxed.value else relaxed
    return Selected(criterion, parts, budgets, costs, relaxed, exact_weights(criterion, parts, near, budgets))


def _within(
    problem: Problem, selection: Selection, trajectory: Trajectory
) -> tuple[Parts, tuple[Budget, ...], tuple[Cost, ...]]:
    # What has weights, with its budgets and costs; candidates that exceed a limit have none.
    parts = selection.parts(parts_of(problem, trajectory))
    allowed = _allowed(problem, selection, trajectory, parts)
    budgets = tuple(_restricted(budget, allowed) for budget in selection.budgets(parts))
    return parts, budgets, costs_of(problem, trajectory, parts)


def _allowed(problem: Problem, selection: Selection, trajectory: Trajectory, parts: Parts) -> Bools:
    # Candidates that keep to the limits, (n,): all where none does, or where no candidates are weighted.
    allowed = np.ones(len(parts.readings), dtype=bool)
    limited = [limit.name for limit in problem.limits if not limit.counts_trials]
    weighs_moments = problem.model.states and selection.of != "trials"
    if problem.design.only is None or not limited or weighs_moments:
        return allowed
    periods, bare = periods_of(problem, trajectory, parts), replace(problem, selection=None)
    waiting = [np.arange(len(allowed))]
    while waiting:
        places, chosen = waiting.pop(), np.zeros(trajectory.samples, dtype=bool)
        chosen[np.concatenate([periods[place] for place in places])] = True
        drive = with_candidates(replace(trajectory, weights=None), chosen)
        exceeded = limits_exceeded(resolved(bare, drive), drive, TOLERANCE)
        if exceeded.isdisjoint(limited):
            continue
        if len(places) > 1:
            waiting += np.array_split(places, 2)
        else:
            allowed[places] = False
    return allowed if allowed.any() else ~allowed


def _restricted(budget: Budget, allowed: Bools) -> Budget:
    # The budget without weights of what is not allowed, and of what can be spent then.
    members = allowed[list(budget.places)]
    if members.all():
        return budget
    tops = np.where(members, budget.upper, 0.0)
    total = min(budget.total, float(np.array(budget.sizes) @ tops))
    return replace(budget, tops=tuple(tops.tolist()), total=total) if total > 0 else budget


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
        parts, budgets, costs = _within(problem, problem.selection, solution.trajectory)
        even = np.zeros(len(parts.readings))
        for budget in budgets:
            even[list(budget.places)] = budget.even * budget.upper
        weights = parts.of_every_reading(spent_at_most(costs, even))
    trajectory = replace(solution.trajectory, weights=weights)
    evaluation = evaluate(problem, trajectory)
    return replace(solution, trajectory=trajectory, evaluation=evaluation, problem=problem)
