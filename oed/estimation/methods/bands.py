"""Symmetric matrices kept as their lower band; that of S blocks of side m is (2 m, m S), of windows (6, 3 S).

Entry (j + d, j) of the matrix is entry (d, j) of the band. What is beyond the matrix's end is 0.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy

from oed.foundation.arrays import Array

SIDE = 3
"""Of a block."""
ROWS = 2 * SIDE
"""Of a band."""


def banded(own: Array, below: Array | None = None) -> Array:
    """The band of a matrix.

    Args:
        own: blocks on its diagonal, (S, m, m).
        below: those below them, (S - 1, m, m); 0 by default.
    """
    side = own.shape[-1]
    band = np.zeros((2 * side, side * len(own)))
    for row, column in np.ndindex(side, side):
        if row >= column:
            band[row - column, column::side] = own[:, row, column]
        if below is not None:
            band[side + row - column, column:-side:side] = below[:, row, column]
    return band


def band_of(matrix: Any, width: int) -> Array:
    """The lower band (width + 1, n) of a sparse symmetric matrix (n, n)."""
    return np.stack(
        [np.pad(matrix.diagonal(-off), (0, min(off, matrix.shape[0]))) for off in range(width + 1)]
    )


def factor(band: Array) -> Array:
    """The band of the lower triangular L of a positive matrix L L'."""
    return np.asarray(scipy.linalg.cholesky_banded(band, lower=True))


def whitened(root: Array, rows: Array) -> Array:
    """L^-1 times rows (n, k): as independent of each other as their noise L L' makes them."""
    found, _ = scipy.linalg.lapack.dtbtrs(root, rows, uplo="L")
    return np.asarray(found)


def weighted(root: Array, white: Array) -> Array:
    """L^-T times rows (n, k)."""
    found, _ = scipy.linalg.lapack.dtbtrs(root, white, uplo="L", trans="T")
    return np.asarray(found)


def product(left: Array, right: Array) -> Array:
    """The band of left @ right.T, both (3 S, k), where that is symmetric."""
    band = np.zeros((ROWS, len(left)))
    for off in range(min(ROWS, len(left))):
        band[off, : len(left) - off] = (left[off:] * right[: len(left) - off]).sum(axis=1)
    return band


def form(band: Array, rows: Array) -> Array:
    """rows.T @ matrix @ rows, (k, k), of rows (n, k)."""
    found = np.asarray((band[0, :, None] * rows).T @ rows)
    for off in range(1, min(ROWS, band.shape[1])):
        across = (band[off, :-off, None] * rows[off:]).T @ rows[:-off]
        found += across + across.T
    return found


def traces(bands: Array, band: Array) -> Array:
    """Traces (k,) of the products of matrices (k, 6, 3 S) with another."""
    twice = np.full((ROWS, 1), 2.0)
    twice[0] = 1.0
    return np.asarray(np.tensordot(bands, twice * band, axes=2))


def inverse(root: Array) -> Array:
    """The band of (L L')^-1, whose other entries are not 0 but are not needed.

    [Takahashi, Fagan, Chen: Formation of a sparse bus impedance matrix, 1973]
    """
    count = root.shape[1] // SIDE
    own, below = np.zeros((count, SIDE, SIDE)), np.zeros((count, SIDE, SIDE))
    for row, column in np.ndindex(SIDE, SIDE):
        below[:, row, column] = root[SIDE + row - column, column::SIDE]
        if row >= column:
            own[:, row, column] = root[row - column, column::SIDE]
    across = np.linalg.inv(own)
    found, carried = across.transpose(0, 2, 1) @ across, below @ across
    back, last = carried.transpose(0, 2, 1), found[-1]
    for index in range(count - 2, -1, -1):
        last = found[index] = found[index] + back[index].dot(last).dot(carried[index])
    return banded(found, -found[1:] @ carried[:-1])
