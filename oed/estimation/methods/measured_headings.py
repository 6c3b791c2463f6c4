"""W~: the position regression's design where every sample's heading is measured, with an error of its own."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby, pairwise

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

BLOCK = 2**16
"""Heading errors worked on together: few enough to stay in a processor's cache, 0.5 MB an array."""


class MeasuredHeadings:
    """Each sample's rows of W turned by its own heading error, then summed by segment.

    Args:
        per_sample: rows x, y of single samples at the true headings, (N, 2, q).
        edges: sample indices (P + 1,) at which segments begin and end.
    """

    def __init__(self, per_sample: Array, edges: npt.NDArray[np.int64]) -> None:
        """Arrange the rows by stretches of segments of equal length."""
        self._samples, _, self._columns = per_sample.shape
        self._segments = len(edges) - 1
        along, across = per_sample[:, 0].T, per_sample[:, 1].T
        # Turned by e: x cos e - y sin e and y cos e + x sin e, of all columns in one product each.
        of_cosine, of_sine = np.vstack([along, across]), np.vstack([-across, along])
        self._stretches = [
            (own, samples, _by_segment(of_cosine[:, samples], own), _by_segment(of_sine[:, samples], own))
            for own, samples in _stretches(edges)
        ]

    def blocks(self, count: int) -> Iterator[slice]:
        """Replicates 0 to `count` in turn, as many at a time as the cache holds."""
        size = max(1, BLOCK // self._samples)
        return (slice(first, min(first + size, count)) for first in range(0, count, size))

    def designs(self, errors: Array) -> Array:
        """W~ (2 P, q, R) of replicates with heading errors (R, N) [rad]."""
        cosine, sine = cosine_and_sine(errors)
        sums = np.empty((self._segments, 2 * self._columns, len(errors)))
        for own, samples, of_cosine, of_sine in self._stretches:
            # (segments, 2 q, length) by (segments, length, R).
            turned = of_cosine @ _by_segment(cosine[:, samples], own).transpose(0, 2, 1)
            turned += of_sine @ _by_segment(sine[:, samples], own).transpose(0, 2, 1)
            sums[own] = turned
        return sums.reshape(2 * self._segments, self._columns, len(errors))


def cosine_and_sine(angles: Array) -> tuple[Array, Array]:
    """Of angles [rad], by t = tan(angle / 2): 2 / (1 + t^2) - 1 and 2 t / (1 + t^2), to rounding.

    NumPy has a vectorised tangent of float64; its sine and cosine take several times as long.
    """
    sine = np.multiply(angles, 0.5)
    np.tan(sine, out=sine)
    cosine = np.multiply(sine, sine)
    cosine += 1.0
    np.divide(2.0, cosine, out=cosine)
    sine *= cosine
    cosine -= 1.0
    return cosine, sine


def _stretches(edges: npt.NDArray[np.int64]) -> Iterator[tuple[slice, slice]]:
    # Neighbouring segments of the same number of samples, with their samples.
    bounds = list(pairwise(edges.tolist()))
    first = 0
    for _, group in groupby(bounds, lambda ends: ends[1] - ends[0]):
        own = list(group)
        yield slice(first, first + len(own)), slice(own[0][0], own[-1][1])
        first += len(own)


def _by_segment(values: Array, segments: slice) -> Array:
    # (k, n) to (segments, k, length), a view.
    return values.reshape(len(values), segments.stop - segments.start, -1).transpose(1, 0, 2)
