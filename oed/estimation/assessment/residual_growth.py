"""By how much residuals grow with the twist: the part of them that a model leaves, not the sensor."""

from __future__ import annotations

import numpy as np
import scipy

from oed.foundation.arrays import Array

ROUNDS = 20
"""Of weights by the variances found, which then hardly change."""


def growth(residuals: Array, speeds: Array, yaw_rates: Array) -> tuple[float, float, float]:
    """Standard deviations s, k_v, k_w of residuals whose variance is s^2 + (k_v V)^2 + (k_w Omega)^2: what is
    there at rest, per speed and per yaw rate.

    Squares of residuals are fitted by least squares, none of the three below 0, weighted as squares of
    normal errors scatter: by the variances found [McCullagh and Nelder, Generalized Linear Models, 1989].

    Args:
        residuals: (n,).
        speeds: V then, (n,).
        yaw_rates: Omega then, (n,).
    """
    squares = residuals**2
    terms = np.column_stack([np.ones_like(speeds), speeds**2, yaw_rates**2])
    sizes = np.where(terms.any(axis=0), terms.max(axis=0), 1.0)
    least = 1e-6 * (squares.mean() or 1.0)
    variances, found = np.full(len(squares), 1.0), np.zeros(3)
    for _ in range(ROUNDS):
        found = scipy.optimize.nnls(terms / sizes / variances[:, None], squares / variances)[0]
        variances = np.maximum(terms / sizes @ found, least)
    at_rest, per_speed, per_yaw_rate = np.sqrt(found / sizes)
    return float(at_rest), float(per_speed), float(per_yaw_rate)
