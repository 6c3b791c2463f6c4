"""What repeats say: medians, scatter and ratios, with intervals by the bootstrap over repeats."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Cells = Sequence[tuple[int, int]]

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
        """The same of every resample, (resamples, drives, fits)."""
        return np.asarray(np.median(self.errors[self.picks], axis=1))

    def median(self, drive: int, fit: int) -> Interval:
        """The median error of one drive and fit [m]."""
        return interval(self.medians[drive, fit], self.resampled[:, drive, fit])

    def ratio(self, one: Cells, other: Cells) -> Interval:
        """The least median of some (drive, fit) over the least of others, chosen anew in every resample."""
        with np.errstate(divide="ignore", invalid="ignore"):
            value = float(_least(self.medians, one) / _least(self.medians, other))
            resampled = _least(self.resampled, one) / _least(self.resampled, other)
        return interval(value, resampled)

    def best(self, cells: Cells) -> tuple[int, int]:
        """The (drive, fit) of least median."""
        return min(cells, key=lambda cell: float(self.medians[cell]))


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


def resampled_pair(
    one: Array, other: Array, picks: npt.NDArray[np.int64], judged: Callable[[Array], Array]
) -> Interval:
    """The ratio of a statistic of two sets of estimates (repeats, p) by the same repeats.

    Args:
        one: estimates.
        other: those to compare with.
        picks: repeats of every resample.
        judged: what is compared, of estimates (..., repeats, p).
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        return interval(float(judged(one) / judged(other)), judged(one[picks]) / judged(other[picks]))


def _least(medians: Array, cells: Cells) -> Array:
    drives, fits = np.transpose(np.array(cells))
    return np.asarray(medians[..., drives, fits].min(axis=-1))
