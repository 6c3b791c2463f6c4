"""Which readings to take, and how often: weights that make a criterion largest, by Ipopt."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from oed.foundation.arguments import typed
from oed.foundation.arrays import Array, Places
from oed.foundation.equality import ByValue
from oed.foundation.errors import UserMistake
from oed.foundation.presenting import Brief
from oed.kernel.criteria import Criterion
from oed.kernel.equivalence import weight_bound
from oed.kernel.measurement.matrices import eliminate
from oed.kernel.parts import Budget, Cost, Parts
from oed.kernel.repetitions import spent_at_most
from oed.optimize.transcription.program import IPOPT_OPTIONS
from oed.optimize.transcription.solver_calls import interrupts_kept, one_thread

OPTIONS: dict[str, Any] = {**IPOPT_OPTIONS, "ipopt.tol": 1e-11, "ipopt.max_iter": 500}
"""Weights are mostly found in some twenty iterations, to a share of the criterion far below what matters."""
FAINT = 1e-14
"""Share of the largest eigenvalue of information below which a smaller one may be rounding."""
CLOSE = 1e-8
"""Share of the criterion by which its bound may exceed the weights found: further ones are not looked for."""
SLIGHT = 1e-9
"""Gain of an exchange, relative to the criterion, that is rounding."""


@dataclass(frozen=True, repr=False, eq=False)
class Weights(ByValue, Brief):
    """Weights of readings.

    Attributes:
        values: of each, (n,).
        value: of the criterion.
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
    """The weights within budgets that make a concave criterion largest.

    Args:
        criterion: concave, of one block: the `objective` of a problem.
        parts: of the information.
        budgets: of all readings; spent in full, unless there are costs.
        costs: that the weights may not exceed.

    Raises:
        UserMistake: a criterion that is not concave.
    """
    even, most = np.empty((2, len(parts.readings)))
    for one in budgets:
        most[list(one.places)] = one.upper
        even[list(one.places)] = one.even * one.upper
    if not criterion.concave:
        text = f"{criterion.kind} is not concave: nothing says how good weights can be"
        raise UserMistake(f"{text}; use E, D, A, G or I")
    limits = _Limits(budgets, costs, spent_at_most(costs, even), most)
    best = _weights(criterion, parts, limits.even)
    for units in _units(criterion, parts, limits.even):
        found = _found(criterion, parts, units, limits)
        best = found if found.value > best.value else best
        bound = weight_bound(criterion, parts, best.values, best.gradient, budgets, costs)
        if not exceeds(bound, best.value, CLOSE):
            break
    return best


@dataclass(frozen=True)
class _Limits:
    # What weights keep to, with even weights that do, and the most of each.
    budgets: Sequence[Budget]
    costs: Sequence[Cost]
    even: Array
    most: Array

    def kept(self, weights: Array) -> Array:
        """Return the nearest weights (n,) that keep to all limits, up to one share of each budget."""
        chosen = np.clip(weights, 0.0, self.most)
        for budget in self.budgets:
            if not self.costs or budget.spent(chosen) > budget.total:
                chosen[list(budget.places)] = _spending(budget, chosen)
        return spent_at_most(self.costs, chosen)

    def rows(self, weights: ca.SX) -> tuple[list[ca.SX], list[float]]:
        """Return rows that are at most 0, and the least that each may be."""
        rows = [
            ca.dot(ca.DM(budget.sizes), weights[list(budget.places)]) - budget.total
            for budget in self.budgets
        ]
        # Whoever may not pay for more than some of a budget leaves the rest.
        least = [-np.inf if self.costs else 0.0] * len(rows)
        rows += [ca.dot(ca.DM(cost.sizes), weights) - cost.most for cost in self.costs]
        return rows, [*least, *[-np.inf] * len(self.costs)]


