"""Regression on noisy headings: the bias they cause inside W, taken out, and what precision is left.

A heading measured with Gaussian error e turns each sample's rows of W by e. With k = E[cos e] the sums
W~ have mean k W and E[W~'W~] = k^2 W'W + (1 - k^2) S1, with S1 the sum over single samples.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from oed.estimation.methods.replicated import normal_equations, solved

Array = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]


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
    return solved(normal / shrink**2 - (shrink**-2 - 1) * (own.T @ own), right / shrink)


def corrected_covariance(
    rows: Complex,
    edges: npt.NDArray[np.int64],
    coefficients: Array,
    *,
    heading_noise: float,
    spread: Array,
    variance: float,
) -> Array:
    """Covariance (q, q) of the corrected estimates, to first order in what the estimating equation sees.

    That equation's error has three parts: the displacements' noise, against W and against the part of W~
    that the headings scatter; the headings' scatter of the predicted displacement, against W; and the
    same against itself, for pairs of samples in one segment.

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
        total = total + _against_design(design.conj(), moves, size, square) / shrink**2
        total = total + _against_itself(part.conj(), moves, size, square) / shrink**4
    inverse = np.linalg.inv(normal)
    return np.asarray(inverse @ total @ inverse)


def _against_design(design: Complex, moves: Complex, size: float, square: float) -> Array:
    # Covariance of Re(g z) with z = sum v_k a_k.
    absolute, plain = size * (np.abs(moves) ** 2).sum(), square * (moves**2).sum()
    outer = np.outer(design, design.conj()) * absolute + np.outer(design, design) * plain
    return np.asarray(outer.real / 2)


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
