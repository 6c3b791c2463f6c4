"""How sure an estimate is of a robot that drifts: its pose is a random walk about what its inputs say.

The fit takes readings for independent of each other. What it is sure of by that is H^-1 M H^-1 with the
covariance M of its scores; drift adds to M what every step's error does to the scores.
"""

from __future__ import annotations

import numpy as np

from oed.estimation.assessment.covariance import Covariance, white_scores
from oed.estimation.methods.drift_rates import DriftRates
from oed.estimation.methods.fit import Fit
from oed.estimation.methods.windows import READ
from oed.estimation.prediction.logged_readings import LoggedReadings
from oed.foundation.arrays import Array

SUREST = 1e6
"""Degrees of freedom of what is as good as known."""


def drift(fit: Fit, rates: DriftRates) -> Covariance:
    """H^-1 (M + sum_j S_j Q_j S_j') H^-1 with what an error of step j makes of the scores, S_j, and its
    covariance Q_j.

    Intervals are those of Student's t with the kurtosis that errors have whose variance is as unsure as the
    rates make it, its logarithm normal: e^(s^2) = (d - 2) / (d - 4) for that logarithm's deviation s and d
    degrees of freedom.
    """
    parts = drifting_scores(fit) * rates.values[:, None, None]
    matrix = fit.response @ (white_scores(fit) + parts.sum(axis=0)) @ fit.response
    own = slice(len(fit.unknowns.parameters))
    each = np.einsum("ua,kab,ub->ku", fit.response[own], parts, fit.response[own])
    # How much the logarithm of a variance changes with those of the rates.
    shares = each / np.maximum(np.diag(matrix)[own], np.finfo(float).tiny)
    unsure = np.einsum("ku,kl,lu->u", shares, rates.spread, shares).max()
    return Covariance(matrix, float(4 + 2 / max(np.expm1(unsure), 2 / SUREST)), "drift")


def drifting_scores(fit: Fit) -> Array:
    """Covariance (4, q, q) of the scores by each kind of drift at a rate of 1.

    An error of a step moves all later poses of its segment like a rigid body, about the place where it
    happens. What it does to the scores is a sum over the readings to come: all steps together cost one pass
    along the log, whatever the sensor.
    """
    path = _path(fit)
    moves = np.diff(path, axis=1)
    x, y, heading = np.moveaxis(path[:, :-1] + moves / 2, -1, 0)[..., None]
    by_x, by_y, by_heading = _by_pose(fit)
    about = by_heading - path[..., 1, None] * by_x + path[..., 0, None] * by_y
    along_x, along_y, turned = map(_later, (by_x, by_y, about))
    ahead = np.cos(heading) * along_x + np.sin(heading) * along_y
    left = np.cos(heading) * along_y - np.sin(heading) * along_x
    turn = turned + y * along_x - x * along_y
    length, turning = np.hypot(moves[..., 0], moves[..., 1]), np.abs(moves[..., 2])
    pairs = ((length, ahead), (length, left), (length, turn), (turning, turn))
    # A robust loss makes the scores follow the readings less.
    return np.stack([fit.bend**2 * np.einsum("sj,sja,sjb->ab", size, way, way) for size, way in pairs])


def _path(fit: Fit) -> Array:
    # Predicted poses of the sensor (S, n + 1, 3), from the segment's first place.
    layout, names = fit.layout, fit.layout.quantities
    if set(READ) <= set(names):
        found = (layout.readings - fit.residuals)[..., [names.index(name) for name in READ]]
    else:
        found = LoggedReadings(layout, fit.unknowns, fit.offsets, READ)(fit.values, fit.starts)
    return np.asarray(found - found[:, :1] * [1.0, 1.0, 0.0])


def _by_pose(fit: Fit) -> list[Array]:
    # Derivatives of the scores by x, y and heading at all readings, each (S, n + 1, q).
    assert fit.by_reading is not None
    by_reading, names = fit.by_reading, fit.layout.quantities
    none = np.zeros_like(by_reading[:, :, 0])
    return [by_reading[:, :, names.index(name)] if name in names else none for name in READ]


def _later(values: Array) -> Array:
    # Sums of values (S, n + 1, q) at all readings after every step, (S, n, q).
    return np.asarray(np.cumsum(values[:, :0:-1], axis=1)[:, ::-1])
