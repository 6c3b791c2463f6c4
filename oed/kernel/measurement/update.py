"""Readings that a filter takes in all at once, with first and second derivatives in closed form.

Of a prediction with sensitivities D and covariance P the matrix Z = [0, D'; D, P] becomes Z - U' S^-1 U by
readings of unit noise with slopes d by the unknowns and h by what is predicted: U = [h D + d, h P], S = 1 +
h P h'. Its blocks are then less the information, D and P after the readings. By a change dZ it changes by
F' dZ F, F = 1 - [0; h' S^-1 U]; its second derivatives are those of Z, and -2 V' S^-1 V, V = dU - dS S^-1 U.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from oed.kernel.dynamics.expression import Expression
from oed.kernel.measurement.matrices import solve_lower


class Update:
    """Filter step from a prediction and readings; expressions (SX).

    Attributes:
        after: the matrix of information, sensitivities and covariance, (n + states, n + states).
        changed: rows and columns of those entries of its upper half that readings change.
        symbols: symbols that may stand for these.
    """

    def __init__(
        self, slopes: Expression, covariance: Expression, direct: Expression, through: Expression
    ) -> None:
        """Take readings in.

        Args:
            slopes: D, (states, n).
            covariance: P, (states, states).
            direct: d, (q, n).
            through: h, (q, states).
        """
        self._count = count = slopes.shape[1]
        self._direct, self._through = direct, ca.sparsify(through)
        self._before = ca.blockcat([[ca.SX(count, count), slopes.T], [slopes, covariance]])
        self._seen = ca.horzcat(self._through @ slopes + direct, self._through @ covariance)
        self._variance = _symmetric(ca.SX.eye(len(self)) + self._seen[:, count:] @ self._through.T)
        self._root = ca.chol(ca.densify(self._variance))
        self._white = solve_lower(self._root, self._seen)
        self._solved = _solve_upper(self._root, self._white)
        less = _symmetric(self._white.T @ self._white)
        self.after = self._before - less
        self.changed = list(zip(*ca.triu(ca.sparsify(less)).sparsity().get_triplet(), strict=True))
        self.symbols = ca.SX.sym("updated", len(self.changed))
        self._columns = sorted(set(self._seen.sparsity().get_triplet()[1]))

    def __len__(self) -> int:
        """Return the number q of readings."""
        return int(self._through.shape[0])

    def parts(self, after: Expression) -> tuple[Expression, Expression, Expression]:
        """D and P after the readings, and their information, of the matrix."""
        places = slice(self._count, None)
        return after[places, : self._count], after[places, places], -after[: self._count, : self._count]

    @property
    def entries(self) -> Expression:
        """The entries that readings change."""
        return ca.vertcat(ca.SX(0, 1), *(self.after[place] for place in self.changed))

    @property
    def named(self) -> Expression:
        """The matrix with symbols in the place of these."""
        matrix = ca.SX(self.after)
        for symbol, (row, column) in zip(self.symbols.elements(), self.changed, strict=True):
            matrix[row, column] = matrix[column, row] = symbol
        return matrix

    def written_out(self, expressions: Sequence[Expression]) -> list[Expression]:
        """Expressions of the symbols by what these stand for."""
        return list(ca.substitute(list(expressions), [self.symbols], [self.entries]))

    def slopes(self, by: Expression) -> tuple[Expression, Expression]:
        """Derivatives by all of `by` of `entries`, and the changes V / sqrt(S) of what is read, row by row in
        those columns that are not 0.
        """
        size, count = self._before.shape[0], self._count
        gained = self._through.T @ self._solved
        turning = ca.SX.eye(size) - ca.vertcat(ca.SX(count, size), gained)
        by_matrix, *direct_slopes = (
            ca.jacobian(ca.vec(expression), by) for expression in (self._before, self._direct, self._through)
        )
        entries, changes = [], []
        for place in range(by.shape[0]):
            moved = ca.reshape(by_matrix[:, place], size, size) @ turning
            change_of_matrix, change_of_readings = turning.T @ moved, self._through @ moved[count:, :]
            if any(slopes[:, place].nnz() for slopes in direct_slopes):
                more, change = self._by_slopes(*(slopes[:, place] for slopes in direct_slopes))
                change_of_matrix, change_of_readings = change_of_matrix - more, change_of_readings + change
            entries.append(ca.vertcat(ca.SX(0, 1), *(change_of_matrix[at] for at in self.changed)))
            changes.append(ca.vec(solve_lower(self._root, change_of_readings)[:, self._columns].T))
        return ca.horzcat(*entries), ca.horzcat(*changes)

    def _by_slopes(self, direct: Expression, through: Expression) -> tuple[Expression, Expression]:
        # What changes of d and h take from the matrix, and add to V.
        size, count = self._before.shape[0], self._count
        direct = ca.horzcat(ca.reshape(direct, len(self), count), ca.SX(len(self), size - count))
        through = ca.reshape(through, *self._through.shape)
        moved = direct + through @ self.after[count:, :]
        taken = moved.T @ self._solved
        return taken + taken.T, moved - self._seen[:, count:] @ through.T @ self._solved

    def curvature(self, weights: Expression, by: Expression) -> tuple[Expression, Expression]:
        """Second derivatives of the weighted sum of `entries`: by `by`, as far as Z, U and S are bent in it,
        and by the changes that `slopes` finds.
        """
        weighted = ca.SX(*self._before.shape)
        for weight, (row, column) in zip(weights.elements(), self.changed, strict=True):
            weighted[row, column] = weighted[column, row] = weight if row == column else weight / 2
        crossed = self._solved @ weighted
        factors = [ca.densify(factor) for factor in (weighted, -2 * crossed, crossed @ self._solved.T)]
        symbols = [ca.SX.sym("weights", *factor.shape) for factor in factors]
        of = self._before, self._seen, self._variance
        total = sum(ca.dot(weight, matrix) for weight, matrix in zip(symbols, of, strict=True))
        bent, _ = ca.hessian(total, by)
        block = -2 * weighted[self._columns, self._columns]
        return ca.substitute([bent], symbols, factors)[0], ca.diagcat(*[block] * len(self))


def _symmetric(matrix: Expression) -> Expression:
    # By its upper half, lest what is the same be written twice.
    return ca.triu2symm(ca.triu(matrix))


def _solve_upper(upper: Expression, right: Expression) -> Expression:
    # R^-1 B, row by row from the last.
    rows: list[Expression] = []
    for index in reversed(range(upper.shape[0])):
        rest = right[index, :]
        for after, row in enumerate(rows, index + 1):
            rest = rest - upper[index, after] * row
        rows.insert(0, rest / upper[index, index])
    return ca.vertcat(*rows)
