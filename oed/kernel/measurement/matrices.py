"""Small symmetric matrices as expressions: elimination of nuisances and weighing, of any CasADi type."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca

from oed.kernel.dynamics.expression import Expression

PIVOT = 1e-14
"""Share of a diagonal entry below which what is left of it is rounding, and fades out as a pivot.

What is not identifiable (a lever arm on a straight), alone or beside the others, is then eliminated as if
known in no way, smoothly, rather than by a division of rounding by rounding.
"""
BY_COFACTORS = 4
"""Rows of matrices that are inverted by cofactors; larger ones by orthogonal rows."""
NOTHING = 1e-60
"""A pivot's square below which there is nothing at all, of a size that may be cubed."""


def eliminate(matrix: Expression, leading: int) -> Expression:
    """The Schur complement on the first `leading` rows: what is left when the others are unknown as well."""
    size = matrix.shape[0]
    if size == leading:
        return matrix
    if isinstance(matrix, ca.SX) and not matrix.is_dense():
        # What is 0 by structure, as between start states of different trials, costs nothing.
        return _eliminated(matrix, leading)
    return _elimination(size, leading)(matrix)


def posterior(covariance: Expression, information: Expression) -> Expression:
    """(P^-1 + F)^-1 of a covariance P that may be singular and information F (SX): P (1 + F P)^-1."""
    size = covariance.shape[0]
    product = ca.densify(ca.SX.eye(size) + information @ covariance)
    # By cofactors where these are few: no pivot may vanish, and the determinant is at least 1.
    inverse = ca.inv(product) if size <= BY_COFACTORS else ca.solve(product, ca.SX.eye(size))
    return ca.triu2symm(ca.triu(covariance @ inverse))


def harmonic(matrix: Expression, spread: Expression) -> Expression:
    """S M^-1 S of symmetric S = `matrix` and M = `spread`: the inverse of the sandwich S^-1 M S^-1."""
    return _harmonic(matrix.shape[0])(matrix, spread)


def solve_lower(upper: Expression, right: Expression) -> Expression:
    """R'^-1 B of an upper triangular R (SX), by forward substitution, row by row."""
    rows: list[Expression] = []
    for index in range(upper.shape[0]):
        rest = right[index, :]
        for before, row in enumerate(rows):
            rest = rest - upper[before, index] * row
        rows.append(rest / upper[index, index])
    return ca.vertcat(*rows)


def quotient(matrix: Expression, right: Expression) -> Expression:
    """B' M^-1 B of a symmetric positive semidefinite M (SX), pivot by pivot, but for those of rounding."""
    total: Expression = ca.SX(right.shape[1], right.shape[1])
    diagonal = ca.diag(matrix)
    for index in range(matrix.shape[0]):
        pivot = matrix[0, 0]
        inverse = pivot / (pivot**2 + (PIVOT * diagonal[index]) ** 2 + NOTHING)
        row, wanted = matrix[0, 1:], right[0, :]
        total += inverse * wanted.T @ wanted
        right = right[1:, :] - inverse * row.T @ wanted
        matrix = matrix[1:, 1:] - inverse * row.T @ row
    return total


# Entry by entry, as SX; as functions they serve every type.
@lru_cache(maxsize=64)
def _elimination(size: int, leading: int) -> ca.Function:
    matrix = ca.SX.sym("F", size, size)
    return ca.Function("eliminate", [matrix], [_eliminated(matrix, leading)])


def _eliminated(matrix: ca.SX, leading: int) -> ca.SX:
    taken = quotient(matrix[leading:, leading:], matrix[leading:, :leading])
    return ca.densify(matrix[:leading, :leading] - taken)


@lru_cache(maxsize=16)
def _harmonic(size: int) -> ca.Function:
    matrix, spread = ca.SX.sym("S", size, size), ca.SX.sym("M", size, size)
    return ca.Function("harmonic", [matrix, spread], [ca.densify(quotient(spread, matrix))])
