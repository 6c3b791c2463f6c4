"""Sensors in words: when they read, and how noisy that is."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from oed.foundation.arrays import ROUNDING, Array
from oed.foundation.text import given_text, listing
from oed.kernel.dynamics.expression import Expression

ENDINGS = {1: "st", 2: "nd", 3: "rd"}


def when_text(unit: str, every: int) -> str:
    """`at every 5th sample`, `in every period`."""
    preposition = "in" if unit == "period" else "at"
    return f"{preposition} every {unit}" if every == 1 else f"{preposition} every {_ordinal(every)} {unit}"


def _ordinal(number: int) -> str:
    ending = "th" if number % 100 in (11, 12, 13) else ENDINGS.get(number % 10, "th")
    return f"{number}{ending}"


def noise_text(whitening: Expression, units: Sequence[str]) -> str:
    """The noise of one reading: `a standard deviation of 5 cm`.

    By its whitening A (q, q) at any moment, with A R A' = 1, and SI units (q,); () where nobody says.
    """
    if ca.symvar(ca.SX(whitening)):
        return "a standard deviation that depends on the drive"
    sizes, correlation = _deviations(whitening)
    text = deviations_text(*dict.fromkeys(_sizes(sizes, units)))
    return f"correlated noise ({text})" if correlation > ROUNDING else text


def deviations_of(whitening: Expression) -> tuple[float, ...]:
    """Standard deviations (q,) of one reading by its whitening (q, q); () where they depend on the moment."""
    return () if ca.symvar(ca.SX(whitening)) else tuple(_deviations(whitening)[0].tolist())


def _deviations(whitening: Expression) -> tuple[Array, float]:
    # Standard deviations (q,) and the largest correlation. Diagonals stay sparse: q may be thousands.
    matrix = ca.sparsify(ca.evalf(whitening))
    if matrix.sparsity().is_diag():
        with np.errstate(divide="ignore"):
            return np.asarray(1.0 / np.abs(np.array(ca.diag(matrix)).ravel())), 0.0
    inverse = np.linalg.inv(np.asarray(matrix, dtype=float))
    covariance = inverse @ inverse.T
    sizes = np.sqrt(np.diag(covariance))
    shared = covariance / np.outer(sizes, sizes) - np.eye(len(sizes))
    return sizes, float(np.abs(shared).max())


def deviations_text(*sizes: str) -> str:
    """Standard deviations, each in words: `a standard deviation of 5 cm`."""
    text = listing(sizes)
    return f"standard deviations of {text}" if " and " in text else f"a standard deviation of {text}"


def _sizes(sizes: Array, units: Sequence[str]) -> list[str]:
    if not units:
        return [f"{size:.4g} in SI units" for size in sizes]
    return [given_text(size, unit) for size, unit in zip(sizes, units, strict=True)]
