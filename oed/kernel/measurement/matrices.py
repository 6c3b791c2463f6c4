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
    """Return the Schur complement on the first `leading` rows: what is left if the others are unknown too."""
    if matrix.shape[0] == leading:
        return matrix
    taken = quotient(matrix[leading:, leading:], matrix[leading:, :leading])
    return ca.densify(matrix[:leading, :leading] - taken)


def posterior(covariance: Expression, information: Expression) -> Expression:
    """(P^-1 + F)^-1 of a covariance P that may be singular and information F (SX): P (1 + F P)^-1."""
    size = covariance.shape[0]
    product = ca.densify(ca.SX.eye(size) + information @ covariance)
    # By cofactors where these are few: no pivot may vanish, and the determinant is at least 1.
    inverse = ca.inv(product) if size <= BY_COFACTORS else ca.solve(product, ca.SX.eye(size))
    return ca.triu2symm(ca.triu(covariance @ inverse))


def harmonic(matrix: Expression, spread: Expression) -> Expression:
    """Return S M^-1 S of symmetric S = `matrix` and M = `spread`: the inverse of the sandwich S^-1 M S^-1."""
    return ca.densify(quotient(spread, matrix))


def quotient(matrix: Expression, right: Expression) -> Expression:
    """Return B' M^-1 B of a symmetric positive semidefinite M, pivot by pivot, but for those of rounding."""
    if isinstance(matrix, ca.SX):
        # What is 0 by structure, as between start states of different trials, costs nothing.
        return _quotient(matrix, right)
    return _quotient_of(*right.shape)(matrix, right)


def _quotient(matrix: ca.SX, right: ca.SX) -> ca.SX:
    total = ca.SX(right.shape[1], right.shape[1])
    diagonal = ca.diag(matrix)
    for index in range(matrix.shape[0]):
        pivot = matrix[0, 0]
        inverse = pivot / (pivot**2 + (PIVOT * diagonal[index]) ** 2 + NOTHING)
        row, wanted = matrix[0, 1:], right[0, :]
        total += inverse * wanted.T @ wanted
        right = right[1:, :] - inverse * row.T @ wanted
        matrix = matrix[1:, 1:] - inverse * row.T @ row
    return total


@lru_cache(maxsize=64)
def _quotient_of(size: int, columns: int) -> ca.Function:
    matrix, right = ca.SX.sym("M", size, size), ca.SX.sym("B", size, columns)
    return ca.Function("quotient", [matrix, right], [ca.densify(_quotient(matrix, right))])
