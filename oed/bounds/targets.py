"""What is bounded on a lattice: a concave criterion of F (2, 2), for which each Z >= 0 gives a bound."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import scipy

from oed.bounds.mixtures import best_mixture
from oed.foundation.arrays import Array
from oed.kernel.criteria import Criterion, E

DIRECTIONS = 96
"""Corners of the polygon inside which Z of E is sought; every Z inside is valid."""
ENOUGH = 1e-5
"""Share by which one more cutting plane has to lower a bound."""
FAINT = 1e-3
"""Share of their mean eigenvalue that is added to matrices that identify too little for a Z > 0."""


@dataclass(frozen=True)
class Target(ABC):
    """A criterion of F + constant.

    Attributes:
        criterion: of two parameters.
        constant: (2, 2), e.g. a prior's information.
    """

    criterion: Criterion
    constant: Array

    def beside(self, constant: Array) -> Self:
        """That criterion of F + another constant."""
        return replace(self, constant=constant)

    def bound(self, multiplier: Array, most: float) -> float:
        """What the criterion is at most where tr(Z F) is; -inf where there is no F at all."""
        if not np.isfinite(most):
            return most
        return self._bound(multiplier, most + float(np.sum(multiplier * self.constant)))

    @abstractmethod
    def _bound(self, multiplier: Array, most: float) -> float:
        """What the criterion is at most where tr(Z (F + constant)) is at most `most`."""

    @abstractmethod
    def values(self, matrices: Array) -> Array:
        """The criterion of matrices (..., 2, 2), the constant included, (...,)."""

    @abstractmethod
    def excess(self, bound: float, value: float) -> float:
        """By which share a bound is more than a value."""

    @abstractmethod
    def near(self, bound: float, least: float) -> bool:
        """Whether no Z can lower a bound by enough, when none is known to bring it below `least`."""

    @abstractmethod
    def lowest(self, matrices: Sequence[Array]) -> tuple[float, Array, Array]:
        """The lowest bound of all Z for these matrices, that Z with trace 1, and the matrices' shares in the
        best mixture of them.
        """


class _Smallest(Target):
    """The smallest eigenvalue, by linear programming over Z of trace 1."""

    def _bound(self, multiplier: Array, most: float) -> float:
        return most

    def values(self, matrices: Array) -> Array:
        return np.asarray(np.linalg.eigvalsh(matrices)[..., 0])

    def excess(self, bound: float, value: float) -> float:
        return bound / value - 1 if value > 0 else 0.0 if bound <= value else np.inf

    def near(self, bound: float, least: float) -> bool:
        return bound - least <= ENOUGH * abs(bound)

    def lowest(self, matrices: Sequence[Array]) -> tuple[float, Array, Array]:
        least, point, shares = _lowest([_plane(one) for one in matrices])
        return least, _multiplier(point), shares


class _Smooth(Target):
    """D or A, by the best mixture, whose supergradient is the best Z."""

    def _bound(self, multiplier: Array, most: float) -> float:
        return self.criterion.trace_bound(multiplier, most)

    def values(self, matrices: Array) -> Array:
        return np.asarray(self.criterion.value([matrices]))

    def excess(self, bound: float, value: float) -> float:
        return self.criterion.change(bound, value, 2) if np.isfinite(value) else np.inf

    def near(self, bound: float, least: float) -> bool:
        return self.excess(bound, least) <= ENOUGH

    def lowest(self, matrices: Sequence[Array]) -> tuple[float, Array, Array]:
        each = np.stack(matrices)
        known, judged = np.zeros((2, 2)), 2
        groups, totals = np.zeros(len(each), dtype=np.int64), np.ones(1)
        found = best_mixture(self.criterion, each, known, judged, groups, totals)
        if found is not None:
            return found.value, found.multiplier / np.trace(found.multiplier), found.weights
        mean = each.mean(axis=0)
        faint = FAINT * (np.trace(mean) or 1.0) / 2
        multiplier = self.criterion.supergradient(mean + faint * np.eye(2))
        assert multiplier is not None
        return -np.inf, multiplier / np.trace(multiplier), np.full(len(each), 1 / len(each))


def target_of(criterion: Criterion, constant: Array) -> Target:
    """What is bounded.

    Args:
        criterion: E, D or A.
        constant: that is added to F, (2, 2).
    """
    return (_Smallest if type(criterion) is E else _Smooth)(criterion, constant)


def _multiplier(point: Array) -> Array:
    # Z = (I + point . Pauli) / 2 for a point in the unit disc.
    return np.array([[1 + point[0], point[1]], [point[1], 1 - point[0]]]) / 2


def _plane(matrix: Array) -> tuple[float, Array]:
    # tr(Z F) = offset + slope . point.
    return float(np.trace(matrix)) / 2, np.array([(matrix[0, 0] - matrix[1, 1]) / 2, matrix[0, 1]])


def _lowest(planes: list[tuple[float, Array]]) -> tuple[float, Array, Array]:
    # The lowest point of the planes' maximum over a polygon inside the disc, and the planes' shares in it.
    angles = 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    sides = np.stack([np.cos(angles), np.sin(angles), np.zeros(DIRECTIONS)], axis=1)
    size = max(abs(offset) for offset, _ in planes) or 1.0
    rows = [np.concatenate([slope / size, [-1.0]]) for _, slope in planes]
    offsets = [-offset / size for offset, _ in planes]
    found = scipy.optimize.linprog(
        [0.0, 0.0, 1.0],
        A_ub=np.vstack([rows, sides]),
        b_ub=np.concatenate([offsets, np.full(DIRECTIONS, np.cos(np.pi / DIRECTIONS))]),
        bounds=[(None, None)] * 3,
        method="highs",
    )
    shares = -np.asarray(found.ineqlin.marginals[: len(planes)])
    return float(found.x[2]) * size, np.asarray(found.x[:2]), np.asarray(shares)
