"""Whole readings by branch and bound: the best of all that there are, against trying them all."""

from __future__ import annotations

from itertools import combinations, combinations_with_replacement

import numpy as np
import pytest

from oed.kernel.criteria import A, Criterion, D, E
from oed.kernel.equivalence import weight_bound
from oed.kernel.parts import Parts, Reading, budgets_of
from oed.optimize.exact import exact_weights
from oed.optimize.weights import best_weights, whole_weights

CRITERIA: tuple[Criterion, ...] = (E(scaling="none"), D(scaling="none"), A(scaling="none"))


def regression(rows: np.ndarray) -> Parts:
    """Readings of a linear model."""
    count, size = rows.shape
    return Parts(
        tuple(Reading("y", 0, float(place)) for place in range(count)),
        rows,
        np.arange(count),
        np.zeros((0, size)),
        size,
        np.ones(count),
        tuple((place,) for place in range(count)),
    )


def best(criterion: Criterion, parts: Parts, count: int, *, repeated: bool) -> float:
    """The largest value, of all choices of so many readings."""
    ways = combinations_with_replacement if repeated else combinations
    values = []
    for chosen in ways(range(len(parts.readings)), count):
        weights = np.bincount(chosen, minlength=len(parts.readings)).astype(float)
        matrix = parts.information(weights)
        if np.linalg.matrix_rank(matrix) == len(matrix):
            values.append(float(criterion.value([matrix])))
    return max(values)


@pytest.mark.parametrize("criterion", CRITERIA, ids="EDA")
@pytest.mark.parametrize(("seed", "repeated"), [(8, False), (8, True)])
@pytest.mark.slow
def test_it_is_the_best_of_all(criterion: Criterion, seed: int, *, repeated: bool):
    rng = np.random.default_rng(seed)
    parts, count = regression(rng.normal(size=(8, 3))), 5
    budgets = budgets_of(parts, float(count), most=float(count) if repeated else 1.0)
    near = whole_weights(criterion, parts, best_weights(criterion, parts, budgets).values, budgets)
    found = exact_weights(criterion, parts, near, budgets, nodes=2000)
    known = best(criterion, parts, count, repeated=repeated)
    assert found.weights.value == pytest.approx(known, rel=1e-9)
    assert found.bound == pytest.approx(known, rel=1e-6)
    assert found.weights.values.sum() == count


@pytest.mark.slow
def test_the_bound_holds_wherever_it_ends():
    """With fewer relaxations it is looser, and true."""
    parts, criterion = regression(np.random.default_rng(7).normal(size=(12, 4))), CRITERIA[1]
    budgets = budgets_of(parts, 6.0)
    near = whole_weights(criterion, parts, best_weights(criterion, parts, budgets).values, budgets)
    bounds = [exact_weights(criterion, parts, near, budgets, nodes=count).bound for count in (1, 5, 20, 500)]
    known = best(criterion, parts, 6, repeated=False)
    assert sorted(bounds, reverse=True) == pytest.approx(bounds)
    assert min(bounds) >= known - 1e-9


def test_a_node_whose_relaxed_weights_are_whole_keeps_its_bound(monkeypatch: pytest.MonkeyPatch):
    """A bound 0.5 above these weights leaves room for others that closing the node does not rule out."""
    parts, criterion = regression(np.vstack([10.0 * np.eye(3), np.eye(3)])), CRITERIA[1]
    budgets = budgets_of(parts, 3.0)
    relaxed = best_weights(criterion, parts, budgets)
    near = whole_weights(criterion, parts, relaxed.values, budgets)
    assert relaxed.values == pytest.approx(near.values, abs=1e-6)
    monkeypatch.setattr("oed.optimize.exact.weight_bound", lambda *given: weight_bound(*given) + 0.5)
    found = exact_weights(criterion, parts, near, budgets)
    assert found.bound == pytest.approx(near.value + 0.5, abs=1e-6)
