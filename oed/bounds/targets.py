"""Concave criteria of F (2, 2) that a lattice bounds, by a bound for each Z >= 0."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from oed.bounds.certificate import gap
from oed.bounds.equivalence import best_mixture
from oed.foundation.arrays import Array
from oed.kernel.criteria import Criterion

DIRECTIONS = 96
"""Number of corners of the polygon that contains Z of E; every Z inside is valid."""
FAINT = 1e-3
"""Share of the mean eigenvalue that is added to singular matrices, to have a Z > 0."""


@dataclass(frozen=True)
class Target:
    """Criterion of F + constant that a lattice bounds.

    Attributes:
        criterion: criterion of two parameters, with a conjugate.
        constant: matrix that is added to F, (2, 2), e.g. prior information.
    """

    criterion: Criterion
    constant: Array

    def bound(self, multiplier: Array, most: float) -> float:
        """Return the criterion's bound for tr(Z F) <= most; -inf if no F is feasible."""
        if not np.isfinite(most):
            return most
        return self.criterion.trace_bound(multiplier, most + float(np.sum(multiplier * self.constant)))

    def values(self, matrices: Array) -> Array:
        """Return the criterion (...,) of matrices (..., 2, 2) that include the constant."""
        return np.asarray(self.criterion.value([matrices]))

    def excess(self, bound: float, value: float) -> float:
        """Return the share by which a bound exceeds a value; infinite for an unidentifiable one."""
        return 0.0 if -np.inf < bound <= value else gap(bound, value, self.criterion, 2)

    def lowest(self, matrices: Sequence[Array]) -> tuple[float, Array, Array]:
        """Return the lowest bound for these matrices, its Z of trace 1, and the best mixture's shares."""
        if self.criterion.conjugate == "linear":
            least, point, shares = _lowest_plane([_plane(matrix) for matrix in matrices])
            return least, _multiplier(point), shares
        stacked = np.stack(matrices)
        groups, totals = np.zeros(len(stacked), dtype=np.int64), np.ones(1)
        mixture = best_mixture(self.criterion, stacked, np.zeros((2, 2)), 2, groups, totals)
        if mixture is not None:
            return mixture.value, mixture.multiplier / np.trace(mixture.multiplier), mixture.weights
        mean = stacked.mean(axis=0)
        faint = FAINT * (np.trace(mean) or 1.0) / 2
        multiplier = self.criterion.supergradient(mean + faint * np.eye(2))
        assert multiplier is not None
        return -np.inf, multiplier / np.trace(multiplier), np.full(len(stacked), 1 / len(stacked))


def _multiplier(point: Array) -> Array:
    # Z = (I + point . Pauli matrices) / 2 for a point in the unit disc.
    return np.array([[1 + point[0], point[1]], [point[1], 1 - point[0]]]) / 2


def _plane(matrix: Array) -> tuple[float, Array]:
    # tr(Z F) = offset + slope . point.
    return float(np.trace(matrix)) / 2, np.array([(matrix[0, 0] - matrix[1, 1]) / 2, matrix[0, 1]])


def _lowest_plane(planes: list[tuple[float, Array]]) -> tuple[float, Array, Array]:
    # Minimum over a polygon inside the disc of the largest plane, its point, and the planes' multipliers.
    angles = 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    sides = np.stack([np.cos(angles), np.sin(angles), np.zeros(DIRECTIONS)], axis=1)
    size = max(abs(offset) for offset, _ in planes) or 1.0
    rows = [np.concatenate([slope / size, [-1.0]]) for _, slope in planes]
    offsets = [-offset / size for offset, _ in planes]
    solution = scipy.optimize.linprog(
        [0.0, 0.0, 1.0],
        A_ub=np.vstack([rows, sides]),
        b_ub=np.concatenate([offsets, np.full(DIRECTIONS, np.cos(np.pi / DIRECTIONS))]),
        bounds=[(None, None)] * 3,
        method="highs",
    )
    shares = -np.asarray(solution.ineqlin.marginals[: len(planes)])
    return float(solution.x[2]) * size, np.asarray(solution.x[:2]), np.asarray(shares)
