"""What searches, bounds and simulations came to, as records hold it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from oed.bounds import LOOSE, Certificate, gap
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.evaluation import TOLERANCE, Evaluation
from oed.kernel.evaluation import Margin as Room
from oed.kernel.solution import Solution, Start
from oed.records.numbers import finite, finite_rows, rounded
from oed.records.stored.certificate import StoredCertificate, UpperBound, WidenedBound
from oed.records.stored.result import Covariance, Drive, Margin, Progress, Result, StartPoint
from oed.records.stored.simulation import Simulated, StoredCheck
from oed.simulation import Validation

NUMBERS = (
    "objective",
    "lambda_min",
    "lambda_max",
    "condition_number",
    "smallest_singular_value",
    "norm_y",
    "path_length",
)
"""Of an evaluation, each a number of a result."""


def result_of(
    solution: Solution, trajectory_file: str | None, criteria: Mapping[str, float | None] | None = None
) -> Result:
    """One of a record's `results`.

    Args:
        solution: what was found.
        trajectory_file: name of the drive's CSV file, None for no file.
        criteria: what other criteria say of the drive, by their kinds.
    """
    evaluation, trajectory = solution.evaluation, solution.trajectory
    return Result.model_construct(
        name=solution.name,
        kind=solution.kind,
        criterion=solution.criterion,
        status=solution.status.value,
        message=solution.message,
        **_scored(evaluation),
        wall_seconds=round(solution.wall_seconds, 6),
        starts=[_start(start) for start in solution.starts],
        stages={name: finite(value) for name, value in solution.stages.items()},
        history=[
            Progress.model_construct(
                evaluations=point.evaluations,
                seconds=round(point.seconds, 6),
                objective=finite(point.objective),
            )
            for point in solution.history
        ],
        seed=solution.seed,
        trajectory=trajectory_file if trajectory is not None else None,
        drive=None if trajectory is None or evaluation is None else _drive(trajectory, evaluation),
        criteria=dict(criteria or {}),
    )


def _scored(evaluation: Evaluation | None) -> dict[str, Any]:
    if evaluation is None:
        return {
            "feasible": False,
            "identifiable": False,
            "singular": True,
            "violations": {},
            **dict.fromkeys(NUMBERS),
            "singular_values": [],
            "standard_deviations": {},
        }
    return {
        "feasible": evaluation.feasible,
        "identifiable": evaluation.identifiable,
        "singular": evaluation.singular,
        "violations": evaluation.violations,
        **{name: finite(getattr(evaluation, name)) for name in NUMBERS},
        "singular_values": evaluation.singular_values.tolist(),
        "standard_deviations": {
            name: finite(value) for name, value in evaluation.standard_deviations.items()
        },
        "covariances": [
            Covariance.model_construct(
                parameters=list(evaluation.parameters[block]), covariance=finite_rows(covariance)
            )
            for block, covariance in evaluation.covariances.items()
        ],
        "margins": [_margin(margin) for margin in evaluation.margins],
    }


def _margin(room: Room) -> Margin:
    return Margin.model_construct(
        limit=room.name,
        margin=room.margin,
        size=room.size,
        unit=room.unit,
        active=room.active,
        kept=room.kept,
        certain=room.certain,
    )


def _start(start: Start) -> StartPoint:
    return StartPoint.model_construct(
        objective=finite(start.objective),
        status=start.status.value,
        wall_seconds=round(start.wall_seconds, 6),
        iterations=start.iterations,
    )


def _drive(trajectory: Trajectory, evaluation: Evaluation) -> Drive:
    # The exact splines, so that nothing is lost; the poses, so that a report need not integrate.
    return Drive.model_construct(
        degree=trajectory.degree,
        knots=trajectory.knots.tolist(),
        coefficients=trajectory.coefficients.tolist(),
        start=trajectory.start.tolist(),
        samples=trajectory.samples,
        runs=trajectory.runs,
        poses=rounded(evaluation.states, 9),
    )


def certificate_of(
    certificate: Certificate, best: Evaluation | None, drive: str | None, spline: float | None
) -> StoredCertificate | None:
    """A record's `certificate`; None where nothing is proved.

    Args:
        certificate: the bound.
        best: the feasible result of largest objective. Its gap is to the exact bound where it satisfies the
            limits exactly, else to that of the widened limits.
        drive: name of the result that the search for the bound came upon.
        spline: largest objective of a feasible result of a search over splines.
    """
    if not math.isfinite(certificate.upper_bound):
        return None
    against = None if best is None else certificate.bound_on(best)
    share = None if best is None or against is None or best.objective <= 0 else gap(against, best.objective)
    return StoredCertificate.model_construct(
        upper_bound=certificate.upper_bound,
        gap=finite(share),
        method=certificate.method,
        assumptions=list(certificate.assumptions),
        multiplier=None if certificate.multiplier is None else np.asarray(certificate.multiplier).tolist(),
        widened=_widened(certificate.widened),
        gap_to=None if against is None else finite(against),
        loose=None if share is None else share > LOOSE,
        complete=certificate.complete,
        nodes=certificate.nodes,
        best=None if best is None else best.objective,
        drive=drive,
        spline_objective=spline,
        caps=[
            UpperBound.model_construct(
                upper_bound=cap.value, method=cap.method, assumptions=list(cap.assumptions)
            )
            for cap in certificate.bounds
        ],
        wall_seconds=round(certificate.wall_seconds, 6),
    )


def _widened(widened: Certificate | None) -> WidenedBound | None:
    if widened is None or not math.isfinite(widened.upper_bound):
        return None
    return WidenedBound.model_construct(
        tolerance=TOLERANCE,
        upper_bound=widened.upper_bound,
        method=widened.method,
        assumptions=list(widened.assumptions),
    )


def validation_of(name: str, validation: Validation) -> Simulated:
    """What a record's `validation` says of the result `name`."""
    return Simulated.model_construct(
        name=name,
        estimator=validation.estimator,
        heading=validation.heading,
        passed=validation.passed,
        verdict=validation.verdict,
        parameters=list(validation.parameters),
        true=validation.true.tolist(),
        mean=validation.mean.tolist(),
        promised_covariance=validation.predicted.tolist(),
        sampled_covariance=validation.sampled.tolist(),
        paired_variance_ratio=validation.paired_ratio.tolist(),
        paired_standard_error=validation.paired_error.tolist(),
        checks=[
            StoredCheck.model_construct(
                name=check.name,
                question=check.question,
                statistic=check.statistic,
                expected=list(check.expected),
                p_value=check.p_value,
                passed=check.passed,
            )
            for check in validation.checks
        ],
        estimates=rounded(validation.estimates, 10),
    )
