"""Matrices by the entries on and above their diagonals."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.kernel.dynamics.expression import Expression


def upper_half(matrix: Expression) -> Expression:
    """The entries on and above the diagonal, column by column, (p (p + 1) / 2,)."""
    size = matrix.shape[0]
    return ca.vertcat(*(matrix[row, column] for column in range(size) for row in range(column + 1)))


def upper_halves(matrices: Iterable[Expression]) -> Expression:
    """Return the upper halves of several matrices, stacked."""
    return ca.vertcat(*map(upper_half, matrices))


def symmetric(entries: Expression, size: int) -> Expression:
    """The symmetric matrix (p, p) with these entries on and above its diagonal."""
    rows: list[list[Any]] = [[None] * size for _ in range(size)]
    places = ((row, column) for column in range(size) for row in range(column + 1))
    for index, (row, column) in enumerate(places):
        rows[row][column] = rows[column][row] = entries[index]
    return ca.blockcat(rows)


def symmetric_all(entries: Expression, sizes: Sequence[int]) -> list[Expression]:
    """The symmetric matrices of these sizes whose upper halves are stacked."""
    edges = np.cumsum([0, *(size * (size + 1) // 2 for size in sizes)]).tolist()
    return [
        symmetric(entries[first:last], size)
        for first, last, size in zip(edges[:-1], edges[1:], sizes, strict=True)
    ]


def stacks(entries: Array, sizes: Sequence[int]) -> list[Array]:
    """Numeric matrices (K, p, p) of stacked entries (sum of p (p + 1) / 2, K), one for each size p."""
    matrices, first = [], 0
    for size in sizes:
        columns, rows = np.tril_indices(size)
        matrix = np.empty((entries.shape[1], size, size))
        entries_of_one = entries[first : first + len(rows)].T
        matrix[:, rows, columns] = matrix[:, columns, rows] = entries_of_one
        matrices.append(matrix)
        first += len(rows)
    return matrices
