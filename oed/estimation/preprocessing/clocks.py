"""How far the clocks of wheels and poses are apart: a first guess by comparing their motion."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from oed.estimation.preprocessing.moves import FEWEST, Moves, unexplained

Array = npt.NDArray[np.float64]

REACH = 1.0
"""Largest offset looked for [s]."""
COARSE, FINE = 0.05, 0.01
"""Steps of the search [s]; the fit refines what it finds."""
CLEAR = 0.9
"""An offset is taken for real where it leaves at most this share of what no offset leaves unexplained."""


def clock_offsets(moves: Moves) -> Array:
    """What the inputs' clocks show when the poses' show 0, (clocks,) [s]; 0 where no motion shows it.

    Args:
        moves: of all logs.
    """
    layout = moves.layout
    return np.array([_offset(moves.within(layout.clock == clock)) for clock in range(len(layout.clocks))])


def _offset(moves: Moves) -> float:
    if moves.layout.count < FEWEST:
        return 0.0
    measured, clocks = moves.measured(), len(moves.layout.clocks)

    def left(offset: float) -> float:
        shares = unexplained(measured, moves.predicted(np.full(clocks, offset)))
        return float(np.prod([max(share, 1e-9) for share in shares.values()])) if shares else 1.0

    coarse = np.arange(-REACH, REACH + COARSE / 2, COARSE)
    best = min(coarse, key=left)
    fine = best + np.arange(-COARSE, COARSE + FINE / 2, FINE)
    best = min(fine, key=left)
    return float(best) if left(best) < CLEAR * left(0.0) else 0.0
