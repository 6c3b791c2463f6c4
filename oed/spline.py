"""B-splines on a clamped uniform knot vector: evaluation matrices, nothing more.

A curve is `basis(t) @ coefficients`. The coefficients are also its convex hull: bounds on them hold for
the curve at all times (de Boor, A Practical Guide to Splines, ch. XI), which is how speed and
acceleration limits become linear constraints.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Band:
    """A matrix of a few neighbouring entries in every row: all that splines need of sparse matrices.

    Attributes:
        columns: n.
        first: column of each row's first entry, (m,).
        entries: of each row, (m, k).
    """

    columns: int
    first: npt.NDArray[np.int64]
    entries: Array

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return len(self.first), self.columns

    def __matmul__(self, other: Array) -> Array:
        """Product (m, ...) with an array (n, ...)."""
        wide = self.entries.reshape(*self.entries.shape, *(1,) * (other.ndim - 1))
        total = np.zeros((len(self.first), *other.shape[1:]))
        for offset in range(self.entries.shape[1]):
            total += wide[:, offset] * other[self.first + offset]
        return total

    def toarray(self) -> Array:
        """The matrix (m, n), zeros and all."""
        return self @ np.eye(self.columns)


def clamped_knots(duration: float, count: int, degree: int) -> Array:
    """Knots (count + degree + 1,) [s] of a uniform spline on [0, duration] that starts and ends at its
    first and last coefficient.

    Raises:
        ValueError: fewer coefficients than degree + 1.
    """
    if count < degree + 1:
        raise ValueError(f"a degree-{degree} spline needs at least {degree + 1} coefficients, got {count}")
    inner = np.linspace(0.0, duration, count - degree + 1)
    return np.concatenate([np.zeros(degree), inner, np.full(degree, duration)])


def repeated_knots(knots: Array, degree: int, times: int) -> Array:
    """Knots of so many splines on clamped `knots`, one after the other, nothing in common where they meet."""
    shifted = [knots[degree + 1 :] + index * knots[-1] for index in range(times)]
    return np.concatenate([knots[: degree + 1], *shifted])


def basis(knots: Array, degree: int, times: Array) -> Band:
    """Matrix (len(times), n): the value of every basis function at `times` [s] [de Boor, ch. X, eq. 4]."""
    count = len(knots) - degree - 1
    inside = np.clip(times, knots[degree], knots[-degree - 1])
    place = np.clip(np.searchsorted(knots, inside, side="right") - 1, degree, count - 1)
    values = np.zeros((degree + 1, len(inside)))
    values[0] = 1.0
    for order in range(1, degree + 1):
        lower, values[0] = values[:order].copy(), 0.0
        for index in range(1, order + 1):
            after, before = knots[place + index], knots[place + index - order]
            span = after - before
            share = np.divide(lower[index - 1], span, out=np.zeros_like(span), where=span > 0)
            values[index - 1] += share * (after - inside)
            values[index] = share * (inside - before)
    return Band(count, place - degree, values.T)


def derivative(knots: Array, degree: int) -> tuple[Band, Array]:
    """The derivative as a spline of one degree less: its coefficients' matrix (n - 1, n) and its knots.

    The matrix takes the curve's coefficients to those of its derivative [de Boor, ch. X, eq. 15]. Where two
    curves meet that have nothing in common, there is no derivative, and its coefficient is 0.

    Raises:
        ValueError: degree 0, whose derivative is not a function.
    """
    if degree == 0:
        raise ValueError("a piecewise constant spline has no derivative")
    count = len(knots) - degree - 1
    span = knots[degree + 1 : count + degree] - knots[1:count]
    scale = np.where(span > 0, degree / np.where(span > 0, span, 1.0), 0.0)
    return Band(count, np.arange(count - 1), np.column_stack([-scale, scale])), knots[1:-1]
