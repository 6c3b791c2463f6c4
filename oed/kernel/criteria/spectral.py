"""Criteria of the eigenvalues: E, and modified E."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Literal

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.kernel.criteria.criterion import Epigraph, Factor, RootCriterion, multipliers_of
from oed.kernel.dynamics.expression import Expression
from oed.kernel.measurement.square_root import SquareRoot

FAINTEST = 1e-3
"""Least eigenvalue, in the matrices' units (an optimiser's are typical ones), that modified E searches."""


class E(RootCriterion):
    """E-optimality: the smallest eigenvalue, over all blocks [Choi, eq. 18].

    Maximised as t with F - t I = L L', L lower triangular and free: this keeps its constraint
    qualification where eigenvalues meet, which is where the optimum lies.
    """

    number: ClassVar[str] = "λ_min"
    definition: ClassVar[str] = "the smallest eigenvalue of the information"
    share: ClassVar[str] = "λ_min/λ_min,best (the worst-determined combination of the parameters)"
    asks_about: ClassVar[str] = "the worst-determined combination of parameters"
    typical_error: ClassVar[str] = "the standard error of the least certain combination of parameters"
    proportional: ClassVar[bool] = True
    conjugate: ClassVar[str] = "linear"
    kind: Literal["E"] = "E"

    def judge(self, information: Sequence[SquareRoot]) -> Array:
        """lambda_min, the smallest over the blocks; 0 where some combination is not identifiable."""
        return np.asarray(np.min([root.smallest for root in information], axis=0))

    def supergradient(self, matrix: Array, dual: Array | None = None) -> Array:
        """Z = v v' of the least certain combination v, or Z >= 0 of trace 1 from the multipliers of
        F - t I = L L': any such Z bounds, and is one where it lies on the eigenspace of lambda_min.
        """
        multipliers = multipliers_of(dual)
        if multipliers is None:
            least = np.linalg.eigh(matrix)[1][:, 0]
            return np.outer(least, least)
        return np.asarray(multipliers / np.trace(multipliers))

    def homogeneous_bound(self, matrix: Array, root: Array, most: float) -> float:
        """lambda_min(F') <= tr(Z F') / tr(Z), for any Z >= 0."""
        return most / float(np.sum(root**2))

    def trace_bound(self, multiplier: Array, most: float) -> float:
        """Tr(Z F) >= lambda_min tr Z."""
        return most / float(np.trace(multiplier))

    def epigraph(self, matrices: Sequence[Expression]) -> Epigraph:
        """Maximise t with F_b - t I = L_b L_b' for every block b."""
        level = ca.SX.sym("t")
        factors = [Factor("L", matrix.shape[0]) for matrix in matrices]
        equalities = [
            factor.residuals(matrix - level * ca.SX.eye(factor.size))
            for factor, matrix in zip(factors, matrices, strict=True)
        ]

        def initial(numeric: Sequence[Array]) -> Array:
            # A little below lambda_min, so that every factor exists; tiny pivots keep L away from 0.
            start = 0.9 * float(self.value(numeric))
            parts = [np.array([start])]
            for factor, matrix in zip(factors, numeric, strict=True):
                shift = start - 1e-6 * (1.0 + np.trace(matrix) / factor.size)
                parts.append(factor.initial(matrix - shift * np.eye(factor.size)))
            return np.concatenate(parts)

        variables = ca.vertcat(level, *(factor.variables for factor in factors))
        return Epigraph(level, variables, ca.vertcat(*equalities), initial)


class ModifiedE(RootCriterion):
    """Modified E-optimality: minus the condition number of F, the worst over the blocks.

    It asks for equally good precision in all directions, however poor. Maximised as -k with
    s F - I = L L' and k I - s F = M M', s free: without a quotient of eigenvalues. Only s <= 1/`FAINTEST`
    keeps a search from drives that identify nothing, and that equally well.
    """

    number: ClassVar[str] = "-cond(F)"
    definition: ClassVar[str] = "minus the condition number of the information"
    kind: Literal["modified_E"] = "modified_E"

    def judge(self, information: Sequence[SquareRoot]) -> Array:
        """-lambda_max / lambda_min, minus infinity where some combination is not identifiable."""
        identifiable = self.identifiable(information)
        ratios = [root.largest / np.where(identifiable, root.smallest, 1.0) for root in information]
        return np.where(identifiable, -np.max(ratios, axis=0), -np.inf)

    def epigraph(self, matrices: Sequence[Expression]) -> Epigraph:
        """Maximise -k with I <= s_b F_b <= k I for every block b."""
        worst = ca.SX.sym("k")
        variables, equalities, pairs = [worst], [], []
        for matrix in matrices:
            size, spare = matrix.shape[0], ca.SX.sym("spare")
            scale = 1 / (FAINTEST * (1 + spare**2))
            above, below = Factor("L", size), Factor("M", size)
            identity = ca.SX.eye(size)
            equalities.append(above.residuals(scale * matrix - identity))
            equalities.append(below.residuals(worst * identity - scale * matrix))
            variables += [spare, above.variables, below.variables]
            pairs.append((above, below))

        def initial(numeric: Sequence[Array]) -> Array:
            # A little apart from the extremes, so that both factors exist.
            smallest = [
                max(np.linalg.eigvalsh(matrix)[0], 1e-6 * np.trace(matrix), 1e-12) for matrix in numeric
            ]
            largest = [np.linalg.eigvalsh(matrix)[-1] for matrix in numeric]
            start = 1.2 * max(top / low for top, low in zip(largest, smallest, strict=True))
            parts = [np.array([start])]
            for (above, below), matrix, low in zip(pairs, numeric, smallest, strict=True):
                scaled, identity = 1.1 * matrix / low, np.eye(len(matrix))
                beyond = max(low / (1.1 * FAINTEST) - 1, 0.0)
                parts += [np.array([np.sqrt(beyond)]), above.initial(scaled - identity)]
                parts.append(below.initial(start * identity - scaled))
            return np.concatenate(parts)

        return Epigraph(-worst, ca.vertcat(*variables), ca.vertcat(*equalities), initial)

    def efficiency(self, value: float, best: float, size: int) -> float | None:
        """Return no efficiency: repeating a design leaves the condition number as it is."""
        return None
