"""Notes on results whose standard errors are known to be wrong in some cases."""

from __future__ import annotations

import math

from oed.estimation.assessment.covariance import Covariance
from oed.estimation.methods.fit import Fit
from oed.estimation.methods.segment_length import Segmenting

POSE_STATES = 3
"""Number of states of a robot that has none beside its pose."""
OF_LAGS = (
    "drift is assumed, not estimated, for a robot with states beside its pose: without drift, standard "
    "errors are several times too large"
)
TURNS_IN_SHORT_SEGMENTS = (
    "positions alone say little of turning in short segments: estimates of turning may be far off, beyond "
    "their standard errors; compare with `calibration: {segment: log}`"
)


def cautions(fit: Fit, chosen: Covariance, segmenting: Segmenting | None) -> list[str]:
    """Return a sentence for each known weakness of the estimator that the result depends on.

    Args:
        fit: to all logs.
        chosen: the covariance in use.
        segmenting: how the length of segments was chosen; None where the user specified it.
    """
    sentences = []
    if chosen.name == "drift" and len(fit.unknowns.system.states) > POSE_STATES:
        sentences.append(OF_LAGS)
    positions_alone = set(fit.layout.quantities) == {"x", "y"}
    if positions_alone and segmenting is not None and math.isfinite(segmenting.seconds):
        sentences.append(TURNS_IN_SHORT_SEGMENTS)
    return sentences