def _found(criterion: Criterion, parts: Parts, units: Array, limits: _Limits) -> Weights:
    # With combinations of the judged parameters in place of these.
    searched = criterion.in_units(units) or criterion
    found, multipliers = _solved(searched, _scaled(parts, limits.even, units), limits)
    chosen, budgets, costs = limits.kept(found), limits.budgets, limits.costs
    columns, rows = np.triu_indices(parts.judged)
    dual = np.zeros((parts.judged,) * 2)
    dual[rows, columns] = multipliers[: len(rows)]
    # Multipliers of a search that has not converged bound less than the weights' own plane does.
    both = [_weights(criterion, parts, chosen, one) for one in (units @ (dual + dual.T) @ units.T, None)]
    return min(both, key=lambda one: weight_bound(criterion, parts, one.values, one.gradient, budgets, costs))


def _spending(budget: Budget, weights: Array) -> Array:
    # Its weights, all lowered or raised by one share until they are all that may be spent.
    own, spare = weights[list(budget.places)], budget.total - budget.spent(weights)
    if spare <= 0:
        return np.asarray(own * (budget.total / budget.spent(weights)))
    room = budget.upper - own
    left = float(np.array(budget.sizes) @ room)
    return np.asarray(own + room * min(spare / left, 1.0)) if left > 0 else own


def _solved(criterion: Criterion, parts: Parts, limits: _Limits) -> tuple[Array, Array]:
    # The weights, and the multipliers of the criterion's equalities.
    even = limits.even
    weights = ca.SX.sym("w", len(even))
    # The information has unknowns of its own: only they are curved, and they are few.
    entries = _present(parts)
    summed = ca.SX.sym("F", len(entries[0]))
    whole = ca.SX(*parts.known.shape)
    for place, (row, column) in enumerate(zip(*entries, strict=True)):
        whole[int(row), int(column)] = whole[int(column), int(row)] = summed[place]
    epigraph = criterion.epigraph([eliminate(whole, parts.judged)])
    linear, least = limits.rows(weights)
    count = len(linear) + len(entries[0])
    linear.append(ca.DM(parts.matrices[:, *entries].T) @ weights + ca.DM(parts.known[entries]) - summed)
    program = {
        "x": ca.vertcat(weights, summed, epigraph.variables),
        "f": -epigraph.objective,
        "g": ca.vertcat(*linear, epigraph.equalities),
    }
    further = np.concatenate([parts.whole(even)[entries], epigraph.initial([parts.information(even)])])
    open_ends = np.full(len(further), np.inf)
    solver = ca.nlpsol("weights", "ipopt", program, OPTIONS)
    with interrupts_kept(), one_thread():
        found = solver(
            x0=np.concatenate([even, further]),
            lbx=np.concatenate([np.zeros(len(even)), -open_ends]),
            ubx=np.concatenate([limits.most, open_ends]),
            lbg=np.concatenate([least, np.zeros(program["g"].shape[0] - len(least))]),
            ubg=0.0,
        )
    multipliers = np.array(found["lam_g"]).ravel()[count:]
    return np.array(found["x"]).ravel()[: len(even)], multipliers


def _units(criterion: Criterion, parts: Parts, even: Array) -> list[Array]:
    # Of the judged parameters, as columns: where these are of no matter, each with its own; and combinations
    # of them that even weights tell apart, all equally well. Else one for all, by the least information,
    # which a solver's tolerance would hide beside the largest; and by information as it is, where a solver
    # goes astray among large numbers.
    information, root, same = parts.information(even), parts.root(even), np.eye(parts.judged)
    own, values = np.diag(information), np.linalg.eigvalsh(information)
    sizes = max(float(values[0]), FAINT * float(values[-1])), float(np.mean(values))
    found = [same * size**-0.5 for size in sizes if size > 0] or [same]
    if criterion.in_units(same) is None:
        return found
    each = np.diag(np.where(own > 0, own, 1.0) ** -0.5)
    return [each, *([root.factor] if root.complete else []), *found]


def _scaled(parts: Parts, weights: Array, units: Array) -> Parts:
    # What is eliminated has units of its own.
    own = np.diag(parts.whole(weights))[parts.judged :]
    others = np.where(own > 0, own, 1.0) ** -0.5
    return parts.combined(units, others)


