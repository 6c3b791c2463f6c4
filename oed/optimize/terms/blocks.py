"""Matrices of parts of a drive, side by side: sparse ones by their entries, and how the parts follow."""

from __future__ import annotations

import casadi as ca
import numpy as np

from oed.foundation.arrays import block_columns
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

    def chained(self, slopes: Expression, entries: Expression) -> Expression:
        """Derivatives (size, rows) by all unknowns of what parts make, from the `slopes` (size, columns) of
        what they make it of; the matrices between by their entries, a column each.
        """
        size, count = slopes.shape[0], entries.shape[1]
        if not self.pattern.nnz():
            return ca.MX(size, self.pattern.size1() * count)
        slope = ca.MX.sym("slope", size, self.pattern.size2())
        own = ca.MX.sym("own", self.pattern.nnz())
        through = ca.Function("through", [slope, own], [ca.densify(slope @ self.matrix(own).T)])
        return through.map(count)(slopes, entries)

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


def pull(matrix: Packed, width: int) -> ca.Function:
    """(entries of a matrix, weights of its rows) -> weights of its first `width` columns."""
    whole, entries = matrix.symbol("matrix")
    weights = ca.SX.sym("weights", whole.shape[0])
    return ca.Function("pull", [entries, weights], [ca.densify(whole[:, :width].T @ weights)])


def begins(begin: Expression, following: Expression, each: int, width: int = 1) -> Expression:
    """What parts begin with: blocks that sequences of `each` parts begin with, then what the parts end with.

    Args:
        begin: of every sequence its block.
        following: of every part the block that it ends with.
        each: parts of a sequence.
        width: columns of a block.
    """
    if not width:
        return begin
    count = begin.shape[1] // width
    order = np.empty((count, each), dtype=np.int64)
    order[:, 0] = np.arange(count)
    order[:, 1:] = count + np.arange(count)[:, None] * each + np.arange(each - 1)
    return ca.horzcat(begin, following)[:, block_columns(order.ravel(), width)]


def backwards(table: Expression, each: int) -> Expression:
    """The columns of a table, one for each part, in the opposite order within every sequence of `each`."""
    order = np.arange(table.shape[1]).reshape(-1, each)[:, ::-1]
    return table[:, order.ravel().tolist()]
