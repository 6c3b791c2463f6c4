"""Functions of CasADi and their derivatives, evaluated on arrays for many arguments at once."""

from __future__ import annotations

from functools import cached_property

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array, Bools
from oed.kernel.dynamics.direct_call import mapped
from oed.kernel.dynamics.expression import Expression
from oed.optimize.terms.blocks import Packed


class Differentiated:
    """A function of variables and constants, with first and second derivatives by the variables.

    Attributes:
        size: number of variables, n.
        count: number of results, k.
    """

    def __init__(
        self, variables: Expression, results: Expression, constants: Expression | None = None
    ) -> None:
        """Take symbols and expressions of them; functions are made when they are first called.

        Args:
            variables: symbols (n,).
            results: expressions (k,).
            constants: further symbols (c,), by which nothing is differentiated.
        """
        self._symbols = [variables, ca.SX(0, 1) if constants is None else constants]
        self._results = ca.densify(results)
        self.size, self.count = int(variables.shape[0]), int(results.shape[0])

    @cached_property
    def _values(self) -> ca.Function:
        return ca.Function("values", self._symbols, [self._results])

    @cached_property
    def _slopes(self) -> tuple[ca.Function, ca.Sparsity]:
        slope = Packed(ca.jacobian(self._results, self._symbols[0]))
        return ca.Function("slopes", self._symbols, [slope.entries]), slope.pattern

    @cached_property
    def _curvature(self) -> tuple[ca.Function, ca.Sparsity]:
        weights = ca.SX.sym("weights", self.count)
        matrix, _ = ca.hessian(ca.dot(weights, self._results), self._symbols[0])
        packed = Packed(matrix)
        return ca.Function("curvature", [*self._symbols, weights], [packed.entries]), packed.pattern

    @property
    def slope_pattern(self) -> Bools:
        """Derivatives (k, n) that may differ from zero."""
        return np.array(ca.DM(self._slopes[1], 1.0), dtype=bool)

    @property
    def curvature_pattern(self) -> Bools:
        """Second derivatives (n, n) that may differ from zero."""
        return np.array(ca.DM(self._curvature[1], 1.0), dtype=bool)

    @property
    def is_linear(self) -> bool:
        """True if all second derivatives are zero."""
        return bool(self._curvature[1].nnz() == 0)

    def values(self, variables: Array, constants: Array | None = None) -> Array:
        """Return the results (K, k) of variables (K, n) and constants (K, c)."""
        fixed = np.zeros((len(variables), 0)) if constants is None else constants
        (results,) = mapped(self._values, len(variables))(variables, fixed)
        return results.reshape(len(variables), self.count)

    def slopes(self, variables: Array, constants: Array | None = None) -> Array:
        """Return the derivatives (K, k, n) of the results by the variables."""
        fixed = np.zeros((len(variables), 0)) if constants is None else constants
        function, pattern = self._slopes
        (entries,) = mapped(function, len(variables))(variables, fixed)
        return matrices_of(pattern, entries, len(variables))

    def curvature(self, variables: Array, weights: Array, constants: Array | None = None) -> Array:
        """Return the second derivatives (K, n, n) of the sum of the results with these weights.

        Args:
            variables: of every evaluation, (K, n).
            weights: of every result, (K, k).
            constants: of every evaluation, (K, c).
        """
        fixed = np.zeros((len(variables), 0)) if constants is None else constants
        function, pattern = self._curvature
        (entries,) = mapped(function, len(variables))(variables, fixed, weights)
        return matrices_of(pattern, entries, len(variables))


def matrices_of(pattern: ca.Sparsity, entries: Array, count: int) -> Array:
    """Return matrices (count, rows, columns) of one pattern from their entries, one matrix after another.

    Args:
        pattern: places of the entries.
        entries: those of all matrices, (count * nonzeros,).
        count: number of matrices.
    """
    rows, columns = pattern.shape
    table = np.zeros((count, rows * columns))
    row, column = (np.array(part, dtype=int) for part in pattern.get_triplet())
    table[:, row * columns + column] = entries.reshape(count, -1)
    return table.reshape(count, rows, columns)
