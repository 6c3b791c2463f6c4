"""Sparse matrices by their entries."""

from __future__ import annotations

import casadi as ca

from oed.kernel.dynamics.expression import Expression


class Packed:
    """A matrix by the entries that are not structurally 0, column by column: what functions exchange."""

    def __init__(self, matrix: Expression) -> None:
        """Keep the pattern."""
        self.pattern: ca.Sparsity = matrix.sparsity()
        self.entries: Expression = type(matrix)(0, 1) if not matrix.nnz() else _entries(matrix)

    def matrix(self, entries: Expression) -> Expression:
        """The matrix with other entries (MX)."""
        return ca.sparsity_cast(ca.vec(entries), self.pattern)

    def symbol(self, name: str) -> tuple[Expression, Expression]:
        """A matrix of the same pattern, of symbols, and those symbols (SX)."""
        entries = ca.SX.sym(name, self.pattern.nnz())
        return ca.SX(self.pattern, entries), entries

    def back(self) -> ca.Function:
        """(weights of what a part hands on, entries of its derivatives, more weights) -> weights of what it
        was handed, by which the first columns are.
        """
        width = self.pattern.size1()
        weight, more = ca.SX.sym("weight", width), ca.SX.sym("more", width)
        matrix, entries = self.symbol("onward")
        total = matrix[:, :width].T @ weight + more
        return ca.Function("back", [weight, entries, more], [ca.densify(total)])


def _entries(matrix: Expression) -> Expression:
    # Of a row they would stay one.
    return ca.vec(matrix.nz[:]) if isinstance(matrix, ca.MX) else ca.vertcat(*matrix.nonzeros())
