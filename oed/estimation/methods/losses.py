"""Losses of residuals: least squares, and those that bound the influence of outliers."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

import numpy as np
import numpy.typing as npt
import scipy

from oed.estimation.setup.options import Loss

Array = npt.NDArray[np.float64]


def robust_loss(loss: Loss, squares: Array) -> Array:
    """Rho of squared residuals in units of the noise with its first two derivatives, (3, n), as scipy's."""
    if loss == "linear":
        return np.vstack([squares, np.ones_like(squares), np.zeros_like(squares)])
    if loss == "soft_l1":
        root = np.sqrt(1 + squares)
        return np.vstack([2 * (root - 1), 1 / root, -0.5 / root**3])
    if loss == "cauchy":
        more = 1 + squares
        return np.vstack([np.log(more), 1 / more, -1 / more**2])
    far = squares > 1
    safe = np.where(far, squares, 1.0)
    root = np.sqrt(safe)
    return np.vstack(
        [
            np.where(far, 2 * root - 1, squares),
            np.where(far, 1 / root, 1.0),
            np.where(far, -0.5 / (root * safe), 0.0),
        ]
    )


@cache
def loss_moments(loss: Loss) -> tuple[float, float]:
    """E[psi'(z)] and E[psi(z)^2] of a standard normal residual z, with psi(z) = z rho'(z^2)."""

    def slope(size: float) -> float:
        _, first, second = robust_loss(loss, np.array([size**2])).ravel()
        return float(first + 2 * size**2 * second)

    def square(size: float) -> float:
        return float((size * robust_loss(loss, np.array([size**2]))[1].item()) ** 2)

    return _normal_mean(slope), _normal_mean(square)


def _normal_mean(function: Callable[[float], float]) -> float:
    # Of an even function; losses change their form at 1.
    def weighted(size: float) -> float:
        return 2 * function(size) * math.exp(-(size**2) / 2) / math.sqrt(2 * math.pi)

    return float(scipy.integrate.quad(weighted, 0.0, 1.0)[0] + scipy.integrate.quad(weighted, 1.0, np.inf)[0])
