"""Whole logs by likelihood, where a study asks for it: how sure an estimate is of a robot that drifts."""

from __future__ import annotations

from oed.estimation.assessment.covariance import Covariance
from oed.estimation.methods.fit import Fit
from oed.estimation.methods.log_errors import RATES, ErrorSizes, of_rates
from oed.estimation.methods.whole_logs import Likeliest, WholeLogs, whole_issue
from oed.estimation.setup.options import CalibrationOptions
from oed.foundation.errors import ProblemError
from oed.kernel.measurement.measurement import Measurement, sensors_of
from oed.kernel.measurement.sensor import process_noise_of
from oed.robots.sensors.drift import Drift


def likeliest(plain: Fit, options: CalibrationOptions, measurement: Measurement) -> Likeliest:
    """What the logs of a fit say.

    Args:
        plain: to segments of them.
        options: of the calibration.
        measurement: states noise, and perhaps drift.

    Raises:
        ProblemError: options that do not go with it, or logs that it is not for.
    """
    issue = whole_issue(plain)
    if issue is not None:
        raise ProblemError.about(("calibration", "method"), f"{issue}: use joint")
    if options.covariance not in ("auto", "information"):
        text = "likelihood has F^-1 of all that errs: omit it, or use method: joint"
        raise ProblemError.about(("calibration", "covariance"), text)
    if options.segment not in ("auto", "log"):
        text = "likelihood takes whole logs: omit it, or use method: joint"
        raise ProblemError.about(("calibration", "segment"), text)
    # Where the study states noise it states what there is.
    known = _specified(plain, measurement) if options.noise == "specified" else None
    return WholeLogs(plain, known).found()


def covariance_of(found: Likeliest) -> Covariance:
    """F^-1 under all that errs."""
    return Covariance(found.covariance, found.degrees, "information", found.least_degrees)


def _specified(plain: Fit, measurement: Measurement) -> ErrorSizes:
    if any(noise.per_speed or noise.per_yaw_rate for noise in plain.noises.values()):
        text = "likelihood takes specified noise that does not grow with speed: use noise: estimated"
        raise ProblemError.about(("calibration", "noise"), text)
    drift = process_noise_of(sensors_of(measurement))
    if drift is not None and not (isinstance(drift, Drift) and of_rates(drift)):
        text = f"likelihood has drift by {', '.join(RATES)}: state these alone, or use noise: estimated"
        raise ProblemError.about(("calibration", "noise"), text)
    return ErrorSizes.specified({name: noise.at_rest for name, noise in plain.noises.items()}, drift)
