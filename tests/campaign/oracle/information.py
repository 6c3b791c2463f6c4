"""What the readings say: information on what is asked for, all else eliminated by orthogonal projection."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]

FAINT, NOTHING = 1e-6, 1e-14
"""Singular values of the Jacobian with columns of unit length: above the first they are found well, below the
second they are rounding; between, nobody can say."""


@dataclass(frozen=True)
class Told:
    """Information on some parameters, as F = R'R.

    Attributes:
        root: R (k, p), in the parameters' scales.
        strengths: singular values of R with columns as long as they were before anything was eliminated:
            1 for parameters that hide behind nothing.
        clear: whether what is eliminated is told well, or not at all.
    """

    root: Array
    strengths: Array
    clear: bool

    @property
    def matrix(self) -> Array:
        """F (p, p)."""
        return self.root.T @ self.root

    @property
    def eigenvalues(self) -> Array:
        """Of F, descending, from the singular values of its root."""
        values = np.linalg.svd(self.root, compute_uv=False)
        return np.pad(values, (0, max(0, self.root.shape[1] - len(values)))) ** 2

    @property
    def weakest(self) -> float:
        """The least strength."""
        return float(self.strengths.min())


def eliminated(rows: Array, kept: Sequence[int], others: Sequence[int], scales: Array) -> Told:
    """Information on the columns `kept` of white rows, times `scales`, when `others` are unknown as well."""
    wanted = rows[:, list(kept)] * scales
    lengths = np.linalg.norm(wanted, axis=0)
    basis, clear = _basis(rows[:, list(others)])
    root = wanted - basis @ (basis.T @ wanted)
    # Twice is enough [Parlett, The Symmetric Eigenvalue Problem, 6.9].
    root = root - basis @ (basis.T @ root)
    unit = root / np.where(lengths > 0, lengths, 1.0)
    strengths = np.linalg.svd(unit, compute_uv=False)
    strengths = np.pad(strengths, (0, max(0, unit.shape[1] - len(strengths))))
    return Told(np.linalg.qr(root, mode="r"), strengths, clear)


def _basis(columns: Array) -> tuple[Array, bool]:
    # Orthonormal, of the columns' range; and whether that range is clear.
    lengths = np.linalg.norm(columns, axis=0)
    unit = columns[:, lengths > 0] / lengths[lengths > 0]
    if not unit.shape[1]:
        return np.zeros((len(columns), 0)), True
    left, values, _ = np.linalg.svd(unit, full_matrices=False)
    clear = bool(np.all((values > FAINT) | (values < NOTHING)))
    return left[:, values > (FAINT * NOTHING) ** 0.5], clear


def sandwich(rows: Array, covariance: Array, scales: Array) -> Told:
    """Information of ordinary least squares whose rows are correlated: (W'W) (W'K W)^-1 (W'W).

    With W = Q R and the factor K = L L', it is the inverse of R^-1 Q' K Q R'^-1.
    """
    scaled = rows * scales
    orthogonal, upper = np.linalg.qr(scaled)
    factor = np.linalg.qr((np.linalg.cholesky(covariance).T @ orthogonal), mode="r")
    lengths = np.linalg.norm(scaled, axis=0)
    values = np.linalg.svd(scaled / np.where(lengths > 0, lengths, 1.0), compute_uv=False)
    strengths = np.pad(values, (0, max(0, scaled.shape[1] - len(values))))
    root = np.linalg.solve(factor.T, upper)
    return Told(root, strengths, True)
