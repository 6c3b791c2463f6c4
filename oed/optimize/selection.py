"""Selection of the readings of a trajectory, by the weights that are best for it."""

from __future__ import annotations

import pickle
from dataclasses import dataclass, replace
from functools import cached_property
from weakref import WeakKeyDictionary

import numpy as np

from oed.foundation.arguments import typed
from oed.foundation.arrays import Array, Bools
from oed.foundation.errors import UserMistake
from oed.foundation.presenting import Brief
from oed.kernel.criteria import Criterion
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.equivalence import directional_derivatives, weight_bound
from oed.kernel.evaluation import evaluate, times_finer
from oed.kernel.parts import Budget, Cost, Parts
from oed.kernel.problem import Problem
from oed.kernel.reading_parts import parts_of
from oed.kernel.repetitions import costs_of, periods_of, spent_at_most, with_candidates
from oed.kernel.results import TOLERANCE
from oed.kernel.scorer import limits_exceeded
from oed.kernel.selection import Selection
from oed.kernel.solution import Solution, scored
from oed.optimize.exact import Exact, exact_weights
from oed.optimize.weights import Weights, best_weights, weights_by_budget, whole_weights


@dataclass(frozen=True, repr=False)
class Selected(Brief):
    """Readings chosen within a problem's budget.

    Attributes:
        criterion: criterion that the weights maximise.
        parts: information of the weighted readings.
        budgets: budgets of the readings.
        costs: costs of limits on all trials together.
        relaxed: best weights without the condition that they are whole.
        exact: best whole readings, and their upper bound; None where the problem asks for no whole readings.
    """

    criterion: Criterion
    parts: Parts
    budgets: tuple[Budget, ...]
    costs: tuple[Cost, ...]
    relaxed: Weights
    exact: Exact | None

    @property
    def chosen(self) -> Weights:
        """Weights to be used: whole ones where the problem asks for these."""
        return self.relaxed if self.exact is None else self.exact.weights

    @property
    def weights_of_readings(self) -> Array:
        """The weight of every single reading of the trajectory."""
        return self.parts.of_every_reading(self.chosen.values)

    @cached_property
    def bound(self) -> float:
        """Upper bound on the criterion of all selections, whole ones where the problem asks for these."""
        if self.exact is not None:
            return self.exact.bound
        return weight_bound(
            self.criterion, self.parts, self.relaxed.values, self.relaxed.gradient, self.budgets, self.costs
        )

    @cached_property
    def derivatives(self) -> Array:
        """Derivatives of the criterion by the weights, at the relaxed weights, (n,)."""
        return directional_derivatives(self.parts, self.relaxed.values, self.relaxed.gradient)


@typed
def select(problem: Problem, trajectory: Trajectory) -> Selected | None:
    """Return the best readings of a trajectory within the problem's `selection`.

    It is None where all readings together do not identify what the criterion judges: then no selection is
    better than another.

    Args:
        problem: problem with a selection.
        trajectory: trajectory whose readings are selected; its weights are ignored.

    Raises:
        UserMistake: the criterion is not concave, or the problem has no selection.
        ProblemError: the numbers of readings are inconsistent.
    """
    if problem.selection is None:
        raise UserMistake("the problem's readings are all taken: give it a selection")
    # The search, the score of its drive and every save of the record need the same selection.
    selections = _SELECTIONS.setdefault(problem, {})
    key = pickle.dumps(replace(trajectory, weights=None))
    if key not in selections:
        selections[key] = _select(problem, problem.selection, trajectory)
    return selections[key]


_SELECTIONS: WeakKeyDictionary[Problem, dict[bytes, Selected | None]] = WeakKeyDictionary()


def _select(problem: Problem, selection: Selection, trajectory: Trajectory) -> Selected | None:
    # Fewer readings may need finer integration steps than all of them do.
    drive = replace(trajectory, weights=None)
    times = times_finer(problem.unselected, drive)
    while (selected := _select_by_steps(problem, selection, drive, times)) is not None:
        drive = replace(drive, weights=selected.weights_of_readings)
        needed = times_finer(problem, drive)
        if needed <= times:
            break
        times = needed
    return selected


