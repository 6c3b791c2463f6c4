"""Concave criteria of F (2, 2) that a lattice bounds, by a bound for each Z >= 0."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from oed.bounds.certificate import gap
from oed.bounds.mixtures import best_mixture
from oed.foundation.arrays import Array
from oed.kernel.criteria import Criterion
from oed.kernel.measurement.square_root import SquareRoot

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

    def lowest(self, paths: Sequence[Array]) -> tuple[float, Array, Array]:
        """Return the lowest bound for mixtures of drives, its Z of trace 1, and the best mixture's shares.

        Args:
            paths: speeds (N, 2) of each drive, scaled so that F = W'W.
        """
        matrices = np.stack([path.T @ path for path in paths])
        if self.criterion.conjugate == "linear":
            return _lowest_eigenvalue_bound(matrices + self.constant)
        groups, known_rows = np.zeros(len(paths), dtype=np.int64), SquareRoot.of_matrix(self.constant).rows
        experiments = list(SquareRoot.of_matrix(matrices).rows)
        mixture = best_mixture(self.criterion, experiments, known_rows, 2, groups, np.ones(1))
        if mixture is not None:
            return mixture.value, mixture.multiplier / np.trace(mixture.multiplier), mixture.weights
        mean = matrices.mean(axis=0) + self.constant
        multiplier = self.criterion.supergradient(mean + FAINT * (np.trace(mean) or 1.0) / 2 * np.eye(2))
        assert multiplier is not None
        return -np.inf, multiplier / np.trace(multiplier), np.full(len(paths), 1 / len(paths))


def _lowest_eigenvalue_bound(matrices: Array) -> tuple[float, Array, Array]:
    # Z = (I + point . Pauli matrices) / 2 for a point in the unit disc, over which tr(Z F) is a plane. A
    # linear programme finds the lowest point of the planes' maximum over a polygon inside the disc; its
    # multipliers are the planes' shares.
    offsets = matrices.trace(axis1=1, axis2=2) / 2
    slopes = np.stack([(matrices[:, 0, 0] - matrices[:, 1, 1]) / 2, matrices[:, 0, 1]], axis=1)
    size = float(np.abs(offsets).max()) or 1.0
    angles = 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    planes = np.column_stack([slopes / size, np.full(len(matrices), -1.0)])
    sides = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(DIRECTIONS)])
    solution = scipy.optimize.linprog(
        [0.0, 0.0, 1.0],
        A_ub=np.vstack([planes, sides]),
        b_ub=np.concatenate([-offsets / size, np.full(DIRECTIONS, np.cos(np.pi / DIRECTIONS))]),
        bounds=[(None, None)] * 3,
        method="highs",
    )
    x, y, least = solution.x
    shares = -np.asarray(solution.ineqlin.marginals[: len(matrices)])
    return float(least) * size, np.array([[1 + x, y], [y, 1 - x]]) / 2, np.asarray(shares)
