"""Regression on measured headings: many replicates at once, and the bias that their noise causes taken out.

W~ is the position regression's design where every sample's heading has an error e of its own, which turns
each sample's rows of W by e. With k = E[cos e] the sums W~ have mean k W and
E[W~'W~] = k^2 W'W + (1 - k^2) S1, with S1 the sum over single samples.

Replicates come last, in designs (rows, q, R) and readings (rows, R): what is summed over rows is then summed
for all replicates together, on contiguous numbers.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import groupby, pairwise

import numpy as np
import numpy.typing as npt

from oed.foundation.arrays import Array, Places

Complex = npt.NDArray[np.complex128]

BLOCK = 2**16
"""Heading errors worked on together: few enough to stay in a processor's cache, 0.5 MB an array."""


class MeasuredHeadings:
    """Each sample's rows of W turned by its own heading error, then summed by segment.

    Args:
        per_sample: rows x, y of single samples at the true headings, (N, 2, q).
        edges: sample indices (P + 1,) at which segments begin and end.
    """

    def __init__(self, per_sample: Array, edges: Places) -> None:
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


def _stretches(edges: Places) -> Iterator[tuple[slice, slice]]:
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


def normal_equations(designs: Array, measured: Array) -> tuple[Array, Array]:
    """W'W (R, q, q) and W'y (R, q) of each replicate.

    Args:
        designs: W, (rows, q, R).
        measured: y, (rows, R).
    """
    _, columns, count = designs.shape
    normal, right = np.empty((count, columns, columns)), np.empty((count, columns))
    for row in range(columns):
        right[:, row] = _dot(designs[:, row], measured)
        for column in range(row + 1):
            normal[:, row, column] = normal[:, column, row] = _dot(designs[:, row], designs[:, column])
    return normal, right


def least_squares(designs: Array, measured: Array) -> Array:
    """Ordinary least squares of each replicate, (rows, q, R) and (rows, R) to (R, q) [Choi, eq. 16]."""
    return _solved(*normal_equations(designs, measured))


def _solved(normal: Array, right: Array) -> Array:
    return np.asarray(np.linalg.solve(normal, right[..., None])[..., 0])


def _dot(first: Array, second: Array) -> Array:
    return np.asarray(np.einsum("ir,ir->r", first, second))


def shrinkage(heading_noise: float) -> float:
    """K = E[cos e] of a Gaussian heading error with that standard deviation [rad]."""
    return math.exp(-(heading_noise**2) / 2)


def corrected(designs: Array, measured: Array, per_sample: Array, heading_noise: float) -> Array:
    """Estimates (R, q): [W~'W~/k^2 - (k^-2 - 1) S1]^-1 W~'y/k.

    Args:
        designs: W~ of each replicate, (rows, q, R).
        measured: y, (rows, R).
        per_sample: rows of single samples, (N, 2, q).
        heading_noise: standard deviation of a measured heading [rad].
    """
    shrink = shrinkage(heading_noise)
    own = per_sample.reshape(-1, per_sample.shape[-1])
    normal, right = normal_equations(designs, measured)
    return _solved(normal / shrink**2 - (shrink**-2 - 1) * (own.T @ own), right / shrink)


def corrected_covariance(
    rows: Complex,
    edges: Places,
    coefficients: Array,
    *,
    heading_noise: float,
    spread: Array,
    variance: float,
) -> Array:
    """Covariance (q, q) of the corrected estimates, to first order in the estimating equation's error.

    That error has three parts: the displacements' noise, against W and against the part of W~ that the
    headings scatter; the headings' scatter of the predicted displacement, against W but for each sample's
    own length, which no heading changes; and the same against itself, for pairs of samples in one segment.

    Args:
        rows: each sample's rows of W, x + j y, (N, q).
        edges: sample indices (P + 1,) of the segments.
        coefficients: true values, (q,).
        heading_noise: standard deviation of a measured heading [rad].
        spread: W' R W with R the displacements' covariance, (q, q).
        variance: of one displacement's coordinate.
    """
    shrink = shrinkage(heading_noise)
    # Moments of v = e^(j e) - k: E|v|^2 and E v^2.
    size, square = 1 - shrink**2, shrink**4 - shrink**2
    designs = np.array([rows[first:last].sum(axis=0) for first, last in pairwise(edges)])
    normal = (designs.conj().T @ designs).real
    own = (rows.conj().T @ rows).real
    total = spread + variance * (shrink**-2 - 1) * own
    for design, (first, last) in zip(designs, pairwise(edges), strict=True):
        part = rows[first:last]
        moves = part @ coefficients
        total = total + _against_design(part.conj(), design.conj(), moves, size, square) / shrink**2
        total = total + _against_itself(part.conj(), moves, size, square) / shrink**4
    inverse = np.linalg.inv(normal)
    return np.asarray(inverse @ total @ inverse)


def _against_design(rows: Complex, design: Complex, moves: Complex, size: float, square: float) -> Array:
    # Covariance of Re(sum v_k (g a_k - 2 Re(g_k a_k))): no sample's own heading scatters its length.
    own = (rows * moves[:, None]).real
    pulls = np.outer(moves, design) - 2 * own
    return np.asarray((size * pulls.T @ pulls.conj() + square * pulls.T @ pulls).real / 2)


def _against_itself(rows: Complex, moves: Complex, size: float, square: float) -> Array:
    # Covariance of Re(sum over k != l of conj(v_k) v_l g_k a_l).
    weights = np.abs(moves) ** 2
    gram, plain = rows.T @ rows.conj(), rows.T @ rows
    own_gram = (rows * weights[:, None]).T @ rows.conj()
    own_plain = (rows * (moves**2)[:, None]).T @ rows
    crossed, crossed_plain = rows.T @ moves.conj(), rows.T @ moves
    hermitian = size**2 * (gram * weights.sum() - own_gram)
    hermitian = hermitian + square**2 * (np.outer(crossed, crossed.conj()) - own_gram)
    symmetric = square**2 * (plain * (moves**2).sum() - own_plain)
    symmetric = symmetric + size**2 * (np.outer(crossed_plain, crossed_plain) - own_plain)
    return np.asarray((hermitian + symmetric).real / 2)
