"""Approximate designs among candidates: the package's interior point against two classical methods."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from benchmarks.figure import Figure, seconds
from oed.kernel.criteria import D
from oed.kernel.parts import Parts, Reading, budgets_of
from oed.optimize.weights import best_weights

CANDIDATES, DEGREE = 2001, 3
"""Settings between -1 and 1, and the degree of the polynomial that is read there."""
GAP = 1e-5
"""Share of the information at which the classical methods may end; the interior point ends far below."""
MOST = 20_000
"""Steps of these methods."""


def figures() -> list[Figure]:
    """Seconds of each classical method, in units of the interior point's."""
    parts = candidates(CANDIDATES)
    rows = parts.rows
    criterion, budgets = D(scaling="none"), budgets_of(parts, 1.0)
    best_weights(criterion, parts, budgets)
    began = time.perf_counter()
    best_weights(criterion, parts, budgets)
    own = time.perf_counter() - began
    found = []
    for name, method in METHODS.items():
        began = time.perf_counter()
        gap = method(rows)
        taken = time.perf_counter() - began
        what = f"D-optimal weights of {CANDIDATES} candidates, cubic regression: interior point"
        against = f"{seconds(taken)} {name}, to a gap of {gap:.1g}"
        found.append(Figure(what, seconds(own), against, taken / own, 1.0, "least"))
    return found


def candidates(count: int) -> Parts:
    """What a polynomial says where it is read at so many settings."""
    return Parts(
        readings=tuple(Reading("y", 0, float(place)) for place in range(count)),
        rows=np.linspace(-1, 1, count)[:, None] ** np.arange(DEGREE + 1),
        places=np.arange(count),
        known_rows=np.zeros((0, DEGREE + 1)),
        judged=DEGREE + 1,
        sizes=np.ones(count),
        members=tuple((place,) for place in range(count)),
    )


def _multiplicative(rows: np.ndarray) -> float:
    # [Titterington, 1976]: every weight times its derivative over the mean one.
    weights = np.full(len(rows), 1 / len(rows))
    gap = np.inf
    for _ in range(MOST):
        derivatives = _derivatives(rows, weights)
        gap = float(derivatives.max() / rows.shape[1] - 1)
        if gap < GAP:
            break
        weights *= derivatives / rows.shape[1]
    return gap


def _vertex_direction(rows: np.ndarray) -> float:
    # [Fedorov, Theory of Optimal Experiments, 1972]: a step to the best candidate, as long as is best.
    size = rows.shape[1]
    weights = np.full(len(rows), 1 / len(rows))
    gap = np.inf
    for _ in range(MOST):
        derivatives = _derivatives(rows, weights)
        best = int(derivatives.argmax())
        gap = float(derivatives[best] / size - 1)
        if gap < GAP:
            break
        step = (derivatives[best] / size - 1) / (derivatives[best] - 1)
        weights *= 1 - step
        weights[best] += step
    return gap


def _derivatives(rows: np.ndarray, weights: np.ndarray) -> np.ndarray:
    inverse = np.linalg.inv(rows.T @ (weights[:, None] * rows))
    return np.einsum("na,ab,nb->n", rows, inverse, rows)


METHODS: dict[str, Callable[[np.ndarray], float]] = {
    "by the multiplicative method": _multiplicative,
    "by vertex directions": _vertex_direction,
}
