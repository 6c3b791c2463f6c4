"""What the residuals of an estimate say of its model: by how much they grow with the twist."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from oed.estimation.assessment.residual_growth import growth
from oed.foundation.arrays import Array
from oed.foundation.errors import Issue, ProblemError, RecordError
from oed.records.record import load_estimate
from oed.records.stored.estimate import Residuals
from oed.study.estimated import Discrepancy

QUANTITIES = {"x": "position", "y": "position", "heading": "heading"}
"""What residuals of a pose's entries belong to."""
FEWEST = 20
"""Residuals that show how they grow."""


def discrepancy_of(folder: Path) -> Discrepancy:
    """The discrepancy that residuals of an estimate show, quantity by quantity.

    Raises:
        ProblemError: no such estimate, or one without residuals of poses; the key is the caller's.
    """
    try:
        found = load_estimate(folder)
    except RecordError as error:
        raise ProblemError([Issue((), "; ".join(map(str, error.issues)))]) from None
    if found.log_errors:
        # What a model cannot say is taken up by drift and errors that pass.
        text = "expected an estimate by method joint: the path that likelihood finds follows the readings"
        raise ProblemError([Issue((), text)])
    values = dict[str, float]()
    for name in dict.fromkeys(QUANTITIES.values()):
        own = [one for one in found.residuals if QUANTITIES.get(one.quantity) == name and one.yaw_rate]
        table = _table(own)
        if len(table) >= FEWEST:
            _, per_speed, per_yaw_rate = growth(*table.T)
            values |= {f"{name}_per_speed": per_speed, f"{name}_per_yaw_rate": per_yaw_rate}
    if not values:
        text = f"expected an estimate with at least {FEWEST} residuals of poses and their yaw rates"
        raise ProblemError([Issue((), text)])
    return Discrepancy(**values)


def _table(residuals: Sequence[Residuals]) -> Array:
    # Residuals, speeds and yaw rates, (n, 3), of those that have all.
    parts = [np.array([one.value, one.speed, one.yaw_rate], dtype=float).T for one in residuals]
    table = np.concatenate(parts) if parts else np.zeros((0, 3))
    return np.asarray(table[np.isfinite(table).all(axis=1)])
