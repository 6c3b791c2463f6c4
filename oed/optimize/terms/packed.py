"""Sparse matrices by their entries."""

from __future__ import annotations

import casadi as ca

from oed.kernel.dynamics.expression import Expression


class Packed:
    """A matrix by the entries that are not structurally 0, column by column: what functions exchange."""

    def __init__(self, matrix: Expression) -> None:
        """Keep the pattern."""
        self.pattern: ca.Sparsity = matrix.sparsity()
        self.entries: Expression = ca.vertcat(*matrix.nonzeros()) if matrix.nnz() else ca.SX(0, 1)

    def matrix(self, entries: Expression) -> Expression:
        """The matrix with other entries (MX)."""
        return ca.sparsity_cast(ca.vec(entries), self.pattern)

    def symbol(self, name: str) -> tuple[Expression, Expression]:
        """A matrix of the same pattern, of symbols, and those symbols (SX)."""
        entries = ca.SX.sym(name, self.pattern.nnz())
        return ca.SX(self.pattern, entries), entries
