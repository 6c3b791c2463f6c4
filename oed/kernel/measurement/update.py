"""Readings that a filter takes in all at once, with first and second derivatives in closed form.

Of a prediction with sensitivities D and covariance P the matrix Z = [0, D'; D, P] becomes Z - U' S^-1 U by
readings of unit noise with slopes d by the unknowns and h by what is predicted: U = [h D + d, h P], S = 1 +
h P h'. Its blocks are then less the information, D and P after the readings.

With gains K = S^-1 U that is Z - U'K - K'U + K'SK, whose derivative by K is 0. So its first derivatives are
those with K held fixed; its second derivatives are these, and -2 V' S^-1 V with V = dU - dS K. Plain
automatic differentiation, which follows K as well, writes two to four times as much.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from oed.kernel.dynamics.expression import Expression


class Update:
    """Filter step from a prediction and readings; expressions (SX).

    Attributes:
        after: the matrix of information, sensitivities and covariance, (n + states, n + states).
        changed: rows and columns of those entries of its upper half that readings change.
        entries: these entries.
        symbols: symbols that may stand for them.
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
        before = ca.blockcat([[ca.SX(count, count), slopes.T], [slopes, covariance]])
        self._direct = ca.horzcat(direct, ca.SX(*through.shape))
        self._through = ca.horzcat(ca.SX(*direct.shape), ca.sparsify(through))
        self._before, self._seen = before, self._through @ before + self._direct
        self._variance = _symmetric(ca.SX.eye(direct.shape[0]) + self._seen @ self._through.T)
        self._root = ca.chol(ca.densify(self._variance))
        # Of triangular matrices CasADi writes substitutions.
        white = ca.solve(self._root.T, self._seen)
        self._gains = ca.solve(self._root, white)
        less = _symmetric(white.T @ white)
        self.after = before - less
        self.changed = list(zip(*ca.triu(ca.sparsify(less)).sparsity().get_triplet(), strict=True))
        self.entries = self._entries(self.after)
        self.symbols = ca.SX.sym("updated", len(self.changed))
        self._columns = sorted(set(self._seen.sparsity().get_triplet()[1]))

    def _entries(self, matrix: Expression) -> Expression:
        return ca.vertcat(ca.SX(0, 1), *(matrix[place] for place in self.changed))

    def parts(self, after: Expression) -> tuple[Expression, Expression, Expression]:
        """Return D and P after the readings, and their information, of the matrix."""
        places = slice(self._count, None)
        return after[places, : self._count], after[places, places], -after[: self._count, : self._count]

    @property
    def named(self) -> Expression:
        """The matrix with symbols in the place of the entries that readings change."""
        matrix = ca.SX(self.after)
        for symbol, (row, column) in zip(self.symbols.elements(), self.changed, strict=True):
            matrix[row, column] = matrix[column, row] = symbol
        return matrix

    def written_out(self, expressions: Sequence[Expression]) -> list[Expression]:
        """Return expressions of the symbols by what these stand for."""
        return list(ca.substitute(list(expressions), [self.symbols], [self.entries]))

    def slopes(self, by: Expression) -> tuple[Expression, Expression]:
        """Return derivatives by all of `by` of `entries`, and the changes V / sqrt(S) of what is read, row by
        row in those columns that are not 0.
        """
        parts = self._before, self._direct, self._through
        by_parts = [ca.jacobian(ca.vec(part), by) for part in parts]
        # Z changes by F' dZ F, and by what d and h take from it.
        turning = ca.SX.eye(self.after.shape[0]) - self._through.T @ self._gains
        entries, changes = [], []
        for place in range(by.shape[0]):
            before, direct, through = (
                ca.reshape(slopes[:, place], *part.shape)
                for slopes, part in zip(by_parts, parts, strict=True)
            )
            moved, steeper = before @ turning, direct + through @ self.after
            taken = steeper.T @ self._gains
            entries.append(self._entries(turning.T @ moved - taken - taken.T))
            change = self._through @ moved + steeper - self._seen @ through.T @ self._gains
            changes.append(ca.vec(ca.solve(self._root.T, change)[:, self._columns].T))
        return ca.horzcat(*entries), ca.horzcat(*changes)

    def curvature(self, weights: Expression, by: Expression) -> tuple[Expression, Expression]:
        """Return second derivatives of the weighted sum of `entries`: by `by` with the gains held fixed, and
        by the changes that `slopes` returns.
        """
        gains = ca.SX.sym("gains", self._gains.sparsity())
        crossed = self._seen.T @ gains
        about = self._before - crossed - crossed.T + gains.T @ self._variance @ gains
        symbols = ca.SX.sym("weights", weights.shape[0])
        bent, _ = ca.hessian(ca.dot(symbols, self._entries(about)), by)
        (bent,) = ca.substitute([bent], [gains, symbols], [self._gains, weights])
        weighted = ca.SX(*self.after.shape)
        for weight, (row, column) in zip(weights.elements(), self.changed, strict=True):
            weighted[row, column] += weight / 2
            weighted[column, row] += weight / 2
        block = -2 * weighted[self._columns, self._columns]
        return bent, ca.diagcat(*[block] * self._seen.shape[0])


def _symmetric(matrix: Expression) -> Expression:
    # By its upper half, lest what is the same be written twice.
    return ca.triu2symm(ca.triu(matrix))
