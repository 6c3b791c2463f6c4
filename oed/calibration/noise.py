"""How noisy readings are, judged by what the fit leaves: a part at rest and a part that grows with speed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize
from scipy.stats import chi2, norm

Array = npt.NDArray[np.float64]

GROUPS = {"x": "position", "y": "position"}
"""Quantities that share their noise; any other has its own."""
SURE = 0.99
"""Confidence with which noise has to grow with speed to be modelled so."""
LEAST = 1e-6
"""Smallest noise that is believed [m, rad]: exact logs leave residuals of rounding, or of exactly 0."""
MEDIAN_DEVIATION = float(norm.ppf(0.75))
"""Median of |z| for standard normal z."""


@dataclass(frozen=True)
class Noise:
    """Standard deviation sqrt(at_rest^2 + (per_speed V)^2) of a reading at speed V.

    Attributes:
        at_rest: [m] or [rad].
        per_speed: [s] or [rad s/m].
    """

    at_rest: float
    per_speed: float = 0.0

    def deviation(self, speeds: Array) -> Array:
        """At those speeds [m/s]."""
        return np.asarray(np.sqrt(self.at_rest**2 + (self.per_speed * speeds) ** 2))


def group_of(quantity: str) -> str:
    """The name of the noise that a quantity has."""
    return GROUPS.get(quantity, quantity)


def places_of(group: str, quantities: Sequence[str]) -> list[int]:
    """Which of the quantities have that noise."""
    return [place for place, name in enumerate(quantities) if group_of(name) == group]


def groups(quantities: Sequence[str]) -> tuple[str, ...]:
    """The noises of those quantities."""
    return tuple(dict.fromkeys(map(group_of, quantities)))


def deviations(noises: Mapping[str, Noise], quantities: Sequence[str], speeds: Array) -> Array:
    """Standard deviations (..., quantities) of readings at `speeds` (...)."""
    return np.stack([noises[group_of(name)].deviation(speeds) for name in quantities], axis=-1)


def estimated(residuals: Array, freedom: Array, speeds: Array, *, robust: bool, grows: bool) -> Noise:
    """The noise of residuals that a fit left.

    Args:
        residuals: (n,), SI.
        freedom: share of each residual's variance that the fit left, (n,).
        speeds: at their times, (n,) [m/s].
        robust: judge by the median, so that outliers do not matter; the noise is then constant.
        grows: whether a part that grows with speed is looked for.
    """
    if robust:
        spread = np.median(np.abs(residuals)) / MEDIAN_DEVIATION
        return Noise(max(float(spread / np.sqrt(max(freedom.mean(), 1e-3))), LEAST))
    squares = residuals**2 / np.maximum(freedom, 1e-3)
    # Less than one degree of freedom tells nothing of noise.
    constant = float(np.sqrt((residuals**2).sum() / max(freedom.sum(), 1.0)))
    if not grows or constant <= LEAST or speeds.max() <= 0:
        return Noise(max(constant, LEAST))
    return _growing(squares, freedom, speeds, constant)


def _growing(squares: Array, freedom: Array, speeds: Array, constant: float) -> Noise:
    # Greatest likelihood of r^2 / (s0^2 + (k v)^2), both parts in units of the constant one.
    unit = np.sqrt(np.mean(speeds**2)) or 1.0
    ratios, moving = squares / constant**2, (speeds / unit) ** 2

    def surprise(logs: Array) -> tuple[float, Array]:
        parts = np.exp(logs)
        variance = parts[0] + parts[1] * moving
        value = float((freedom * (np.log(variance) + ratios / variance)).sum())
        slope = freedom * (1 / variance - ratios / variance**2)
        return value, np.array([slope.sum() * parts[0], (slope * moving).sum() * parts[1]])

    found = minimize(surprise, np.log([0.5, 0.5]), jac=True, method="L-BFGS-B", bounds=[(-12, 6)] * 2)
    alone = float((freedom * ratios).sum())
    if alone - found.fun < chi2.ppf(SURE, 1):
        return Noise(constant)
    rest, growth = np.sqrt(np.exp(found.x)) * constant
    return Noise(float(rest), float(growth / unit))
