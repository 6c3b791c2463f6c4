"""How sure an estimate is of a robot that drifts: its pose is a random walk about what its inputs say.

The fit takes readings for independent of each other. What it is sure of by that is H^-1 M H^-1 with the
covariance M of its scores; drift adds to M what every step's error does to the scores.
"""

from __future__ import annotations

import numpy as np

from oed.estimation.assessment.covariance import Covariance, white_scores
from oed.estimation.methods.drift_rates import DriftRates
from oed.estimation.methods.fit import Fit, ScoreParts, combinations, degrees_of
from oed.estimation.prediction.logged_readings import POSE, LoggedReadings
from oed.foundation.arrays import Array, Bools


def drift(fit: Fit, rates: DriftRates) -> Covariance:
    """H^-1 (M + sum_j S_j Q_j S_j') H^-1 with what an error of step j makes of the scores, S_j, and its
    covariance Q_j.
    """
    parts = drifting_scores(fit) * rates.values[:, None, None]
    return _by_parts(fit, white_scores(fit), ScoreParts(parts, rates.spread))


def drift_of_motions(fit: Fit) -> Covariance:
    """H^-1 M H^-1 where windows are compared, with M by the estimated covariance of motions."""
    assert fit.parts is not None
    return _by_parts(fit, fit.knowledge, fit.parts)


def _by_parts(fit: Fit, white: Array, parts: ScoreParts) -> Covariance:
    # Intervals are as wide as the parts leave the variance unsure.
    matrix = fit.response @ (white + parts.matrices.sum(axis=0)) @ fit.response
    own = slice(len(fit.unknowns.parameters))

    def degrees(ways: Array) -> float:
        # Of the least sure of variances along combinations, as columns.
        along = fit.response[:, own] @ ways
        each = np.einsum("au,kab,bu->ku", along, parts.matrices, along)
        whole = np.einsum("au,ab,bu->u", ways, matrix[own, own], ways)
        # How much the logarithm of a variance changes with those of the parts.
        shares = each / np.maximum(whole, np.finfo(float).tiny)
        return degrees_of(np.einsum("ku,kl,lu->u", shares, parts.spread, shares).max(initial=0.0))

    single = degrees(np.eye(own.stop))
    return Covariance(matrix, single, "drift", min(single, degrees(combinations(matrix[own, own]))))


def drifting_scores(fit: Fit, segments: Bools | None = None) -> Array:
    """Covariance (4, q, q) of the scores by each kind of drift at a rate of 1; of some of the segments, (S,),
    or all.
    """
    assert fit.by_start is not None
    states = LoggedReadings.of(fit.layout, fit.unknowns, fit.offsets).path(fit.values, fit.starts)
    own = np.ones(len(states), bool) if segments is None else segments
    by_errors = None if fit.by_errors is None else fit.by_errors[own]
    # A robust loss makes the scores follow the readings less.
    return fit.bend**2 * carried_along(states[own][..., :POSE], fit.by_start[own], by_errors)


def carried_along(path: Array, by_start: Array, by_errors: Array | None = None) -> Array:
    """Covariance (4, q, q) of what errors of each kind do along a path, at a rate of 1.

    An error of a step moves all later poses of its segment like a rigid body, about the place where it
    happens, as an error of the start moves all of them: dz_k/dx_j = dz_k/dx_0 (dx_j/dx_0)^-1. What it does
    is a sum over the readings to come: all steps together cost one pass along the log, whatever the sensors.
    What is read of motion itself, as by a gyroscope, has the errors of its own period and no others.

    Args:
        path: poses of the robot (S, n + 1, 3).
        by_start: derivatives by the first of these through each reading, (S, n + 1, 3, q).
        by_errors: by errors of the periods that readings are of, ahead, to the left and turned, alike.
    """
    path = path - path[:, :1] * [1.0, 1.0, 0.0]
    moves = np.diff(path, axis=1)
    x, y, heading = np.moveaxis(path[:, :-1] + moves / 2, -1, 0)[..., None]
    along_x, along_y, turned = map(_later, np.moveaxis(by_start, 2, 0))
    ahead = np.cos(heading) * along_x + np.sin(heading) * along_y
    left = np.cos(heading) * along_y - np.sin(heading) * along_x
    turn = turned + y * along_x - x * along_y
    if by_errors is not None:
        ahead, left, turn = (
            whole + by_errors[:, :-1, kind] for kind, whole in enumerate((ahead, left, turn))
        )
    length, turning = np.hypot(moves[..., 0], moves[..., 1]), np.abs(moves[..., 2])
    pairs = ((length, ahead), (length, left), (length, turn), (turning, turn))
    return np.stack([np.einsum("sj,sja,sjb->ab", size, way, way) for size, way in pairs])


def _later(values: Array) -> Array:
    # Sums of values (S, n + 1, q) at all readings after every step, (S, n, q).
    return np.asarray(np.cumsum(values[:, :0:-1], axis=1)[:, ::-1])
