"""Concave criteria as functions of the weights of readings, with derivatives for an interior-point method.

S (p, p) is the information of F = K + sum w_k R_k'R_k on the judged parameters once all other unknowns are
eliminated. The Hessian of each objective by the weights is -U U' with few columns, so that nothing is ever as
large as the square of the number of readings.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from oed.foundation.arrays import Array
from oed.foundation.errors import UserMistake
from oed.kernel.criteria import A, Criterion, D, E, G, I
from oed.kernel.measurement.square_root import reduced
from oed.optimize.weight_program import Projection, WeightProgram

INSIDE = 0.9
"""Share of the way to the nearest bound that one step may go, and of the barrier that it may take away."""


@dataclass(frozen=True)
class Slope:
    """Derivatives of an objective by the weights and by its level, if it has one.

    Attributes:
        by_weight: derivatives by the weights, (n,).
        by_level: derivative by the level, (h,), h = 1 with a level and 0 without.
        curvature: U of the Hessian -U U' by the weights, (n, m).
        level_curvature: rows of U of the level, l, (h, m).
        dual_change: function from y = U'dx + l'dt, (m,), to the change of the level's multipliers.
    """

    by_weight: Array
    by_level: Array
    curvature: Array
    level_curvature: Array
    dual_change: Callable[[Array], Array]


class WeightObjective(ABC):
    """A concave function of the information, or the barrier problem with a level t below its criterion.

    Attributes:
        barriers: number of the barriers that keep the level below the criterion; 0 without a level.
    """

    barriers = 0

    def first_level(self, point: Projection) -> float:
        """Return a level below the criterion."""
        return 0.0

    def central(self, point: Projection, level: float, barrier: float) -> Array:
        """Return the multipliers of the level on the central path; (0,) without a level.

        Args:
            point: information at the weights.
            level: level t.
            barrier: barrier parameter mu.
        """
        return np.zeros(0)

    def length(self, dual: Array, change: Array) -> float:
        """Return the length of a change of the level's multipliers until one of them is 0, at most 1."""
        return longest(dual, change)

    def products(self, point: Projection, level: float, dual: Array) -> float:
        """Return the sum of the products of the level's distances and their multipliers.

        Args:
            point: information at the weights.
            level: level t.
            dual: multipliers of the level.
        """
        return 0.0

    def scale(self, point: Projection, level: float) -> float:
        """Return the size of the criterion, or of the level below it: the unit of tolerances."""
        return abs(level if self.barriers else self.value(point, level, 0.0))

    @abstractmethod
    def gradient(self, point: Projection, dual: Array) -> Array:
        """Return the gradient of the criterion by S, (p, p)."""

    @abstractmethod
    def value(self, point: Projection, level: float, barrier: float) -> float:
        """Return the objective; minus infinity where it has no value.

        Args:
            point: information at the weights.
            level: level t.
            barrier: barrier parameter mu.
        """

    @abstractmethod
    def slope(
        self, program: WeightProgram, point: Projection, level: float, barrier: float, dual: Array
    ) -> Slope:
        """Return the derivatives where the objective has a value.

        Args:
            program: rows and constraints.
            point: information at the weights.
            level: level t.
            barrier: barrier parameter mu.
            dual: multipliers of the level.
        """


class Volume(WeightObjective):
    """The objective log det S."""

    def __init__(self, size: int) -> None:
        """Store the number of judged combinations."""
        self.size = float(size)

    def scale(self, point: Projection, level: float) -> float:
        """Return the number of parameters: a change of all their variances by a factor of e."""
        return self.size

    def gradient(self, point: Projection, dual: Array) -> Array:
        """Return the gradient S^-1."""
        root = _inverse_root(point.information)
        return np.asarray(root.T @ root)

    def value(self, point: Projection, level: float, barrier: float) -> float:
        """Return the criterion log det S."""
        return _log_determinant(point.information)

    def slope(
        self, program: WeightProgram, point: Projection, level: float, barrier: float, dual: Array
    ) -> Slope:
        """Return the derivatives."""
        rows = point.judged @ _inverse_root(point.information).T
        columns, lines = np.triu_indices(rows.shape[1])
        squares = rows[:, columns] * rows[:, lines] * np.where(columns == lines, 1.0, np.sqrt(2.0))
        return _without_level(program, rows, np.hstack([squares, _products(rows, point.eliminated)]))


