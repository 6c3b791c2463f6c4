"""Which readings to take, and how often: weights that make a criterion largest, by Ipopt."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.foundation.errors import UserMistake
from oed.foundation.presenting import Brief
from oed.kernel.criteria import Criterion
from oed.kernel.measurement.matrices import eliminate
from oed.kernel.parts import Budget, Parts
from oed.optimize.transcription.program import IPOPT_OPTIONS
from oed.optimize.transcription.solver_calls import interrupts_kept, one_thread

OPTIONS: dict[str, Any] = {**IPOPT_OPTIONS, "ipopt.tol": 1e-11, "ipopt.max_iter": 500}
SLIGHT = 1e-9
"""Gain of an exchange, relative to the criterion, that is rounding."""


@dataclass(frozen=True, repr=False)
class Weights(Brief):
    """Weights of readings.

    Attributes:
        values: of each, (n,).
        value: of the criterion.
        gradient: a supergradient of the criterion there, of many the one that bounds all weights best.
    """

    values: Array
    value: float
    gradient: Array


def best_weights(criterion: Criterion, parts: Parts, budgets: Sequence[Budget]) -> Weights:
    """The weights within budgets that make a concave criterion largest.

    Args:
        criterion: with a supergradient, of one block.
        parts: of the information.
        budgets: of all readings.

    Raises:
        UserMistake: a criterion that is not concave.
    """
    even, most = np.empty((2, len(parts.readings)))
    for one in budgets:
        even[list(one.places)], most[list(one.places)] = one.even, one.most
    if criterion.supergradient(parts.information(even)) is None:
        text = f"{criterion.kind} is not concave: nothing says how good weights can be"
        raise UserMistake(f"{text}; use E, D or A")
    # In units in which the information is of order 1.
    size = float(np.trace(parts.information(even))) / parts.judged
    scaled = replace(parts, matrices=parts.matrices / size, known=parts.known / size)
    found, multipliers = _solved(criterion, scaled, budgets, even, most)
    chosen = np.clip(found, 0.0, most)
    for one in budgets:
        chosen[list(one.places)] *= one.total / chosen[list(one.places)].sum()
    columns, rows = np.triu_indices(parts.judged)
    dual = np.zeros((parts.judged,) * 2)
    dual[rows, columns] = multipliers[: len(rows)]
    return _weights(criterion, parts, chosen, (dual + dual.T) / 2)


def _solved(
    criterion: Criterion, parts: Parts, budgets: Sequence[Budget], even: Array, most: Array
) -> tuple[Array, Array]:
    # The weights, and the multipliers of the criterion's equalities.
    weights, size = ca.SX.sym("w", len(even)), len(parts.known)
    flat = ca.DM(parts.matrices.reshape(len(even), -1).T) @ weights
    whole = ca.reshape(flat, size, size) + ca.DM(parts.known)
    epigraph = criterion.epigraph([eliminate(whole, parts.judged)])
    spent = [ca.sum1(weights[list(one.places)]) - one.total for one in budgets]
    program = {
        "x": ca.vertcat(weights, epigraph.variables),
        "f": -epigraph.objective,
        "g": ca.vertcat(*spent, epigraph.equalities),
    }
    further = epigraph.initial([parts.information(even)])
    open_ends = np.full(len(further), np.inf)
    solver = ca.nlpsol("weights", "ipopt", program, OPTIONS)
    with interrupts_kept(), one_thread():
        found = solver(
            x0=np.concatenate([even, further]),
            lbx=np.concatenate([np.zeros(len(even)), -open_ends]),
            ubx=np.concatenate([most, open_ends]),
            lbg=0.0,
            ubg=0.0,
        )
    return np.array(found["x"]).ravel()[: len(even)], np.array(found["lam_g"]).ravel()[len(budgets) :]


def rounded(criterion: Criterion, parts: Parts, weights: Array, count: int) -> Weights:
    """So many whole readings: those of the largest weights, exchanged one by one while that is better.

    Args:
        criterion: to be large.
        parts: of the information.
        weights: of a relaxed choice, (n,).
        count: of readings that are taken, once each.
    """
    chosen = np.zeros(len(weights))
    chosen[np.argsort(-weights, kind="stable")[:count]] = 1.0
    value, better = _value(criterion, parts, chosen), True
    while better:
        better = False
        for given_up in np.flatnonzero(chosen).tolist():
            others = np.flatnonzero(chosen == 0).tolist()
            values = [_value(criterion, parts, _exchanged(chosen, given_up, one)) for one in others]
            if values and max(values) > value + abs(value) * SLIGHT:
                chosen = _exchanged(chosen, given_up, others[int(np.argmax(values))])
                value, better = max(values), True
    return _weights(criterion, parts, chosen)


def _exchanged(chosen: Array, given_up: int, taken: int) -> Array:
    found = chosen.copy()
    found[[given_up, taken]] = 0.0, 1.0
    return found


def _weights(criterion: Criterion, parts: Parts, weights: Array, dual: Array | None = None) -> Weights:
    gradient = criterion.supergradient(parts.information(weights), dual)
    assert gradient is not None
    return Weights(weights, _value(criterion, parts, weights), gradient)


def _value(criterion: Criterion, parts: Parts, weights: Array) -> float:
    return float(criterion.value([parts.information(weights)]))
