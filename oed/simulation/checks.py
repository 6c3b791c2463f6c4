"""Statistical tests of a predicted covariance against simulated estimates (STATISTICS: bias, size, shape).

What they need of the errors is summed as these come: memory does not grow with the replicates.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from oed.foundation.arrays import Array, Places

COVERAGE = 0.95
"""Of the ellipsoids that are counted: the confidence that estimates are given with."""
KEPT = 2**20
"""Values kept, 8 MB, for their exact distance from the uniform distribution; more are counted in bins."""


@dataclass
class Moments:
    """Mean and scatter of rows (p,), summed part by part [Chan, Golub and LeVeque, 1983].

    Attributes:
        count: of rows.
        mean: (p,).
        scatter: sum of the outer products of the rows less their mean, (p, p).
    """

    count: int
    mean: Array
    scatter: Array

    @classmethod
    def of(cls, rows: Array) -> Moments:
        """Those of rows (R, p)."""
        mean = rows.mean(axis=0)
        around = rows - mean
        return cls(len(rows), mean, around.T @ around)

    def add(self, other: Moments) -> None:
        """Take in further rows."""
        total = self.count + other.count
        step = other.mean - self.mean
        self.scatter = self.scatter + other.scatter
        self.scatter += np.outer(step, step) * (self.count * other.count / total)
        self.mean = self.mean + step * (other.count / total)
        self.count = total

    @property
    def covariance(self) -> Array:
        """Unbiased, (p, p)."""
        return np.asarray(self.scatter / (self.count - 1))


@dataclass
class Levels:
    """Values between 0 and 1, for their largest distance from the uniform distribution.

    Exact for up to `KEPT` values; of more, their distribution is compared at `KEPT` evenly spaced points,
    which can miss 1 / KEPT of the distance at most.

    Attributes:
        count: of values.
        kept: the values; empty once they are binned.
        bins: how many fall in each of `KEPT` bins, once there are too many.
    """

    count: int
    kept: list[Array]
    bins: Places | None = None

    @classmethod
    def of(cls, values: Array) -> Levels:
        """Those of values (R,)."""
        found = cls(len(values), [values])
        found._bound()
        return found

    def add(self, other: Levels) -> None:
        """Take in further values."""
        self.count += other.count
        self.kept = self.kept + other.kept
        if other.bins is not None:
            self.bins = other.bins + (0 if self.bins is None else self.bins)
        self._bound()

    def _bound(self) -> None:
        if self.bins is None and self.count <= KEPT:
            return
        if self.bins is None:
            self.bins = np.zeros(KEPT, dtype=np.int64)
        places = np.concatenate([np.zeros(0), *self.kept]) * KEPT
        np.add.at(self.bins, np.minimum(places, KEPT - 1).astype(np.int64), 1)
        self.kept = []

    @property
    def distance(self) -> float:
        """Kolmogorov-Smirnov statistic."""
        if self.bins is not None:
            points = np.arange(1, KEPT + 1) / KEPT
            return float(np.abs(np.cumsum(self.bins) / self.count - points).max())
        ordered, ranks = np.sort(np.concatenate(self.kept)), np.arange(self.count)
        above, below = (ranks + 1) / self.count - ordered, ordered - ranks / self.count
        return float(max(above.max(), below.max()))


@dataclass
class Tally:
    """Errors seen against their predicted covariance.

    Attributes:
        whitened: moments of L^-1 e with L L' the covariance: zero and identity if it is right.
        nees: sum of the normalised squared errors e' C^-1 e.
        inside: errors inside the 95 % ellipsoid.
        levels: chi2_p distribution function of the normalised squared errors.
    """

    whitened: Moments
    nees: float
    inside: int
    levels: Levels

    @classmethod
    def of(cls, errors: Array, covariance: Array) -> Tally:
        """That of errors (R, p) and the covariance (p, p) predicted of them."""
        whitened = np.linalg.solve(np.linalg.cholesky(covariance), errors.T).T
        nees = np.einsum("ij,ij->i", whitened, whitened)
        size = errors.shape[1]
        inside = int(np.count_nonzero(nees <= scipy.special.chdtri(size, 1 - COVERAGE)))
        return cls(
            Moments.of(whitened), float(nees.sum()), inside, Levels.of(scipy.special.chdtr(size, nees))
        )

    def add(self, other: Tally) -> None:
        """Take in further errors."""
        self.whitened.add(other.whitened)
        self.nees += other.nees
        self.inside += other.inside
        self.levels.add(other.levels)

    @property
    def count(self) -> int:
        """Replicates, R."""
        return self.whitened.count

    @property
    def size(self) -> int:
        """Parameters, p."""
        return len(self.whitened.mean)


@dataclass(frozen=True)
class Check:
    """One test: what it looks at, its statistic with the range expected, its p-value, and whether it passed.

    `passed` is judged for all tests together (Holm), so that no single one alone decides too often.
    """

    name: str
    question: str
    statistic: float
    expected: tuple[float, float]
    p_value: float
    passed: bool = True


def check_tally(tally: Tally, alpha: float) -> tuple[Check, ...]:
    """All tests of tallied errors, at joint level `alpha`."""
    tests = (bias, likelihood_ratio, mean_nees, extreme_eigenvalues, coverage, nees_distribution)
    return holm([test(tally, alpha) for test in tests], alpha)


def bias(tally: Tally, alpha: float) -> Check:
    """R zbar'zbar against chi2_p: is the mean estimate the truth?"""
    mean, size = tally.whitened.mean, tally.size
    statistic = float(tally.count * mean @ mean)
    expected = (0.0, float(scipy.stats.chi2.ppf(1 - alpha, size)))
    p_value = float(scipy.stats.chi2.sf(statistic, size))
    return Check("bias", "is the mean estimate the truth?", statistic, expected, p_value)


