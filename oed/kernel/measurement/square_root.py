"""Information by its square root: which combinations of parameters are identifiable, and how precisely.

F = R'R, where R is what elimination leaves of the whitened Jacobian. Squaring a Jacobian loses half of all
digits; R keeps them, so that what is identifiable is told from rounding on the Jacobian's own scale: with
every column taken as a unit vector.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from oed.foundation.arrays import Array, Bools

ULPS = 8.0
"""Units in the last place by which each row of a Jacobian may be off."""
SQUARED = 1e-12
"""Share of its diagonal by which an information matrix, squared and perhaps eliminated, may be off."""
TOUCHED = 1e-6
"""Share of a combination that lies along what is not identifiable, from which on it is not identifiable."""


def rounding_of(rows: Array) -> float:
    """Return the length that rounding may give a combination of unit columns of a Jacobian (k, n)."""
    return float(ULPS * np.finfo(float).eps * max(rows.shape))


def reduced(rows: Array) -> Array:
    """Return at most n rows with the same square as these (k, n)."""
    return rows if len(rows) <= rows.shape[1] else np.asarray(np.linalg.qr(rows, mode="r"))


def project_out(rows: Array, width: int, rounding: float) -> tuple[Array, float]:
    """Return the first `width` columns of a Jacobian (k, n) less what the others explain, (k, width).

    The rows remain when the others are unknown as well. Also return the length that rounding alone may then
    give a combination of unit columns.

    Args:
        rows: the Jacobian.
        width: columns.
        rounding: rounding of unit columns of the Jacobian.
    """
    wanted, nuisances = rows[:, :width], rows[:, width:]
    sizes = np.linalg.norm(nuisances, axis=0)
    nuisances = nuisances[:, sizes > 0] / sizes[sizes > 0]
    if not nuisances.shape[1]:
        return wanted, rounding
    basis, lengths, _ = np.linalg.svd(nuisances, full_matrices=False)
    identifiable = lengths > rounding
    basis, lengths = basis[:, identifiable], lengths[identifiable]
    shares = basis.T @ wanted
    # What rounding does to the others' columns goes into what is left, times what was taken of them.
    taken = np.linalg.norm(shares / lengths[:, None], axis=0) / _divisors(np.linalg.norm(wanted, axis=0))
    return wanted - basis @ shares, rounding * (1.0 + float(taken.max()))


@dataclass(frozen=True)
class SquareRoot:
    """Information F = C V diag(s^2) V' C on parameters; stacks of them along the leading axes.

    Attributes:
        sizes: C (..., p): information's square root on each parameter alone, were all else known.
        lengths: s (..., p), descending: at most sqrt(p).
        directions: V (..., p, p): combinations of the parameters, in units of 1 / C, as columns.
        rounding: the largest s that may be rounding.
    """

    sizes: Array
    lengths: Array
    directions: Array
    rounding: float

    @classmethod
    def of_rows(cls, rows: Array, sizes: Array | None = None, rounding: float | None = None) -> SquareRoot:
        """Return the square root of F = R'R from its rows R (k, p).

        Args:
            rows: R.
            sizes: (p,) of the columns before any elimination; as they are by default.
            rounding: rounding of a unit column; by default that of R as a Jacobian.
        """
        magnitudes = np.linalg.norm(rows, axis=0) if sizes is None else sizes
        filled = np.vstack([reduced(rows), np.zeros((rows.shape[1], rows.shape[1]))])
        _, lengths, transposed = np.linalg.svd(filled / _divisors(magnitudes), full_matrices=False)
        return cls(magnitudes, lengths, transposed.T, rounding_of(rows) if rounding is None else rounding)

    @classmethod
    def of_matrix(cls, matrix: Array) -> SquareRoot:
        """Return the square root of a matrix F (..., p, p) that is there already squared, its digits lost."""
        diagonal = np.diagonal(matrix, axis1=-2, axis2=-1)
        magnitudes = np.sqrt(np.maximum(diagonal, 0.0))
        divisors = _divisors(magnitudes)
        values, vectors = np.linalg.eigh(matrix / (divisors[..., :, None] * divisors[..., None, :]))
        lengths = np.sqrt(np.maximum(values[..., ::-1], 0.0))
        return cls(magnitudes, lengths, vectors[..., ::-1], float(np.sqrt(SQUARED)))

    @classmethod
    def together(cls, parts: Sequence[SquareRoot]) -> SquareRoot:
        """The sum of what several say of the same parameters."""
        sizes = np.sqrt(sum(part.sizes**2 for part in parts))
        rows = np.vstack([part._unrounded for part in parts])
        return cls.of_rows(rows, sizes, max(part.rounding for part in parts))

    def leading(self, count: int) -> SquareRoot:
        """Information on the first `count` parameters, the others unknown as well."""
        if count == len(self.sizes):
            return self
        rows, rounding = project_out(self._unrounded, count, self.rounding)
        return SquareRoot.of_rows(rows, self.sizes[:count], rounding)

    def scaled(self, scales: Array | float) -> SquareRoot:
        """D F D, with D = diag(scales): of parameters in other units."""
        return SquareRoot(self.sizes * scales, self.lengths, self.directions, self.rounding)

    @cached_property
    def identifiable(self) -> Bools:
        """True for every direction that is identifiable, (..., p)."""
        return np.asarray(self.lengths > self.rounding)

    @property
    def complete(self) -> Bools:
        """True if every combination of the parameters is identifiable, (...)."""
        return np.asarray(self.identifiable.all(axis=-1))

    @cached_property
    def rows(self) -> Array:
        """R (..., p, p) with R'R = F, exactly 0 along what is not identifiable."""
        return np.where(self.identifiable[..., :, None], self._unrounded, 0.0)

    @property
    def matrix(self) -> Array:
        """F (..., p, p)."""
        return np.asarray(np.swapaxes(self.rows, -1, -2) @ self.rows)

    @cached_property
    def factor(self) -> Array:
        """G (..., p, p) with G G' the covariance of what is identifiable."""
        inverse = np.where(self.identifiable, 1.0 / np.where(self.identifiable, self.lengths, 1.0), 0.0)
        return np.asarray(self.directions * inverse[..., None, :] / _divisors(self.sizes)[..., :, None])

    @property
    def hidden(self) -> Array:
        """Combinations of the parameters that are not identifiable, as columns (p, k)."""
        return np.asarray((self.directions / _divisors(self.sizes)[:, None])[:, ~self.identifiable])

    @property
    def singular_values(self) -> Array:
        """Singular values of R, (..., p), descending; 0 for what is not identifiable."""
        values = np.linalg.svd(self.rows, compute_uv=False)
        missing = np.count_nonzero(~self.identifiable, axis=-1)
        places = np.arange(values.shape[-1])
        return np.where(places < values.shape[-1] - np.expand_dims(missing, -1), values, 0.0)

    @property
    def smallest(self) -> Array:
        """The smallest eigenvalue (...) of F; 0 where some combination is not identifiable."""
        # By the largest variance: small beside large ones, an eigenvalue is more exact so.
        largest = np.linalg.norm(self.factor, 2, axis=(-2, -1))
        with np.errstate(over="ignore"):
            return np.where(self.complete, 1.0 / np.where(self.complete, largest, 1.0) ** 2, 0.0)

    @property
    def largest(self) -> Array:
        """The largest eigenvalue (...) of F."""
        return np.asarray(np.linalg.norm(self.rows, 2, axis=(-2, -1)) ** 2)

    @property
    def log_determinant(self) -> Array:
        """Log det F (...), minus infinity where some combination is not identifiable."""
        complete = self.complete
        lengths = np.where(complete[..., None], self.lengths, 1.0)
        logs = np.log(lengths) + np.log(np.where(complete[..., None], self.sizes, 1.0))
        return np.where(complete, 2.0 * logs.sum(axis=-1), -np.inf)

    @cached_property
    def covariance(self) -> Array:
        """F^-1 (..., p, p): infinite variances, and covariances that are no numbers, of parameters that are
        not identifiable.
        """
        covariance = self.factor @ np.swapaxes(self.factor, -1, -2)
        hidden = self.hides(np.eye(self.sizes.shape[-1]))
        covariance = np.where(hidden[..., :, None] | hidden[..., None, :], np.nan, covariance)
        np.einsum("...ii->...i", covariance)[hidden] = np.inf
        return np.asarray(covariance)

    def hides(self, combinations: Array) -> Bools:
        """Return which combinations (q, p) of the parameters' changes are not identifiable, (..., q)."""
        units = combinations / _divisors(self.sizes)[..., None, :]
        along = np.abs(units @ self.directions)
        lengths = np.linalg.norm(units, axis=-1, keepdims=True)
        return np.asarray((~self.identifiable[..., None, :] & (along > TOUCHED * lengths)).any(axis=-1))

    def variances(self, combinations: Array) -> Array:
        """Variances (..., q) of combinations (q, p) of the parameters, infinite where not identifiable."""
        variances = ((combinations @ self.factor) ** 2).sum(axis=-1)
        return np.where(self.hides(combinations), np.inf, variances)

    @property
    def _unrounded(self) -> Array:
        # R with what is rounding left in it.
        transposed = np.swapaxes(self.directions, -1, -2)
        return np.asarray(self.lengths[..., :, None] * transposed * self.sizes[..., None, :])


def _divisors(sizes: Array) -> Array:
    # A parameter that nothing depends on, of size 0, counts in the units of the least of the others.
    least = np.where(sizes > 0, sizes, np.inf).min(axis=-1, keepdims=True)
    return np.where(sizes > 0, sizes, np.where(np.isfinite(least), least, 1.0))
