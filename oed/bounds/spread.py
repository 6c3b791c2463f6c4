"""Upper bound on the spread of the positions of a drive, by dynamic programming along each axis.

The sum of squared distances from their mean is a convex function of the positions. Over all positions within
the workspace and the top speed it is therefore largest where every position is a bound, or the start, plus or
minus a multiple of the largest step. The state is the position and the sum of the readings so far.
"""

from __future__ import annotations

import numpy as np

from oed.bounds.lattice_program import reachable
from oed.foundation.arrays import Array, Bools

SUM_STEPS = 4000
"""Number of steps in the range of the readings' sum; the bound allows for their rounding."""


MOST_WORK = 1.5e10
"""Largest number of operations of the dynamic programme."""


def is_too_fine(low: float, high: float, steps: Array) -> bool:
    """Return True if the positions' lattice is too fine for the dynamic programme.

    Args:
        low: smallest position.
        high: largest position.
        steps: largest change in each period, (N,).
    """
    positions = 3 * (high - low) / float(np.max(steps))
    return positions * 2 * SUM_STEPS * len(steps) * 7 > MOST_WORK


def largest_spread(low: float, high: float, start: float | None, steps: Array, read: Bools) -> float:
    """Return an upper bound on the sum of (x_k - mean)^2 over the samples that are read.

    Args:
        low: smallest position.
        high: largest position.
        start: position at the first sample, None if free.
        steps: largest change in each period, (N,).
        read: True for samples that are read, (N + 1,).
    """
    step = float(np.max(steps))
    middle = (low + high) / 2
    half = (high - low) / 2
    if half <= 0:
        return 0.0
    values = reachable(low, high, step, [low, high, *([] if start is None else [start])]) - middle
    readings = int(read.sum())
    grain = 2 * half * readings / SUM_STEPS
    shifts = np.rint(values / grain).astype(int)
    # Best value by position and by the sum of the readings so far.
    table = np.full((len(values), 1), -np.inf)
    table[slice(None) if start is None else np.isclose(values, start - middle, atol=1e-9)] = 0.0
    reach = step * (1 + 1e-9) + 1e-9
    lows, highs = (
        np.searchsorted(values, values - reach),
        np.searchsorted(values, values + reach, side="right"),
    )
    farthest = int(np.abs(shifts).max())
    for index, taken in enumerate(read):
        more = farthest if taken else 0
        next_table = np.full((len(values), table.shape[1] + 2 * more), -np.inf)
        for row, (value, shift) in enumerate(zip(values, shifts, strict=True)):
            best = np.maximum.reduce(table[lows[row] : highs[row]] if index else table[row : row + 1], axis=0)
            begin = more + int(shift) if taken else 0
            next_table[row, begin : begin + len(best)] = best + (value**2 if taken else 0.0)
        table = next_table
    best = table.max(axis=0)
    sums = (np.arange(len(best)) - len(best) // 2) * grain
    rounding = readings * grain / 2
    means = np.maximum(np.abs(sums) - rounding, 0.0) ** 2 / readings
    return float(np.max(best - means))