class SmallestEigenvalue(WeightObjective):
    """The barrier problem t + mu log det (S - t W), with multipliers Z (p, p)."""

    def __init__(self, weighing: Array) -> None:
        """Store the weighing W, (p, p)."""
        self.weighing, self.barriers = weighing, len(weighing)

    def first_level(self, point: Projection) -> float:
        """Return half of the smallest eigenvalue of S by W."""
        root = _inverse_root(point.information)
        return 0.5 / float(np.linalg.eigvalsh(root @ self.weighing @ root.T)[-1])

    def central(self, point: Projection, level: float, barrier: float) -> Array:
        """Return the multipliers mu (S - t W)^-1."""
        root = _inverse_root(point.information - level * self.weighing)
        return np.asarray(barrier * root.T @ root)

    def products(self, point: Projection, level: float, dual: Array) -> float:
        """Return tr Z (S - t W)."""
        return float(np.sum(dual * (point.information - level * self.weighing)))

    def length(self, dual: Array, change: Array) -> float:
        """Return the length of a change of Z until an eigenvalue is 0, at most 1."""
        root = _inverse_root(dual)
        return longest(np.ones(len(dual)), np.asarray(np.linalg.eigvalsh(root @ change @ root.T)))

    def gradient(self, point: Projection, dual: Array) -> Array:
        """Return the multipliers Z as gradient."""
        return dual

    def value(self, point: Projection, level: float, barrier: float) -> float:
        """Return the objective."""
        return level + barrier * _log_determinant(point.information - level * self.weighing)

    def slope(
        self, program: WeightProgram, point: Projection, level: float, barrier: float, dual: Array
    ) -> Slope:
        """Return the derivatives, the curvature by Z and X = S - t W as [Monteiro, 1997] does."""
        root, factor = _inverse_root(point.information - level * self.weighing), _root(dual)
        rows, weighted = point.judged @ root.T, point.judged @ factor.T
        curvature = np.hstack(
            [_products(rows, weighted) / np.sqrt(2.0), _products(weighted, point.eliminated)]
        )
        level_curvature = np.zeros((1, curvature.shape[1]))
        level_curvature[0, : self.barriers**2] = -(root @ self.weighing @ factor.T).ravel()

        def dual_change(change: Array) -> Array:
            turned = root.T @ change[: self.barriers**2].reshape(root.shape) @ factor
            return np.asarray(barrier * root.T @ root - dual - (turned + turned.T) / 2)

        return Slope(
            barrier * program.by_reading((rows**2).sum(axis=1)),
            np.array([1.0 - barrier * np.sum(root @ self.weighing * root)]),
            program.by_reading(curvature),
            level_curvature,
            dual_change,
        )