def _present(parts: Parts) -> tuple[Places, Places]:
    # Rows and columns of the entries of F's upper half that some reading, or what is known, may have.
    size = len(parts.known)
    some = (parts.known != 0) | (parts.matrices != 0).any(axis=0)
    judged = np.arange(size) < parts.judged
    rows, columns = np.nonzero(np.triu(some | np.eye(size, dtype=bool) | np.outer(judged, judged)))
    return rows, columns


@typed
def whole_weights(criterion: Criterion, parts: Parts, weights: Array, budgets: Sequence[Budget]) -> Weights:
    """Whole readings within budgets: as near to weights as whole numbers are, then exchanged one by one while
    that is better. `weight_bound` judges them.

    Args:
        criterion: to be large, concave.
        parts: of the information.
        weights: of a relaxed choice, (n,).
        budgets: of all readings, with totals of whole ones.

    Raises:
        UserMistake: a total that is not so many whole ones.
    """
    chosen = np.zeros(len(weights))
    for one in budgets:
        chosen[list(one.places)] = _nearest(weights[list(one.places)], one)
    return exchanged_weights(criterion, parts, chosen, budgets)


def exchanged_weights(
    criterion: Criterion, parts: Parts, weights: Array, budgets: Sequence[Budget]
) -> Weights:
    """Whole readings exchanged one by one while that is better.

    Args:
        criterion: to be large, concave.
        parts: of the information.
        weights: whole ones within the budgets, (n,).
        budgets: of all readings.
    """
    chosen = weights
    value, better = _value(criterion, parts, chosen), True
    while better:
        better = False
        for given_up, others in _exchanges(chosen, budgets):
            trials = [_exchanged(chosen, given_up, one) for one in others]
            values = [_value(criterion, parts, trial) for trial in trials]
            if values and exceeds(max(values), value, SLIGHT):
                chosen, value, better = trials[int(np.argmax(values))], max(values), True
                break
    return _weights(criterion, parts, chosen)


def exceeds(value: float, known: float, share: float) -> bool:
    """Whether a value is more than a known one by a share of it; any is more than minus infinity.

    Args:
        value: of a criterion.
        known: what it is compared with.
        share: of the size of that.
    """
    return value > (known + abs(known) * share if np.isfinite(known) else known)


def _nearest(weights: Array, budget: Budget) -> Array:
    # Largest remainders.
    if budget.whole is None:
        text = f"expected whole numbers of readings, got {budget.total:g} and at most {budget.most:g} of each"
        raise UserMistake(text)
    found = np.minimum(np.floor(weights + SLIGHT), budget.most)
    left = np.where(found < budget.most, weights - found, -np.inf)
    found[np.argsort(-left, kind="stable")[: round(budget.whole - found.sum())]] += 1.0
    return found


def _exchanges(chosen: Array, budgets: Sequence[Budget]) -> Iterator[tuple[int, list[int]]]:
    # Readings that may be given up for others.
    for one in budgets:
        places = np.array(one.places)
        others = places[chosen[places] < one.most]
        for given_up in places[chosen[places] > 0].tolist():
            yield given_up, [place for place in others.tolist() if place != given_up]


def _exchanged(chosen: Array, given_up: int, taken: int) -> Array:
    found = chosen.copy()
    found[given_up] -= 1.0
    found[taken] += 1.0
    return found


def _weights(criterion: Criterion, parts: Parts, weights: Array, dual: Array | None = None) -> Weights:
    # What is not identifiable, or by rounding only, has no plane that bounds it.
    gradient: Array | None = np.zeros((parts.judged,) * 2)
    if criterion.identifiable([parts.root(weights)]):
        with suppress(np.linalg.LinAlgError):
            gradient = criterion.supergradient(parts.information(weights), dual)
    assert gradient is not None
    return Weights(weights, _value(criterion, parts, weights), gradient)


def _value(criterion: Criterion, parts: Parts, weights: Array) -> float:
    return float(criterion.judge([parts.root(weights)]))
