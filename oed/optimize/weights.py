"""Weights of readings that maximise a criterion within budgets: relaxed ones, and whole ones near them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
import scipy

from oed.foundation.arguments import typed
from oed.foundation.arrays import ROUNDING, Array, Places
from oed.foundation.equality import ByValue
from oed.foundation.errors import UserMistake
from oed.foundation.presenting import Brief
from oed.kernel.criteria import Criterion
from oed.kernel.equivalence import weight_bound
from oed.kernel.measurement.square_root import rounding_of
from oed.kernel.parts import Budget, Cost, Parts
from oed.kernel.repetitions import spent_at_most
from oed.optimize.interior_point import maximise
from oed.optimize.objectives import weight_objective
from oed.optimize.weight_program import WeightProgram

PRESENT = 1e-6
"""Share of the largest weight within which a weight counts as at a bound."""
BEGUN = 0.9
"""Share of every limit that first weights use where costs limit them."""


@dataclass(frozen=True, repr=False, eq=False)
class Weights(ByValue, Brief):
    """Weights of readings.

    Attributes:
        values: weight of each reading, (n,).
        value: the criterion at these weights.
        gradient: a supergradient of the criterion there, of many the one that bounds all weights best; 0 of
            weights that leave undetermined what the criterion asks for.
    """

    values: Array
    value: float
    gradient: Array


@typed
def best_weights(
    criterion: Criterion, parts: Parts, budgets: Sequence[Budget], costs: Sequence[Cost] = ()
) -> Weights:
    """Return the weights within budgets that maximise a concave criterion.

    Args:
        criterion: E, D, A, G or I of one block: the `objective` of a problem.
        parts: information of the readings.
        budgets: budgets of all readings; spent in full, unless there are costs.
        costs: costs that the weights may not exceed.

    Raises:
        UserMistake: the criterion is not concave.
    """
    if not criterion.concave:
        text = f"{criterion.kind} is not concave: nothing says how good weights can be"
        raise UserMistake(f"{text}; use E, D, A, G or I")
    count = len(parts.readings)
    most = weights_by_budget(budgets, count, lambda budget: budget.upper)
    even = weights_by_budget(budgets, count, lambda budget: min(budget.even, 1.0) * budget.upper)
    first, inside = _first(budgets, costs, even)
    start = _weights(criterion, parts, first)
    # Budgets for all of their readings leave no choice.
    open_budgets = [budget for budget in budgets if costs or budget.even < 1.0 - ROUNDING]
    if not inside or not open_budgets or not criterion.identifiable([parts.root(start.values)]):
        return start
    free = np.sort(np.concatenate([np.array(budget.places, dtype=int) for budget in open_budgets]))
    free = free[most[free] > 0]
    limits = _Limits(open_budgets, costs, most)
    values, multiplier = _maximise(criterion, parts, limits, start.values, free)
    chosen = limits.nearest(values)
    planes = [_weights(criterion, parts, chosen, dual) for dual in (multiplier, None)]
    best = min(
        planes, key=lambda plane: weight_bound(criterion, parts, chosen, plane.gradient, budgets, costs)
    )
    return best if best.value > start.value else start


def _first(budgets: Sequence[Budget], costs: Sequence[Cost], even: Array) -> tuple[Array, bool]:
    # First weights (n,), and whether they keep strictly to all costs; without costs they are even ones.
    if not costs:
        return even, True
    first = BEGUN * spent_at_most(costs, even)
    if all(cost.spent(first) < cost.most for cost in costs):
        return first, True
    # What is to be earned is not earned by lower weights: the weights that exceed each cost least, as a share
    # of its largest, mixed with as many even ones as that leaves room for.
    upper = weights_by_budget(budgets, len(even), lambda budget: budget.upper)
    limits = [(cost.sizes, cost.most, float(np.abs(cost.sizes) @ upper)) for cost in costs]
    for budget in budgets:
        sizes = np.zeros(len(even))
        sizes[list(budget.places)] = budget.sizes
        limits.append((tuple(sizes), budget.total, 0.0))
    sizes, most, shares = (np.array(column) for column in zip(*limits, strict=True))
    bounds = [*((0.0, top) for top in upper), (None, 1.0)]
    objective = np.append(np.zeros(len(even)), -1.0)
    solution = scipy.optimize.linprog(objective, np.column_stack([sizes, shares]), most, bounds=bounds)
    least, spare = solution.x[:-1], float(solution.x[-1])
    if spare <= ROUNDING:
        return least, False
    room = [
        spare * share / max(cost.spent(first) - cost.spent(least), spare * share)
        for cost, share in zip(costs, shares, strict=False)
    ]
    mixed = min(room) / 2
    return (1 - mixed) * least + mixed * first, True


def weights_by_budget(budgets: Sequence[Budget], count: int, values: Callable[[Budget], Array]) -> Array:
    """Return weights of all readings (n,), set budget by budget; 0 for readings without a budget.

    Args:
        budgets: budgets of the readings.
        count: number n of readings.
        values: function from a budget to the weights of its readings.
    """
    weights = np.zeros(count)
    for budget in budgets:
        weights[list(budget.places)] = values(budget)
    return weights


@dataclass(frozen=True)
class _Limits:
    # Budgets that leave a choice, costs, and the largest weights (n,).
    budgets: Sequence[Budget]
    costs: Sequence[Cost]
    most: Array

    def nearest(self, weights: Array) -> Array:
        """Return the nearest weights (n,) that keep to all limits, up to one share of each budget."""
        chosen = np.clip(weights, 0.0, self.most)
        for budget in self.budgets:
            if not self.costs or budget.spent(chosen) > budget.total:
                chosen[list(budget.places)] = _spend(budget, chosen)
        return spent_at_most(self.costs, chosen)


def _spend(budget: Budget, weights: Array) -> Array:
    # The weights of a budget, all lowered or raised by one share until the budget is spent.
    current, spare = weights[list(budget.places)], budget.total - budget.spent(weights)
    if spare <= 0:
        return np.asarray(current * (budget.total / budget.spent(weights)))
    slack = budget.upper - current
    unspent = float(np.array(budget.sizes) @ slack)
    return np.asarray(current + slack * min(spare / unspent, 1.0)) if unspent > 0 else current


def _maximise(
    criterion: Criterion, parts: Parts, limits: _Limits, start: Array, free: Places
) -> tuple[Array, Array]:
    # The best weights (n,), with fixed ones unchanged, and a multiplier (judged, judged).
    certain = start.copy()
    certain[free] = 0.0
    some = parts if len(free) == len(start) else parts.taken(certain, free)
    first = start[free]
    roots = np.sqrt(first)[some.places]
    rows = roots[:, None] * some.rows
    units, across, eliminated = _whitening(np.vstack([rows, some.known_rows]), parts.judged)

    def whitened(derivatives: Array) -> Array:
        nuisances = derivatives[:, parts.judged :] @ eliminated
        return np.hstack([(derivatives[:, : parts.judged] - nuisances @ across) @ units, nuisances])

    number = np.full(len(start), -1)
    number[free] = np.arange(len(free))
    spent, upper = np.zeros((len(limits.budgets), len(free))), limits.most[free] / first
    for row, budget in zip(spent, limits.budgets, strict=True):
        places = number[list(budget.places)]
        row[places[places >= 0]] = np.array(budget.sizes)[places >= 0] / budget.total
    spent *= first
    # A weight that its budget limits already needs no bound.
    upper[spent.max(axis=0) * upper >= 1.0] = np.inf
    priced = np.array([cost.sizes for cost in limits.costs]).reshape(-1, len(start))[:, free] * first
    # Costs are in units of what the first weights spare of them.
    spare = np.array([cost.most for cost in limits.costs]) - priced.sum(axis=1)
    beside = len(spent) if len(priced) else 0
    program = WeightProgram(
        whitened(rows),
        some.places,
        whitened(some.known_rows),
        units.shape[1],
        upper,
        spent[beside:],
        np.vstack([spent[:beside], priced / spare[:, None]]),
        np.concatenate([np.ones(beside), 1.0 + priced.sum(axis=1) / spare]),
    )
    shares, gradient = maximise(program, weight_objective(criterion, units))
    certain[free] = _sparsest(program, shares) * first
    return certain, units @ gradient @ units.T


def _sparsest(program: WeightProgram, weights: Array) -> Array:
    # Weights of the same information, no more of them strictly between their bounds than there are equations
    # [Caratheodory]: a few of many similar readings, rather than a little of each.
    columns, lines = np.triu_indices(program.rows.shape[1])
    squares = program.by_reading(program.rows[:, columns] * program.rows[:, lines]).T
    same = np.vstack([squares, program.equalities, program.inequalities])
    fewer, least = weights.copy(), PRESENT * weights.max()
    while True:
        inner = np.flatnonzero((fewer > least) & (fewer < program.upper - least))[: 2 * len(same)]
        if len(inner) <= len(same):
            return fewer
        # Directions along which nothing changes; each is followed until a weight meets its bound.
        directions = np.linalg.svd(same[:, inner])[2][len(same) :]
        for place in range(len(directions)):
            direction, current = directions[place], fewer[inner]
            slack = np.where(direction < 0, current, program.upper[inner] - current)
            lengths = np.full(len(inner), np.inf)
            np.divide(slack, np.abs(direction), out=lengths, where=np.abs(direction) > PRESENT)
            if not np.isfinite(lengths).any():
                lengths = np.where(direction > PRESENT, current / np.abs(direction), np.inf)
                direction = -direction
            first = int(lengths.argmin())
            fewer[inner] = np.clip(current + lengths[first] * direction, 0.0, program.upper[inner])
            fewer[inner[first]] = 0.0 if direction[first] < 0 else program.upper[inner[first]]
            rest = directions[place + 1 :]
            rest -= np.outer(rest[:, first] / direction[first], direction)


def _whitening(rows: Array, judged: int) -> tuple[Array, Array, Array]:
    # For rows (k, q): orthonormal combinations of the judged columns without those of the nuisance columns,
    # (p, r); projections of the judged columns on combinations of the nuisance columns, (s, p); and these
    # combinations, (q - p, s).
    eliminated = _orthonormal(rows[:, judged:])
    basis = rows[:, judged:] @ eliminated
    across = basis.T @ rows[:, :judged]
    return _orthonormal(rows[:, :judged] - basis @ across), across, eliminated


def _orthonormal(rows: Array) -> Array:
    # Orthonormal combinations of columns, which are scaled first so that their units do not matter.
    sizes = np.linalg.norm(rows, axis=0)
    some = np.flatnonzero(sizes)
    _, lengths, directions = np.linalg.svd(rows[:, some] / sizes[some], full_matrices=False)
    regular = lengths > rounding_of(rows)
    combinations = np.zeros((rows.shape[1], int(regular.sum())))
    combinations[some] = (directions[regular] / lengths[regular, None]).T / sizes[some, None]
    return combinations


@typed
def whole_weights(criterion: Criterion, parts: Parts, weights: Array, budgets: Sequence[Budget]) -> Weights:
    """Return whole readings within budgets: rounded weights, exchanged one by one while that is better.

    `weight_bound` bounds how much better any weights could be.

    Args:
        criterion: a concave criterion, to be large.
        parts: information of the readings.
        weights: weights of a relaxed choice, (n,).
        budgets: budgets of all readings, with totals of whole ones.

    Raises:
        UserMistake: a total that whole readings cannot spend.
    """
    nearest = weights_by_budget(
        budgets, len(weights), lambda budget: _nearest(weights[list(budget.places)], budget)
    )
    return exchanged_weights(criterion, parts, nearest, budgets)


def exchanged_weights(
    criterion: Criterion, parts: Parts, weights: Array, budgets: Sequence[Budget]
) -> Weights:
    """Return whole readings, exchanged one by one while that is better.

    Args:
        criterion: a concave criterion, to be large.
        parts: information of the readings.
        weights: whole weights within the budgets, (n,).
        budgets: budgets of all readings.
    """
    chosen = weights
    value, better = criterion_value(criterion, parts, chosen), True
    while better:
        better = False
        for dropped, substitutes in _exchanges(chosen, budgets):
            trials = [_exchanged(chosen, dropped, taken) for taken in substitutes]
            values = [criterion_value(criterion, parts, trial) for trial in trials]
            if values and exceeds(max(values), value):
                chosen, value, better = trials[int(np.argmax(values))], max(values), True
                break
    return _weights(criterion, parts, chosen)


def exceeds(value: float, reference: float) -> bool:
    """Return whether a value is more than a reference but for rounding; any is more than minus infinity."""
    return value > (reference + abs(reference) * ROUNDING if np.isfinite(reference) else reference)


def _nearest(weights: Array, budget: Budget) -> Array:
    # Whole numbers by the method of largest remainders.
    if budget.whole is None:
        text = f"expected whole numbers of readings, got {budget.total:g} and at most {budget.most:g} of each"
        raise UserMistake(text)
    counts = np.minimum(np.floor(weights + ROUNDING), budget.upper)
    remainders = np.where(counts < budget.upper, weights - counts, -np.inf)
    counts[np.argsort(-remainders, kind="stable")[: round(budget.whole - counts.sum())]] += 1.0
    return counts


def _exchanges(chosen: Array, budgets: Sequence[Budget]) -> Iterator[tuple[int, list[int]]]:
    # Readings that may be dropped, with those that may be taken in their place.
    for budget in budgets:
        places = np.array(budget.places)
        substitutes = places[chosen[places] < budget.upper]
        for dropped in places[chosen[places] > 0].tolist():
            yield dropped, [place for place in substitutes.tolist() if place != dropped]


def _exchanged(chosen: Array, dropped: int, taken: int) -> Array:
    counts = chosen.copy()
    counts[dropped] -= 1.0
    counts[taken] += 1.0
    return counts


def _weights(criterion: Criterion, parts: Parts, weights: Array, dual: Array | None = None) -> Weights:
    # Without identifiable parameters, or where only rounding identifies them, no plane bounds the criterion.
    gradient: Array | None = np.zeros((parts.judged,) * 2)
    if criterion.identifiable([parts.root(weights)]):
        with suppress(np.linalg.LinAlgError):
            gradient = criterion.supergradient(parts.information(weights), dual)
    assert gradient is not None
    return Weights(weights, criterion_value(criterion, parts, weights), gradient)


def criterion_value(criterion: Criterion, parts: Parts, weights: Array) -> float:
    """Return the criterion at weights of readings.

    Args:
        criterion: criterion of one block.
        parts: information of the readings.
        weights: weights of the readings, (n,).
    """
    return float(criterion.judge([parts.root(weights)]))
