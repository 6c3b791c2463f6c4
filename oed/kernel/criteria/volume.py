"""Criteria of the confidence ellipsoid as a whole: D, its volume; A, its mean squared axis."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar, Literal

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.foundation.text import quantity
from oed.kernel.criteria.criterion import Criterion, Epigraph, RootCriterion, factored
from oed.kernel.dynamics.expression import Expression
from oed.kernel.measurement.square_root import SquareRoot


class D(RootCriterion):
    """D-optimality: log det F, all blocks together. Its optimum does not depend on the scaling."""

    number: ClassVar[str] = "log det F"
    definition: ClassVar[str] = "the logarithm of the information's determinant"
    share: ClassVar[str] = "(det F/det F_best)^(1/p), p = {size} (the volume of the confidence ellipsoid)"
    conceded: ClassVar[str] = "determinant"
    typical_error: ClassVar[str] = "the average standard error over all combinations of parameters"
    conjugate: ClassVar[str] = "smooth"
    kind: Literal["D"] = "D"

    def judge(self, information: Sequence[SquareRoot]) -> Array:
        """Log det of every block, summed; minus infinity where some combination is not identifiable."""
        return np.asarray(np.sum([root.log_determinant for root in information], axis=0))

    def supergradient(self, matrix: Array, dual: Array | None = None) -> Array:
        """F^-1."""
        return np.asarray(np.linalg.inv(matrix))

    def homogeneous_bound(self, matrix: Array, root: Array, most: float) -> float:
        """Log det F' <= p log(tr(Z F') / p) - log det Z, for any Z > 0."""
        return _volume_bound(len(root), 2 * float(np.linalg.slogdet(root)[1]), most)

    def trace_bound(self, multiplier: Array, most: float) -> float:
        """Log det(Z F) <= p log(tr(Z F) / p)."""
        sign, volume = np.linalg.slogdet(multiplier)
        return _volume_bound(len(multiplier), float(volume) if sign > 0 else -np.inf, most)

    def trace_slope(self, multiplier: Array, most: float) -> Array:
        """-Z^-1."""
        return np.asarray(-np.linalg.inv(multiplier))

    def epigraph(self, matrices: Sequence[Expression]) -> Epigraph:
        """Maximise 2 sum log L_ii with F_b = L_b L_b'."""
        return factored(
            matrices, lambda factors: sum(ca.sum1(ca.log(ca.diag(factor.matrix) ** 2)) for factor in factors)
        )

    def concede(self, value: float, share: float) -> float:
        """The value of a determinant `share` as large."""
        return value + math.log(share)

    def scaled(self, value: float, share: float, size: int) -> float:
        """Return the log determinant of information that is larger by a share."""
        return value + size * math.log1p(share)

    def deviation(self, value: float, size: int) -> str:
        """The geometric mean along the ellipsoid's axes."""
        name = "geometric mean of those along the ellipsoid's axes"
        return _mean(self, name, math.exp(-value / 2 / size), size)

    def efficiency(self, value: float, best: float, size: int) -> float | None:
        """(det F / det F_best)^(1 / p)."""
        return math.exp((value - best) / size) if math.isfinite(best) else None


class A(RootCriterion):
    """A-optimality: minus the summed variances, -tr F^-1, over all blocks."""

    number: ClassVar[str] = "-tr F⁻¹"
    definition: ClassVar[str] = "minus the sum of the variances"
    share: ClassVar[str] = "tr F_best⁻¹/tr F⁻¹ (the mean variance of the parameters)"
    typical_error: ClassVar[str] = "the parameters' average standard error"
    conjugate: ClassVar[str] = "smooth"
    kind: Literal["A"] = "A"

    def judge(self, information: Sequence[SquareRoot]) -> Array:
        """-tr F^-1, minus infinity where some combination is not identifiable."""
        traces = [(root.factor**2).sum(axis=(-2, -1)) for root in information]
        return np.where(self.identifiable(information), -np.sum(traces, axis=0), -np.inf)

    def supergradient(self, matrix: Array, dual: Array | None = None) -> Array:
        """F^-2."""
        inverse = np.linalg.inv(matrix)
        return np.asarray(inverse @ inverse)

    def homogeneous_bound(self, matrix: Array, root: Array, most: float) -> float:
        """Tr F'^-1 >= (tr Z^1/2)^2 / tr(Z F'), for any Z >= 0."""
        return _trace_bound(np.asarray(np.linalg.svd(root, compute_uv=False)), most)

    def trace_bound(self, multiplier: Array, most: float) -> float:
        """Tr F^-1 >= (tr Z^1/2)^2 / tr(Z F)."""
        return _trace_bound(np.sqrt(np.clip(np.linalg.eigvalsh(multiplier), 0.0, None)), most)

    def trace_slope(self, multiplier: Array, most: float) -> Array:
        """-tr(Z^1/2) Z^-1/2 / tr(Z F)."""
        values, vectors = np.linalg.eigh(multiplier)
        roots = np.sqrt(np.clip(values, np.finfo(float).tiny, None))
        return np.asarray(-(roots.sum() / most) * (vectors / roots) @ vectors.T)

    def epigraph(self, matrices: Sequence[Expression]) -> Epigraph:
        """Maximise -sum of squares of L_b^-1, with F_b = L_b L_b'."""
        return factored(
            matrices,
            lambda factors: -sum(ca.sumsqr(factor.inverse(ca.SX.eye(factor.size))) for factor in factors),
        )

    def deviation(self, value: float, size: int) -> str:
        """The root mean square of the parameters'."""
        return _mean(self, "root mean square of those of the parameters", math.sqrt(-value / size), size)

    def efficiency(self, value: float, best: float, size: int) -> float | None:
        """Ratio of the best design's summed variances to this one's."""
        return best / value if value < 0 and math.isfinite(best) else None


def _volume_bound(size: int, volume: float, most: float) -> float:
    # Of log det F, from log det Z and the most of tr(Z F): none by a Z that leaves something out.
    if volume == -np.inf:
        return np.inf
    return size * math.log(most / size) - volume if most > 0 else -np.inf


def _trace_bound(roots: Array, most: float) -> float:
    # Of -tr F^-1, from the roots of Z's eigenvalues and the most of tr(Z F).
    return -(float(roots.sum()) ** 2) / most if most > 0 else -np.inf


def _mean(criterion: Criterion, name: str, deviation: float, size: int) -> str:
    # Of one parameter, or of parameters in different units, a mean says nothing.
    relative = criterion.scaling == "relative" and size > 1
    return f"the {name} is {quantity(100 * deviation, '%')}" if relative else ""
