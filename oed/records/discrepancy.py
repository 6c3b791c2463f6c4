"""What the residuals of an estimate say of its model: by how much they grow with the twist."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import scipy

from oed.foundation.arrays import Array
from oed.foundation.errors import Flaw, ProblemError, RecordError
from oed.records.record import load_estimate
from oed.records.stored.estimate import Residuals
from oed.study.estimated import Discrepancy

QUANTITIES = {"x": "position", "y": "position", "heading": "heading"}
"""What residuals of a pose's entries belong to."""
FEWEST = 20
"""Residuals that show how they grow."""
ROUNDS = 20
"""Of weights by the variances found, which then hardly change."""


def discrepancy_of(folder: Path) -> Discrepancy:
    """The discrepancy that residuals of an estimate show, quantity by quantity.

    Raises:
        ProblemError: no such estimate, or one without residuals of poses; the key is the caller's.
    """
    try:
        found = load_estimate(folder)
    except RecordError as error:
        raise ProblemError([Flaw((), "; ".join(map(str, error.flaws)))]) from None
    values = dict[str, float]()
    for name in dict.fromkeys(QUANTITIES.values()):
        own = [one for one in found.residuals if QUANTITIES.get(one.quantity) == name and one.yaw_rate]
        table = _table(own)
        if len(table) >= FEWEST:
            _, per_speed, per_yaw_rate = growth(*table.T)
            values |= {f"{name}_per_speed": per_speed, f"{name}_per_yaw_rate": per_yaw_rate}
    if not values:
        text = f"expected an estimate with at least {FEWEST} residuals of poses and their yaw rates"
        raise ProblemError([Flaw((), text)])
    return Discrepancy(**values)


def growth(residuals: Array, speeds: Array, yaw_rates: Array) -> tuple[float, float, float]:
    """Standard deviations s, k_v, k_w of residuals whose variance is s^2 + (k_v V)^2 + (k_w Omega)^2: what is
    there at rest, per speed and per yaw rate.

    Squares of residuals are fitted by least squares, none of the three below 0, weighted as squares of
    normal errors scatter: by the variances found [McCullagh and Nelder, Generalized Linear Models, 1989].

    Args:
        residuals: (n,).
        speeds: V then, (n,).
        yaw_rates: Omega then, (n,).
    """
    squares = residuals**2
    terms = np.column_stack([np.ones_like(speeds), speeds**2, yaw_rates**2])
    sizes = np.where(terms.any(axis=0), terms.max(axis=0), 1.0)
    least = 1e-6 * (squares.mean() or 1.0)
    variances, found = np.full(len(squares), 1.0), np.zeros(3)
    for _ in range(ROUNDS):
        found = scipy.optimize.nnls(terms / sizes / variances[:, None], squares / variances)[0]
        variances = np.maximum(terms / sizes @ found, least)
    at_rest, per_speed, per_yaw_rate = np.sqrt(found / sizes)
    return float(at_rest), float(per_speed), float(per_yaw_rate)


def _table(residuals: Sequence[Residuals]) -> Array:
    # Residuals, speeds and yaw rates, (n, 3), of those that have all.
    parts = [np.array([one.value, one.speed, one.yaw_rate], dtype=float).T for one in residuals]
    table = np.concatenate(parts) if parts else np.zeros((0, 3))
    return np.asarray(table[np.isfinite(table).all(axis=1)])
