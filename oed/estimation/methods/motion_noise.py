"""How noisy the motions of windows are, by what they show and by how robots usually drift.

A few windows alone show next to nothing of seven variances, and would call any of them none.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from oed.estimation.methods.bands import form
from oed.estimation.methods.drift_rates import USUAL, USUAL_SPREAD, without_drift
from oed.estimation.methods.fit import ScoreParts
from oed.estimation.methods.log_errors import BEYOND_DOUBT
from oed.estimation.methods.window_noise import FIRST, OF_POSES, TIMING, Course, Likelihood
from oed.estimation.methods.windows import Windows, pose_variances
from oed.estimation.setup.unknowns import PLACE, Knowledge
from oed.foundation.arrays import Array
from oed.robots.sensors.logged import Noise

HARDLY_KNOWN = 3.0
"""Standard deviation of the logarithms of the poses' variances: a factor of 4.5 of their noise either way,
about a share of the residuals."""


def motion_likelihood(
    windows: Windows,
    known: Knowledge,
    values: Array,
    specified: Mapping[str, Noise] | None = None,
    *,
    grows: bool = True,
) -> Likelihood:
    """Restricted likelihood of the parts of motions' variance, but for poses' noise that is specified, by
    what windows show alone.

    Args:
        windows: that show the motions.
        known: of the unknowns from before.
        values: of the unknowns, (q,).
        specified: noise of the poses that is not to be estimated.
        grows: whether noise of poses may grow with speed and yaw rate.
    """
    motions, scale = windows.motions(values), windows.unknowns.scale
    sensor_heading = float(windows.unknowns.parts(values)[1][PLACE.index("sensor_heading")])
    course = Course(motions.path, windows.layout.steps, windows.linked, sensor_heading=sensor_heading)
    parts = course.parts
    fixed = np.zeros(parts.shape[1:])
    if not grows:
        parts[TIMING] = 0.0
    if specified is not None:
        variances = pose_variances(specified, windows.rates(motions.path))
        parts, fixed = parts[OF_POSES:], course.of_poses(variances[..., None] * np.eye(3))
    slopes = motions.slopes.reshape(-1, len(scale)) * scale
    rows = np.column_stack([motions.residuals.ravel(), slopes])
    information = known.information * np.outer(scale, scale), known.score(values) * scale
    return Likelihood(parts, fixed, rows, information)


def _beside_usual(likelihood: Likelihood) -> Likelihood:
    # With the prior of usual drift, and next to none of the poses' noise.
    units = likelihood.units
    means = np.log(np.where(units > 0, FIRST * units, 1.0))
    deviations = np.full(len(means), HARDLY_KNOWN)
    means[-len(USUAL) :], deviations[-len(USUAL) :] = np.log(USUAL), USUAL_SPREAD
    return replace(likelihood, prior=(means, deviations))


def score_parts(likelihood: Likelihood, pulls: Array) -> ScoreParts:
    """The covariance of scores by the variances that are most likely beside usual drift, with noise that is
    specified as a last part; of drift there is none where that is likelier beyond doubt.

    Args:
        likelihood: of the variances, by what windows show.
        pulls: derivatives of the scores by the motions, (3 S, q).
    """
    likelihood = _beside_usual(likelihood)
    variances = likelihood.greatest()
    none, without, surprise = without_drift(likelihood)
    if likelihood.surprise(variances)[0] >= surprise + BEYOND_DOUBT:
        likelihood, variances = none, without
    bands = [*(likelihood.parts * variances[:, None, None]), likelihood.fixed]
    unsure = np.pad(likelihood.spread(variances), (0, 1))
    return ScoreParts(np.stack([form(band, pulls) for band in bands]), unsure)
