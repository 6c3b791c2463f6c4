"""Rows of limits without their expressions: bounds, and which of them say something of their own."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array, Bools
from oed.kernel.dynamics.embedding import DIGITS
from oed.kernel.dynamics.expression import Expression
from oed.kernel.limit import Rows


@dataclass(frozen=True)
class RowBounds:
    """One limit's rows without their expression: bounds (rows,), size and unit as in `Rows`."""

    lower: Array
    upper: Array
    size: float
    unit: str


def said_once(slopes: Array, constants: Array, rows: RowBounds | Rows) -> Bools:
    """Which of rows slopes @ z + constants, between bounds, say what none before them does.

    Args:
        slopes: (rows, size).
        constants: (rows,).
        rows: with the bounds.
    """
    size = np.abs(slopes).max(axis=1, initial=0.0)
    table = np.column_stack([slopes, constants, rows.lower, rows.upper])
    keys = np.round(table / np.where(size > 0, size, 1.0)[:, None], DIGITS) + 0.0
    kept = np.zeros(len(table), dtype=bool)
    kept[np.unique(keys, axis=0, return_index=True)[1]] = True
    return kept


def violation(values: Expression, rows: RowBounds | Rows) -> Expression:
    """The most by which rows exceed their bounds, over their size; 0 where they do not."""
    above = ca.fmax(_above(values, rows.upper), _above(-values, -rows.lower))
    return ca.fmax(0, above) / rows.size


def _above(values: Expression, upper: Array) -> Expression:
    # The most by which values exceed their bounds; far below 0 where there are none.
    bounded = np.isfinite(upper)
    if not bounded.any():
        return -1e20
    kept, bounds = values[np.flatnonzero(bounded).tolist()], upper[bounded]
    if (bounds == bounds[0]).all():
        # As most limits are: one subtraction instead of one for every row.
        return ca.mmax(kept) - bounds[0]
    return ca.mmax(kept - ca.DM(bounds))
