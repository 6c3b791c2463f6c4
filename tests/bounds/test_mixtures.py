"""Best mixtures of experiments, proved by their own multipliers in NumPy, and bounds from multipliers."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from oed.bounds.certificate import INFLATION, gap, inflate
from oed.bounds.mixtures import best_mixture
from oed.kernel.criteria import A, Criterion, D, E, ModifiedE

Array = npt.NDArray[np.float64]

CRITERIA: tuple[Criterion, ...] = (D(), A(), E())


def value(kind: str, matrix: Array) -> float:
    """The criterion, without the package."""
    if kind == "D":
        return float(np.linalg.slogdet(matrix)[1])
    return float(-np.trace(np.linalg.inv(matrix)) if kind == "A" else np.linalg.eigvalsh(matrix)[0])


def left(whole: Array, judged: int) -> Array:
    """The others eliminated, without the package."""
    return np.linalg.inv(np.linalg.inv(whole)[:judged, :judged])


def positive(rng: np.random.Generator, size: int) -> Array:
    rows = rng.normal(size=(size + 2, size)) * 10.0 ** rng.uniform(-2, 2, size)
    return rows.T @ rows


@pytest.mark.parametrize("criterion", CRITERIA, ids=lambda one: one.kind)
@pytest.mark.parametrize("seed", range(6))
def test_a_multiplier_bounds_every_matrix(criterion: Criterion, seed: int) -> None:
    rng = np.random.default_rng(seed)
    size = int(rng.integers(1, 6))
    base = positive(rng, size)
    gradient = criterion.supergradient(base)
    assert gradient is not None
    # It touches where it is the supergradient, whatever its size.
    here = criterion.trace_bound(3 * gradient, 3 * float(np.trace(gradient @ base)))
    assert here == pytest.approx(value(criterion.kind, base), rel=1e-6)
    for _ in range(200):
        other, multiplier = positive(rng, size), positive(rng, size)
        most = criterion.trace_bound(multiplier, float(np.trace(multiplier @ other)))
        found = value(criterion.kind, other)
        assert found <= most + 1e-9 * abs(found)


def test_other_criteria_have_none() -> None:
    assert ModifiedE().trace_bound(np.eye(2), 1.0) == np.inf
    assert not ModifiedE().conjugate
    assert D().trace_bound(np.diag([1.0, 0.0]), 1.0) == np.inf
    assert D().trace_bound(np.eye(2), 0.0) == A().trace_bound(np.eye(2), 0.0) == -np.inf


@pytest.mark.parametrize("criterion", CRITERIA, ids=lambda one: one.kind)
@pytest.mark.parametrize("seed", range(8))
def test_no_mixture_is_better(criterion: Criterion, seed: int) -> None:
    rng = np.random.default_rng(seed)
    size = int(rng.integers(2, 6))
    judged, count = int(rng.integers(1, size + 1)), int(rng.integers(2 * size, 40))
    rows = rng.normal(size=(count, size)) * 10.0 ** rng.uniform(-2, 2, size)
    matrices = np.einsum("ka,kb->kab", rows, rows)
    known = positive(rng, size) if seed % 2 else np.zeros((size, size))
    groups = np.arange(count) % 2
    totals = np.array([3.0, 7.0])
    known_rows = np.linalg.cholesky(known).T if known.any() else known
    found = best_mixture(criterion, list(rows[:, None]), known_rows, judged, groups, totals)
    assert found is not None
    assert np.all(found.weights >= 0)
    np.testing.assert_allclose(np.bincount(groups, found.weights), totals, rtol=1e-9)
    reached = value(criterion.kind, left(known + np.tensordot(found.weights, matrices, 1), judged))
    assert reached == pytest.approx(found.value, rel=1e-6)
    # The most that any other mixture has of tr(Z M).
    gains = np.einsum("ab,kba->k", found.multiplier, matrices)
    most = np.sum(found.multiplier * known) + sum(
        total * gains[groups == group].max() for group, total in enumerate(totals)
    )
    upper = criterion.trace_bound(found.multiplier[:judged, :judged], float(most))
    assert -1e-9 < criterion.change(upper, reached, judged) < 1e-6
    for _ in range(100):
        shares = np.zeros(count)
        for group, total in enumerate(totals):
            own = np.flatnonzero(groups == group)
            shares[own] = total * rng.dirichlet(np.full(len(own), 0.3))
        whole = known + np.tensordot(shares, matrices, 1)
        if np.linalg.cond(whole) < 1e12:
            assert value(criterion.kind, left(whole, judged)) <= upper + 1e-6 * abs(upper)


def test_mixtures_that_identify_too_little_are_none() -> None:
    row, nothing = np.array([[1.0, 0.0]]), np.zeros((0, 2))
    assert best_mixture(D(), [row], nothing, 2, np.zeros(1, dtype=int), np.ones(1)) is None


def test_gaps_are_in_efficiency() -> None:
    assert gap(2.2, 2.0) == pytest.approx(0.1)
    assert gap(-2.0, -2.2, A(), 3) == pytest.approx(0.1)
    assert gap(1.0, 1.0 - 3 * np.log(1.1), D(), 3) == pytest.approx(0.1)
    assert gap(-5.0, -5.0 - 3 * np.log(1.1), D(), 3) == pytest.approx(0.1)
    for criterion in (D(), A()):
        assert gap(1.0, -np.inf, criterion, 2) == np.inf
        assert gap(np.inf, -1.0, criterion, 2) == np.inf


@pytest.mark.parametrize("criterion", CRITERIA, ids=lambda one: one.kind)
def test_bounds_are_raised_whatever_their_sign(criterion: Criterion) -> None:
    for number in (-1e6, -2.0, -1e-9, 1e-9, 3.0, 1e6):
        # The value of so much more information in every direction.
        more = 3 * np.log1p(INFLATION) if criterion.kind == "D" else INFLATION * abs(number)
        assert inflate(number, criterion, 3) > number
        assert inflate(number, criterion, 3) - number == pytest.approx(more, rel=1e-3, abs=1e-10)
    assert inflate(-np.inf, criterion, 3) == -np.inf
