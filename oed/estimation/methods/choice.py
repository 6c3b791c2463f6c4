"""Which estimator suits a measurement. A new one is a file and a name here."""

from __future__ import annotations

from oed.estimation.methods.displacements import METHODS, Heading, Regression, missing_noise
from oed.estimation.methods.estimator import LOSS_UNDER_DRIFT, Estimator, EstimatorName
from oed.estimation.setup.options import Loss
from oed.foundation.arguments import typed
from oed.foundation.errors import Issue, ProblemError
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.measurement.measurement import Measurement, sensors_of
from oed.kernel.measurement.sensor import process_noise_of
from oed.kernel.problem import Problem
from oed.robots.sensors.displacements import Displacements


def usual_estimator(measurement: Measurement) -> EstimatorName:
    """The estimator that a measurement's information is that of."""
    if not isinstance(measurement, Displacements):
        return "nonlinear"
    if measurement.noise_model == "increments":
        return "ols"
    return "gls" if measurement.estimator == "gls" else "sandwich"


def estimator_issues(
    measurement: Measurement,
    name: EstimatorName | None = None,
    heading: Heading = "known",
    loss: Loss = "linear",
) -> list[Issue]:
    """What keeps the estimator `name` (the usual one by default) from a measurement; [] if nothing.

    Args:
        measurement: of a study.
        name: of an estimator.
        heading: how headings are known.
        loss: of the residuals.
    """
    chosen = name or usual_estimator(measurement)
    if isinstance(measurement, Displacements):
        if chosen not in METHODS:
            text = f"displacements are estimated by {', '.join(METHODS)}; not by {chosen}"
            return [Issue(("validation", "estimators"), text)]
        if chosen == "errors_in_variables" and heading != "measured":
            text = f"errors in variables are those of heading: measured; these are {heading}"
            return [Issue(("validation", "heading"), text)]
        if loss != "linear":
            text = f"a robust loss is for sensors; displacements are estimated by {chosen}"
            return [Issue(("validation", "loss"), text)]
        missing = missing_noise(measurement, heading)
        text = f"simulating {heading} headings needs the noise of {', '.join(missing)}"
        return [Issue(("measurement", "noise"), text)] if missing else []
    if not sensors_of(measurement):
        return [Issue(("validation",), f"no simulation is known for {measurement.kind}")]
    if chosen != "nonlinear":
        text = f"{measurement.kind} are estimated by nonlinear least squares; not by {chosen}"
        return [Issue(("validation", "estimators"), text)]
    if heading != "known":
        text = f"{heading} headings are for displacements; sensors read what they read"
        return [Issue(("validation", "heading"), text)]
    if loss != "linear" and process_noise_of(sensors_of(measurement)) is not None:
        return [Issue(("validation", "loss"), LOSS_UNDER_DRIFT)]
    return []


@typed
def make_estimator(
    problem: Problem,
    trajectory: Trajectory,
    name: EstimatorName | None = None,
    *,
    heading: Heading = "known",
    loss: Loss = "linear",
) -> Estimator:
    """The estimator `name` (the usual one by default) of a drive's readings.

    Args:
        problem: whose measurement is taken.
        trajectory: the drive.
        name: of the method.
        heading: for displacements, which headings the position regression uses.
        loss: for sensors, of a residual.

    Raises:
        ProblemError: an estimator that does not suit the measurement, or parameters that nothing identifies.
    """
    issues = estimator_issues(problem.measurement, name, heading, loss)
    if issues:
        raise ProblemError(issues)
    chosen = name or usual_estimator(problem.measurement)
    if chosen == "nonlinear":
        # Loaded late: to check a study is not to estimate.
        from oed.estimation.methods.nonlinear import Nonlinear

        return Nonlinear(problem, trajectory, loss)
    return Regression(problem, trajectory, chosen, heading)
