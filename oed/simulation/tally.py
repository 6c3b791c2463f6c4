"""What tests need of simulated errors, summed as they come: memory does not grow with the replicates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy

Array = npt.NDArray[np.float64]

COVERAGE = 0.95
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
    bins: npt.NDArray[np.int64] | None = None

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
