"""Bounds on inputs that follow from bounds on linear combinations of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from oed.foundation.arrays import Array
from oed.kernel.limit import LinearBound

ROUNDING = 1e-9
"""By how much more than what a linear program finds an input may be, relative to it."""


def implied_bounds(known: Array, combined: Sequence[LinearBound]) -> Array:
    """Bounds on inputs (inputs, 2), where those `known` (inputs, 2) are infinite by what all say together.

    Infinite still where nothing follows.
    """
    if not combined or np.isfinite(known).all():
        return known
    table = np.array([one.slopes for one in combined])
    low, high = np.array([(one.low - one.offset, one.high - one.offset) for one in combined]).T
    return np.array(
        [
            pair if np.isfinite(pair).all() else _reach(table, low, high, known, place)
            for place, pair in enumerate(known)
        ]
    )


def _reach(table: Array, low: Array, high: Array, known: Array, place: int) -> list[float]:
    # The least and the largest that one input can be.
    from scipy.optimize import linprog

    ends = []
    for sign in (1.0, -1.0):
        goal = sign * np.eye(len(known))[place]
        found = linprog(goal, np.vstack([table, -table]), np.concatenate([high, -low]), bounds=known)
        end = float(sign * found.fun) if found.status == 0 else -sign * np.inf
        ends.append(end - sign * ROUNDING * abs(end))
    return ends
