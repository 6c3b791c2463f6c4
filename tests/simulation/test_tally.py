"""Sums taken part by part are those of all rows at once."""

from __future__ import annotations

import math

import numpy as np
import pytest
from builders import check_all
from scipy import stats

from oed.simulation.checks import Levels, Moments, Tally, check_tally

PARTS = (1, 700, 1299)


def rows(size: int = 3) -> np.ndarray:
    """Errors with a mean that hides cancellation, (2000, size)."""
    return 1e3 + np.random.default_rng(0).standard_normal((sum(PARTS), size)) @ np.triu(np.ones((size, size)))


def parts(values: np.ndarray) -> list[np.ndarray]:
    return np.split(values, np.cumsum(PARTS)[:-1])


def test_moments():
    found, *others = [Moments.of(part) for part in parts(rows())]
    for other in others:
        found.add(other)
    assert found.count == sum(PARTS)
    np.testing.assert_allclose(found.mean, rows().mean(axis=0), rtol=1e-14)
    np.testing.assert_allclose(found.covariance, np.cov(rows(), rowvar=False), rtol=1e-10)


@pytest.mark.parametrize("kept", [10**6, 1500, 10])
def test_distance(monkeypatch: pytest.MonkeyPatch, kept: int):
    # Of values that are not uniform, so that the largest distance is somewhere inside.
    monkeypatch.setattr("oed.simulation.checks.KEPT", kept)
    values = np.random.default_rng(1).uniform(size=sum(PARTS)) ** 1.2
    found, *others = [Levels.of(part) for part in parts(values)]
    for other in others:
        found.add(other)
    exact = stats.kstest(values, "uniform").statistic
    if len(values) <= kept:
        assert found.distance == pytest.approx(exact, rel=1e-13)
    else:
        assert exact - 1 / kept <= found.distance <= exact
        assert not found.kept
        assert found.bins is not None
        assert (len(found.bins), found.bins.sum()) == (kept, len(values))


def test_the_ends_of_the_last_bin(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("oed.simulation.checks.KEPT", 4)
    found = Levels.of(np.array([0.0, 0.1, 0.3, 0.99, 1.0]))
    assert found.bins is not None
    assert found.bins.tolist() == [2, 1, 0, 2]


def test_checks_are_those_of_all_errors_at_once():
    covariance = np.diag([4.0, 9.0, 1.0])
    errors = np.random.default_rng(2).standard_normal((sum(PARTS), 3)) * [2, 3, 1]
    found, *others = [Tally.of(part, covariance) for part in parts(errors)]
    for other in others:
        found.add(other)
    assert (found.count, found.size) == (sum(PARTS), 3)
    for one, other in zip(check_tally(found, 0.01), check_all(errors, covariance, 0.01), strict=True):
        assert one.statistic == pytest.approx(other.statistic, rel=1e-9)
        assert (one.name, one.passed) == (other.name, other.passed)


def test_the_distribution_is_scipys():
    errors = np.random.default_rng(3).standard_normal((500, 2))
    check = check_all(errors, np.eye(2), 0.01)[-1]
    expected = stats.kstest(np.sum(errors**2, axis=1), stats.chi2(2).cdf)
    assert check.statistic == pytest.approx(expected.statistic, rel=1e-12)
    assert check.p_value == pytest.approx(expected.pvalue, rel=1e-9)
    assert math.isfinite(check.expected[1])
