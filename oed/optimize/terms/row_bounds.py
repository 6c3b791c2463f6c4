"""Rows of limits without their expressions: bounds, and which of them say something of their own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from oed.foundation.arrays import Array, Bools
from oed.kernel.dynamics.embedding import DIGITS
from oed.kernel.limit import Rows


@dataclass(frozen=True)
class RowBounds:
    """One limit's rows without their expression: bounds (rows,), size and unit as in `Rows`."""

    lower: Array
    upper: Array
    size: float
    unit: str


def said_once(slopes: Array, constants: Array, rows: RowBounds | Rows) -> Bools:
    """Return True for each row slopes @ z + constants, between bounds, that says what none before it does.

    Args:
        slopes: (rows, size).
        constants: (rows,).
        rows: with the bounds.
    """
    size = np.abs(slopes).max(axis=1, initial=0.0)
    table = np.column_stack([slopes, constants, rows.lower, rows.upper])
    keys = np.round(table / np.where(size > 0, size, 1.0)[:, None], DIGITS) + 0.0
    is_new = np.zeros(len(table), dtype=bool)
    is_new[np.unique(keys, axis=0, return_index=True)[1]] = True
    return is_new
