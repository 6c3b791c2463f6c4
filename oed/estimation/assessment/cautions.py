"""Notes on results whose standard errors are known to be wrong in some cases."""

from __future__ import annotations

import math

from oed.estimation.assessment.covariance import Covariance
from oed.estimation.methods.drift_rates import DriftRates
from oed.estimation.methods.fit import Fit
from oed.estimation.methods.segment_length import Segmenting
from oed.estimation.methods.whole_logs import Likeliest

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
DRIVES_CONTRADICT = (
    "the drives contradict each other: they agree only if each has an error of its own that stays constant; "
    "standard errors leave that out; compare with estimates of each log alone, or with "
    "`calibration: {method: joint}`"
)


def cautions(
    fit: Fit,
    chosen: Covariance,
    segmenting: Segmenting | None,
    rates: DriftRates | None = None,
    whole_logs: Likeliest | None = None,
) -> list[str]:
    """Return a sentence for each known weakness of the estimator that the result depends on.

    Args:
        fit: to all logs.
        chosen: the covariance in use.
        segmenting: how the length of segments was chosen; None where the user specified it.
        rates: of drift, where there are any.
        whole_logs: the most likely sizes of errors, by the method `likelihood` alone.
    """
    sentences = []
    is_usual = chosen.name == "drift" and rates is not None and rates.seconds is None
    if is_usual and len(fit.unknowns.system.states) > POSE_STATES:
        sentences.append(OF_LAGS)
    if whole_logs is not None and _drives_contradict(whole_logs):
        sentences.append(DRIVES_CONTRADICT)
    positions_alone = set(fit.layout.quantities) == {"x", "y"}
    if positions_alone and segmenting is not None and math.isfinite(segmenting.seconds):
        sentences.append(TURNS_IN_SHORT_SEGMENTS)
    return sentences


def _drives_contradict(whole_logs: Likeliest) -> bool:
    # What passes is to pass within a log. What does not, and is larger than the noise of a reading, makes up
    # for what a robot of these parameters cannot do in all drives.
    logs, sizes = whole_logs.fit.layout.logs, whole_logs.sizes
    longest = max(float(log.pose_times[-1] - log.pose_times[0]) for log in logs)
    largest = max(sizes["passing_ahead"], sizes["passing_sideways"])
    return len(logs) > 1 and sizes["passing_seconds"] > longest and largest > sizes["position"]
