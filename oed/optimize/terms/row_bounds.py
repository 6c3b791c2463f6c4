"""Rows of limits without their expressions: bounds, and which of them say something of their own."""

from __future__ import annotations

from collections.abc import Sequence
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


def excess(values: Expression, rows: RowBounds | Rows) -> Expression:
    """The most by which rows exceed their bounds, over their size; below 0 where they do not."""
    return ca.fmax(_above(values, rows.upper), _below(values, rows.lower)) / rows.size


def scores_of(unknowns: Expression, entries: Expression, worst: Sequence[Expression]) -> ca.Function:
    """The function from unknowns to entries and what limits are exceeded by, both dense.

    Args:
        unknowns: z.
        entries: of the matrices.
        worst: of every limit the most that it is exceeded by, over its size.
    """
    both = [ca.densify(entries), ca.densify(ca.vertcat(type(entries)(0, 1), *worst))]
    return ca.Function("scores", [unknowns], both)


def _above(values: Expression, upper: Array) -> Expression:
    # The most by which values exceed their bounds; far below 0 where there are none.
    bounded, same = _bounded(values, upper)
    if bounded is None:
        return -1e20
    # As most limits are: one subtraction instead of one for every row.
    return ca.mmax(bounded) - same[0] if len(same) == 1 else ca.mmax(bounded - ca.DM(same))


def _below(values: Expression, lower: Array) -> Expression:
    # The most by which they fall short of them.
    bounded, same = _bounded(values, lower)
    if bounded is None:
        return -1e20
    return same[0] - ca.mmin(bounded) if len(same) == 1 else ca.mmax(ca.DM(same) - bounded)


def _bounded(values: Expression, bounds: Array) -> tuple[Expression | None, Array]:
    # Those of the values that have a bound, or None, and their bounds: one where all have the same.
    finite = np.isfinite(bounds)
    if not finite.any():
        return None, bounds
    values_of_bounds = bounds[finite]
    chosen = values if finite.all() else values[np.flatnonzero(finite).tolist()]
    return chosen, values_of_bounds[:1] if (
        values_of_bounds == values_of_bounds[0]
    ).all() else values_of_bounds