class LargestVariance(WeightObjective):
    """The objective minus the largest of several variances of predictions, -max tr C_l S^-1.

    One variance is an objective by itself. Several are the barrier problem
    t + mu sum log(-t - tr C_l S^-1), with a multiplier of each.
    """

    def __init__(self, predictions: Sequence[Array]) -> None:
        """Store rows (c, p) of each variance, whose square is C_l."""
        self.predictions = predictions
        self.barriers = len(predictions) if len(predictions) > 1 else 0

    def first_level(self, point: Projection) -> float:
        """Return a level below minus the largest variance."""
        return -1.5 * float(self._variances(point).max()) if self.barriers else 0.0

    def _variances(self, point: Projection) -> Array:
        root = _inverse_root(point.information)
        return np.array([np.sum((rows @ root.T) ** 2) for rows in self.predictions])

    def _spare(self, point: Projection, level: float) -> Array:
        return np.asarray(-level - self._variances(point))

    def _turned(self, point: Projection, dual: Array) -> Array:
        # Rows whose square is S^-1 C S^-1, where C is the mixture of all C_l.
        root, shares = _inverse_root(point.information), dual if self.barriers else np.ones(1)
        mixed = [share**0.5 * rows for share, rows in zip(shares, self.predictions, strict=True)]
        return reduced(np.vstack(mixed) @ root.T @ root)

    def products(self, point: Projection, level: float, dual: Array) -> float:
        """Return the sum of the products of the variances' distances and multipliers."""
        return float(dual @ self._spare(point, level)) if self.barriers else 0.0

    def central(self, point: Projection, level: float, barrier: float) -> Array:
        """Return the multipliers mu / (-t - tr C_l S^-1); (0,) of one variance."""
        return np.asarray(barrier / self._spare(point, level)) if self.barriers else np.zeros(0)

    def gradient(self, point: Projection, dual: Array) -> Array:
        """Return the gradient S^-1 C S^-1."""
        rows = self._turned(point, dual)
        return np.asarray(rows.T @ rows)

    def value(self, point: Projection, level: float, barrier: float) -> float:
        """Return the objective."""
        if not self.barriers:
            return -float(self._variances(point)[0])
        spare = self._spare(point, level)
        return level + barrier * float(np.log(spare).sum()) if spare.min() > 0 else -np.inf

    def slope(
        self, program: WeightProgram, point: Projection, level: float, barrier: float, dual: Array
    ) -> Slope:
        """Return the derivatives."""
        root, rows = _inverse_root(point.information), point.judged @ self._turned(point, dual).T
        curvature = _products(rows, point.whitened(root))
        if not self.barriers:
            return _without_level(program, rows, curvature)
        central = self.central(point, level, barrier)
        steep = np.sqrt(dual / self._spare(point, level))
        legs = [point.judged @ (leg @ root.T @ root).T for leg in self.predictions]
        falls = np.stack([(leg**2).sum(axis=1) for leg in legs], axis=1)
        curvature = np.hstack([falls * steep, curvature])
        level_curvature = np.zeros((1, curvature.shape[1]))
        level_curvature[0, : self.barriers] = -steep
        return Slope(
            program.by_reading(falls @ central),
            np.array([1.0 - central.sum()]),
            program.by_reading(curvature),
            level_curvature,
            lambda change: central - dual - steep * change[: self.barriers],
        )


def longest(values: Array, changes: Array) -> float:
    """Return the length of a change that keeps all values well above 0, at most 1."""
    falling = changes < 0
    return min(1.0, INSIDE * float(np.min(values[falling] / -changes[falling], initial=np.inf)))


def _without_level(program: WeightProgram, rows: Array, curvature: Array) -> Slope:
    by_weight, columns = program.by_reading((rows**2).sum(axis=1)), program.by_reading(curvature)
    empty = np.zeros(0)
    return Slope(by_weight, empty, columns, np.zeros((0, columns.shape[1])), lambda change: empty)


def _products(rows: Array, factors: Array) -> Array:
    # All products of the entries of two rows, times sqrt(2), (k, a b).
    return np.asarray(np.sqrt(2.0) * np.einsum("ka,kb->kab", rows, factors).reshape(len(rows), -1))


def _log_determinant(matrix: Array) -> float:
    # Minus infinity unless the matrix is positive definite.
    values = np.linalg.eigh(matrix)[0]
    return float(np.log(values).sum()) if values[0] > 0 else -np.inf


def _inverse_root(matrix: Array) -> Array:
    # V with V'V the inverse of a positive definite matrix, its rows orthogonal: large apart from small ones.
    values, vectors = np.linalg.eigh(matrix)
    return np.asarray((vectors / np.sqrt(values)).T)


def _root(matrix: Array) -> Array:
    # V with V'V a positive definite matrix, its rows orthogonal.
    values, vectors = np.linalg.eigh(matrix)
    return np.asarray((vectors * np.sqrt(values)).T)


def weight_objective(criterion: Criterion, units: Array) -> WeightObjective:
    """Return the objective of a criterion.

    Args:
        criterion: E, D, A, G or I.
        units: combinations of the judged parameters of which S is the information, (parameters, p).

    Raises:
        UserMistake: the criterion is none of these.
    """
    if isinstance(criterion, D):
        return Volume(units.shape[1])
    if isinstance(criterion, E):
        weighing = units.T @ units
        return SmallestEigenvalue(weighing / np.linalg.norm(weighing, 2))
    if isinstance(criterion, A):
        return LargestVariance([units / np.linalg.norm(units)])
    if not isinstance(criterion, G | I):
        text = f"{criterion.kind} is not concave: nothing says how good weights can be"
        raise UserMistake(f"{text}; use E, D, A, G or I")
    predictions = [np.array(rows) @ units for rows in criterion.rows[0]]
    largest = max(np.linalg.norm(rows) for rows in predictions)
    predictions = [rows / largest for rows in predictions]
    return LargestVariance([np.vstack(predictions)] if isinstance(criterion, I) else predictions)
