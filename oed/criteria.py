"""Optimality criteria: information matrices to one number, larger is better.

A criterion says two things: its value for given matrices, and how an optimiser maximises it with smooth
constraints. The value alone is ever reported.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import casadi as ca
import numpy as np
import numpy.typing as npt

from oed.component import Component
from oed.expression import Expression
from oed.information import Scaling

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Epigraph:
    """A criterion as smooth optimisation: maximise `objective` over `variables` with `equalities` = 0.

    Attributes:
        objective: scalar expression to maximise; equals the criterion's value where it is maximal.
        variables: auxiliary unknowns, (k,).
        equalities: expressions that must vanish, (e,).
        initial: values (k,) of the auxiliary unknowns for given numeric matrices.
    """

    objective: Expression
    variables: Expression
    equalities: Expression
    initial: Callable[[Sequence[Array]], Array]


class Criterion(Component, ABC):
    """A number for how informative a drive is; larger is better."""

    kind: str
    scaling: Scaling = "relative"

    @abstractmethod
    def value(self, matrices: Sequence[Array]) -> Array:
        """The criterion (...,) of information matrices (..., p, p), one matrix per block."""

    def concede(self, value: float, share: float) -> float:
        """The value that remains when only `share` of `value` is asked for."""
        return value - (1.0 - share) * abs(value)

    @abstractmethod
    def epigraph(self, matrices: Sequence[Expression]) -> Epigraph:
        """The criterion of symbolic matrices in a form an interior-point solver can maximise."""


class E(Criterion):
    """E-optimality: the smallest eigenvalue, over all blocks [Choi, eq. 18].

    Maximised as t with F - t I = L L', L lower triangular and free: this keeps its constraint
    qualification where eigenvalues meet, which is where the optimum lies.
    """

    kind: Literal["E"] = "E"

    def value(self, matrices: Sequence[Array]) -> Array:
        """lambda_min, the smallest over the blocks."""
        # Information is positive semidefinite: what is below 0 is rounding.
        smallest = [np.maximum(np.linalg.eigvalsh(matrix)[..., 0], 0.0) for matrix in matrices]
        return np.asarray(np.min(smallest, axis=0))

    def epigraph(self, matrices: Sequence[Expression]) -> Epigraph:
        """Maximise t with F_b - t I = L_b L_b' for every block b."""
        level = ca.SX.sym("t")
        variables, equalities = [level], []
        for matrix in matrices:
            size = matrix.shape[0]
            factor = ca.SX.sym("L", ca.Sparsity.lower(size))
            residual = matrix - level * ca.SX.eye(size) - factor @ factor.T
            variables.append(ca.vertcat(*factor.nonzeros()))
            equalities.append(ca.vertcat(*ca.tril(residual).nonzeros()))
        return Epigraph(level, ca.vertcat(*variables), ca.vertcat(*equalities), self._initial)

    def _initial(self, matrices: Sequence[Array]) -> Array:
        # A little below lambda_min, so that every factor exists; tiny pivots keep L away from 0.
        level = 0.9 * float(self.value(matrices))
        parts = [np.array([level])]
        for matrix in matrices:
            size = len(matrix)
            shift = level - 1e-6 * (1.0 + np.trace(matrix) / size)
            factor = np.linalg.cholesky(matrix - shift * np.eye(size))
            columns, rows = np.triu_indices(size)  # lower triangle, column by column, as CasADi stores it
            parts.append(factor[rows, columns])
        return np.concatenate(parts)


CRITERIA: tuple[type[Criterion], ...] = (E,)