def _select_by_steps(
    problem: Problem, selection: Selection, trajectory: Trajectory, times: int
) -> Selected | None:
    # The best readings by the integration steps with which this trajectory is scored: so many times finer.
    parts, budgets, costs = _budgeted_parts(problem, selection, trajectory, times)
    criterion = problem.refined(times).objective
    largest = weights_by_budget(budgets, len(parts.readings), lambda budget: budget.upper)
    if not criterion.identifiable([parts.root(largest)]):
        return None
    relaxed = best_weights(criterion, parts, budgets, costs)
    if not selection.whole:
        return Selected(criterion, parts, budgets, costs, relaxed, None)
    near = whole_weights(criterion, parts, relaxed.values, budgets)
    # The relaxed weights may identify less than the whole ones.
    relaxed = near if near.value > relaxed.value else relaxed
    return Selected(criterion, parts, budgets, costs, relaxed, exact_weights(criterion, parts, near, budgets))


def _budgeted_parts(
    problem: Problem, selection: Selection, trajectory: Trajectory, times: int
) -> tuple[Parts, tuple[Budget, ...], tuple[Cost, ...]]:
    # Weighted readings, with their budgets and costs; candidates that exceed a limit get no weight.
    parts = selection.parts(parts_of(problem, trajectory))
    refined = problem.refined(times)
    allowed = _allowed(refined, selection, trajectory, parts)
    budgets = tuple(_restrict(budget, allowed) for budget in selection.budgets(parts))
    return parts, budgets, costs_of(refined, trajectory, parts)


def _allowed(problem: Problem, selection: Selection, trajectory: Trajectory, parts: Parts) -> Bools:
    # Mask (n,) of candidates that satisfy the limits: all where none does, or without weighted candidates.
    allowed = np.ones(len(parts.readings), dtype=bool)
    limited = [limit.name for limit in problem.limits if not limit.counts_trials]
    weighs_moments = problem.model.states and selection.of != "trials"
    if problem.design.only is None or not limited or weighs_moments:
        return allowed
    periods, bare = periods_of(problem, trajectory, parts), problem.unselected
    waiting = [np.arange(len(allowed))]
    while waiting:
        places, chosen = waiting.pop(), np.zeros(trajectory.samples, dtype=bool)
        chosen[np.concatenate([periods[place] for place in places])] = True
        drive = with_candidates(replace(trajectory, weights=None), chosen)
        exceeded = limits_exceeded(bare, drive, TOLERANCE)
        if exceeded.isdisjoint(limited):
            continue
        if len(places) > 1:
            waiting += np.array_split(places, 2)
        else:
            allowed[places] = False
    return allowed if allowed.any() else ~allowed


def _restrict(budget: Budget, allowed: Bools) -> Budget:
    # The budget without weights of forbidden readings; its total is at most what the others can spend.
    members = allowed[list(budget.places)]
    if members.all():
        return budget
    tops = np.where(members, budget.upper, 0.0)
    total = min(budget.total, float(np.array(budget.sizes) @ tops))
    return replace(budget, tops=tuple(tops.tolist()), total=total) if total > 0 else budget


def rate_trajectory(problem: Problem, trajectory: Trajectory, name: str) -> Solution:
    """Return a trajectory that was not searched for, scored with the readings that are best for it.

    Args:
        problem: problem that scores it.
        trajectory: trajectory with all readings, or with weights of these.
        name: name of the solution.
    """
    if problem.selection is None or trajectory.weights is not None:
        return scored(problem, trajectory, name)
    return with_readings(problem, scored(problem.unselected, trajectory, name))


def with_readings(problem: Problem, solution: Solution) -> Solution:
    """Return a solution with the readings that are best for its trajectory, scored again.

    Args:
        problem: problem with a selection.
        solution: solution of the same problem without one.
    """
    if solution.trajectory is None or problem.selection is None:
        return solution
    selected = select(problem, solution.trajectory)
    if selected is not None:
        weights = selected.weights_of_readings
    else:
        times = times_finer(problem.unselected, solution.trajectory)
        parts, budgets, costs = _budgeted_parts(problem, problem.selection, solution.trajectory, times)
        even = weights_by_budget(budgets, len(parts.readings), lambda budget: budget.even * budget.upper)
        weights = parts.of_every_reading(spent_at_most(costs, even))
    trajectory = replace(solution.trajectory, weights=weights)
    evaluation = evaluate(problem, trajectory)
    return replace(solution, trajectory=trajectory, evaluation=evaluation, problem=problem)
