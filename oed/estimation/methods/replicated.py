"""Least squares of many replicates at once.

The replicates come last, in designs (rows, q, R) and readings (rows, R): what is summed over rows is then
summed for all replicates together, on contiguous numbers.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def normal_equations(designs: Array, measured: Array) -> tuple[Array, Array]:
    """W'W (R, q, q) and W'y (R, q) of each replicate.

    Args:
        designs: W, (rows, q, R).
        measured: y, (rows, R).
    """
    _, columns, count = designs.shape
    normal, right = np.empty((count, columns, columns)), np.empty((count, columns))
    for row in range(columns):
        right[:, row] = _dot(designs[:, row], measured)
        for column in range(row + 1):
            normal[:, row, column] = normal[:, column, row] = _dot(designs[:, row], designs[:, column])
    return normal, right


def solved(normal: Array, right: Array) -> Array:
    """Estimates (R, q) from normal equations (R, q, q) and (R, q)."""
    return np.asarray(np.linalg.solve(normal, right[..., None])[..., 0])


def least_squares(designs: Array, measured: Array) -> Array:
    """Ordinary least squares of each replicate, (rows, q, R) and (rows, R) to (R, q) [Choi, eq. 16]."""
    return solved(*normal_equations(designs, measured))


def _dot(first: Array, second: Array) -> Array:
    return np.asarray(np.einsum("ir,ir->r", first, second))