def likelihood_ratio(tally: Tally, alpha: float) -> Check:
    """Bartlett-corrected likelihood ratio of the covariance against chi2_{p(p+1)/2}."""
    nu, size, sample = tally.count - 1, tally.size, tally.whitened.covariance
    _, logdet = np.linalg.slogdet(sample)
    raw = nu * (np.trace(sample) - logdet - size)
    statistic = float(raw * (1 - (2 * size + 1 - 2 / (size + 1)) / (6 * nu - 1)))
    degrees = size * (size + 1) / 2
    expected = (0.0, float(scipy.stats.chi2.ppf(1 - alpha, degrees)))
    p_value = float(scipy.stats.chi2.sf(statistic, degrees))
    return Check("covariance", "are size and shape of the covariance right?", statistic, expected, p_value)


def mean_nees(tally: Tally, alpha: float) -> Check:
    """Mean normalised squared error against its two-sided chi2 interval."""
    degrees, total = tally.count * tally.size, tally.nees
    low, high = (
        float(value) / degrees for value in scipy.stats.chi2.ppf([alpha / 2, 1 - alpha / 2], degrees)
    )
    p_value = 2 * min(float(scipy.stats.chi2.cdf(total, degrees)), float(scipy.stats.chi2.sf(total, degrees)))
    return Check("NEES", "is the variance right on average?", total / degrees, (low, high), min(1.0, p_value))


def extreme_eigenvalues(tally: Tally, alpha: float) -> Check:
    """The whitened sample covariance's eigenvalue farthest from 1, against a concentration bound."""
    nu, size = tally.count - 1, tally.size
    values = np.linalg.eigvalsh(tally.whitened.covariance)
    roots = np.sqrt(values)
    farthest = int(np.argmax(np.abs(roots - 1.0)))
    reach = (math.sqrt(size) + math.sqrt(2 * math.log(2 / alpha))) / math.sqrt(nu)
    excess = max(0.0, abs(float(roots[farthest]) - 1.0) * math.sqrt(nu) - math.sqrt(size))
    p_value = min(1.0, 2 * math.exp(-(excess**2) / 2))
    expected = (max(0.0, 1 - reach) ** 2, (1 + reach) ** 2)
    question = "is the variance right in every direction?"
    return Check("eigenvalues", question, float(values[farthest]), expected, p_value)


def coverage(tally: Tally, alpha: float) -> Check:
    """Share of estimates inside the 95 % ellipsoid, by the exact binomial test."""
    test = scipy.stats.binomtest(tally.inside, tally.count, COVERAGE)
    bounds = scipy.stats.binom.ppf([alpha / 2, 1 - alpha / 2], tally.count, COVERAGE)
    low, high = (float(value) / tally.count for value in bounds)
    question = "does the 95 % ellipse hold 95 % of the estimates?"
    return Check("coverage", question, tally.inside / tally.count, (low, high), float(test.pvalue))


def nees_distribution(tally: Tally, alpha: float) -> Check:
    """Kolmogorov-Smirnov distance of the normalised squared errors from chi2_p."""
    statistic = tally.levels.distance
    limit = float(scipy.stats.kstwo.ppf(1 - alpha, tally.count))
    question = "are the errors normal, as intervals assume?"
    p_value = float(scipy.stats.kstwo.sf(statistic, tally.count))
    return Check("distribution", question, statistic, (0.0, limit), p_value)


def holm(checks: Sequence[Check], alpha: float) -> tuple[Check, ...]:
    """The checks with `passed` set: together they fail wrongly at most so often as `alpha` [Holm, 1979]."""
    order = sorted(range(len(checks)), key=lambda index: checks[index].p_value)
    failed: set[int] = set()
    for rank, index in enumerate(order):
        if checks[index].p_value > alpha / (len(checks) - rank):
            break
        failed.add(index)
    return tuple(replace(check, passed=index not in failed) for index, check in enumerate(checks))
