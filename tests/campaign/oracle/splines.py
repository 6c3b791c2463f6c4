"""The drive: splines of the inputs, by SciPy's B-splines, run by run, and what the robot holds of them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.interpolate import BSpline

Array = npt.NDArray[Any]


@dataclass(frozen=True)
class Run:
    """One run: a spline of every input over `duration` [s], held in the middles of `samples` periods.

    Attributes:
        knots: clamped, (n + degree + 1,) [s].
        degree: of the spline.
        coefficients: (n, inputs).
        start: pose, (3,).
    """

    knots: Array
    degree: int
    coefficients: Array
    start: Array
    samples: int

    @property
    def duration(self) -> float:
        """Duration [s]."""
        return float(self.knots[-1])

    @property
    def period(self) -> float:
        """Sample period [s]."""
        return self.duration / self.samples

    @cached_property
    def held(self) -> Array:
        """Inputs (N, inputs) in each period: the spline in its middle; where a step is there, after it."""
        middles = (np.arange(self.samples) + 0.5) * self.period
        return self.spline(middles + (1e-12 * self.duration if self.degree == 0 else 0.0))

    @cached_property
    def spline(self) -> BSpline:
        """The curve."""
        return BSpline(self.knots, self.coefficients, self.degree, extrapolate=False)

    def dense(self, order: int, points: int) -> Array:
        """Values (K, inputs) of a derivative, at that many points inside every knot interval and, from both
        sides, at its ends.
        """
        breaks = np.unique(self.knots)
        # A share of a millionth inside: each side's own value where a derivative jumps.
        inside = np.linspace(1e-6, 1 - 1e-6, max(2, points))
        times = (breaks[:-1, None] + np.diff(breaks)[:, None] * inside).ravel()
        return self.at(order, times)

    def at(self, order: int, times: Array) -> Array:
        """Values (K, inputs) of a derivative at times [s]."""
        if order > self.degree:
            return np.zeros((len(times), self.coefficients.shape[1]))
        return self.spline.derivative(order)(times) if order else self.spline(times)


def clamped_run(duration: float, degree: int, coefficients: Array, start: Array, samples: int) -> Run:
    """A run on uniform clamped knots."""
    inner = np.linspace(0.0, duration, len(coefficients) - degree + 1)
    knots = np.concatenate([np.zeros(degree), inner, np.full(degree, duration)])
    return Run(knots, degree, coefficients, start, samples)


def polygon_run(held: Array, duration: float, start: Array, *, rest: bool) -> Run:
    """The run of a path file: straight lines through the periods' middles, from and to rest."""
    middles = (np.arange(len(held)) + 0.5) * (duration / len(held))
    ends = np.zeros((2, held.shape[1])) if rest else held[[0, -1]]
    knots = np.concatenate([[0.0, 0.0], middles, [duration, duration]])
    return Run(knots, 1, np.vstack([ends[:1], held, ends[1:]]), start, len(held))
