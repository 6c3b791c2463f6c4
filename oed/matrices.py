"""Small symmetric matrices as expressions: elimination of nuisances and weighing, of any CasADi type."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca

from oed.expression import Expression

RIDGE = 1e-13
"""Share of a diagonal entry added to it before it is divided by, far below any information of use.

What nothing tells (a lever arm on a straight) is then eliminated as if it were known in no way, rather
than by a division of zero by zero.
"""


def eliminate(matrix: Expression, kept: int) -> Expression:
    """The Schur complement on the first `kept` rows: what is left when the others are unknown as well."""
    size = matrix.shape[0]
    return matrix if size == kept else _elimination(size, kept)(matrix)


def harmonic(matrix: Expression, spread: Expression) -> Expression:
    """S M^-1 S of symmetric S = `matrix` and M = `spread`: the inverse of the sandwich S^-1 M S^-1."""
    return _harmonic(matrix.shape[0])(matrix, spread)


def cholesky(matrix: Expression) -> Expression:
    """Upper R with R'R = `matrix` (SX), its diagonal raised by a ridge too small to matter."""
    diagonal = ca.diag(matrix)
    return ca.chol(matrix + ca.diag(RIDGE * diagonal + 1e-20))


def solve_lower(upper: Expression, right: Expression) -> Expression:
    """R'^-1 B of an upper triangular R (SX), by forward substitution, row by row."""
    rows: list[Expression] = []
    for index in range(upper.shape[0]):
        rest = right[index, :]
        for before, row in enumerate(rows):
            rest = rest - upper[before, index] * row
        rows.append(rest / upper[index, index])
    return ca.vertcat(*rows)


# A Cholesky factor exists for SX only; as a function it serves every type.
@lru_cache(maxsize=64)
def _elimination(size: int, kept: int) -> ca.Function:
    matrix = ca.SX.sym("F", size, size)
    shared, rest = matrix[kept:, :kept], matrix[kept:, kept:]
    solved = solve_lower(cholesky(rest), shared)
    return ca.Function("eliminate", [matrix], [matrix[:kept, :kept] - solved.T @ solved])


@lru_cache(maxsize=16)
def _harmonic(size: int) -> ca.Function:
    matrix, spread = ca.SX.sym("S", size, size), ca.SX.sym("M", size, size)
    solved = solve_lower(cholesky(spread), matrix)
    return ca.Function("harmonic", [matrix, spread], [solved.T @ solved])
