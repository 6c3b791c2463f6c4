"""B-splines on a clamped uniform knot vector: evaluation matrices, nothing more.

A curve is `basis(t) @ coefficients`. The coefficients are also its convex hull: bounds on them hold for
the curve at all times (de Boor, A Practical Guide to Splines, ch. XI), which is how speed and
acceleration limits become linear constraints.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.interpolate import BSpline

Array = npt.NDArray[np.float64]


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


def basis(knots: Array, degree: int, times: Array) -> sparse.csr_array:
    """Matrix (len(times), n): the value of every basis function at `times` [s], sparse."""
    inside = np.clip(times, knots[degree], knots[-degree - 1])
    return sparse.csr_array(BSpline.design_matrix(inside, knots, degree))


def derivative(knots: Array, degree: int) -> tuple[sparse.csr_array, Array]:
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
    matrix = sparse.diags_array([-scale, scale], offsets=[0, 1], shape=(count - 1, count), format="csr")
    return sparse.csr_array(matrix), knots[1:-1]
