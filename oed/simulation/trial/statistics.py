"""What repeats say: medians and scatter, with intervals by the bootstrap over repeats."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

COVERED = (2.5, 97.5)
"""Percentiles that an interval lies between."""
STREAM = 31
"""Of the random numbers that resamples are drawn from."""


@dataclass(frozen=True)
class Interval:
    """A number with the interval that holds 95 % of the resamples."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Repeats:
    """What repeats on one floor found; infinite or NaN where a calibration was refused.

    Attributes:
        errors: a number of each repeat, (repeats, drives, fits) [m].
        resamples: how many.
        seed: of the resamples.
    """

    errors: Array
    resamples: int
    seed: int

    @cached_property
    def picks(self) -> npt.NDArray[np.int64]:
        """Repeats of every resample, drawn with replacement, (resamples, repeats)."""
        count = len(self.errors)
        return np.random.default_rng([self.seed, STREAM]).integers(count, size=(self.resamples, count))

    @cached_property
    def medians(self) -> Array:
        """Over the repeats, (drives, fits) [m]."""
        return np.asarray(np.median(self.errors, axis=0))

    @cached_property
    def resampled(self) -> Array:
        """Medians of every resample, (resamples, drives, fits)."""
        return np.asarray(np.median(self.errors[self.picks], axis=1))

    def median(self, drive: int, fit: int) -> Interval:
        """The median error of one drive and fit [m]."""
        return interval(self.medians[drive, fit], self.resampled[:, drive, fit])


def interval(value: float, resampled: Array) -> Interval:
    """A number with the percentiles of its resamples."""
    # Neighbours, not means of them: some may be infinite.
    low, high = np.percentile(resampled, COVERED, method="nearest")
    return Interval(float(value), float(low), float(high))


def scatter(values: Array, scales: Array) -> Array:
    """Standard deviations over repeats relative to the parameters' sizes.

    Args:
        values: estimates, (..., repeats, p).
        scales: sizes (p,).

    Returns:
        (..., p); NaN of less than two repeats.
    """
    if values.shape[-2] < 2:
        return np.full((*values.shape[:-2], values.shape[-1]), np.nan)
    return np.asarray(np.std(values, axis=-2, ddof=1) / scales)


def total(relative: Array) -> Array:
    """Root mean square over the parameters (..., p) of their relative scatter."""
    return np.asarray(np.sqrt(np.mean(relative**2, axis=-1)))
