"""The sum of several Z that bounds D and A lowest: no step towards another one is lower."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from oed.bounds.conjugate import best_shares
from oed.kernel.criteria import A, Criterion, D

Array = npt.NDArray[np.float64]


def value(kind: str, total: Array) -> float:
    """The bound on the criterion of all F with tr(Z F) at most 1, by NumPy alone."""
    eigenvalues = np.linalg.eigvalsh(total)
    size = len(total)
    return float(
        -np.log(eigenvalues).sum() - size * np.log(size)
        if kind == "D"
        else -(np.sqrt(eigenvalues).sum() ** 2)
    )


def drawn(rng: np.random.Generator) -> Array:
    """Several Z (n, p, p), of one direction or more, of sizes far apart."""
    size, found = int(rng.integers(1, 5)), []
    for _ in range(int(rng.integers(size, size + 4))):
        rows = rng.normal(size=(int(rng.integers(1, size + 1)), size))
        found.append(10.0 ** rng.uniform(-3, 3) * rows.T @ rows)
    found.append(10.0 ** rng.uniform(-3, 3) * np.eye(size))
    return np.stack(found)


@pytest.mark.parametrize("criterion", [D(), A()], ids=lambda one: one.kind)
@pytest.mark.parametrize("seed", range(60))
def test_no_other_sum_is_lower(criterion: Criterion, seed: int) -> None:
    rng = np.random.default_rng(seed)
    matrices = drawn(rng)
    shares = best_shares(criterion, matrices)
    assert shares.min() >= 0
    assert shares.sum() == pytest.approx(1.0)
    best = value(criterion.kind, np.tensordot(shares, matrices, axes=1))
    slack = 1e-9 * (1.0 if criterion.kind == "D" else abs(best))
    others = [*np.eye(len(matrices)), *rng.dirichlet(np.full(len(matrices), 0.5), 50)]
    for other in others:
        for step in (1e-5, 1e-3, 0.1, 0.5):
            total = np.tensordot((1 - step) * shares + step * other, matrices, axes=1)
            assert value(criterion.kind, total) >= best - slack


@pytest.mark.parametrize("criterion", [D(), A()], ids=lambda one: one.kind)
def test_the_slope_is_that_of_differences(criterion: Criterion) -> None:
    rng = np.random.default_rng(3)
    rows, change = rng.normal(size=(5, 3)), rng.normal(size=(3, 3))
    base, change = rows.T @ rows, 1e-6 * (change + change.T)
    slope = criterion.trace_slope(base, 2.0)
    assert slope is not None
    moved = criterion.trace_bound(base + change, 2.0) - criterion.trace_bound(base - change, 2.0)
    assert np.sum(slope * change) == pytest.approx(moved / 2, rel=1e-6)


def test_the_lowest_of_several_bounds_on_one_direction_counts():
    matrices = np.stack([np.diag([1.0, 0.0]), np.diag([3.0, 0.0])])
    np.testing.assert_allclose(best_shares(A(), matrices), [0.0, 1.0], atol=1e-6)
    assert D().trace_bound(np.tensordot(best_shares(D(), matrices), matrices, axes=1), 1.0) == np.inf
