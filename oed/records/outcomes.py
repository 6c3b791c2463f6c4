"""What a problem asks, what searches, bounds and simulations came to, and what made it; for records."""

from __future__ import annotations

import itertools
import math
import platform
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import PurePath
from typing import Any

import numpy as np

from oed.bounds import LOOSE, Certificate
from oed.foundation.arrays import Array
from oed.foundation.extras import package_version
from oed.kernel.dynamics.system import label_of
from oed.kernel.problem import Problem
from oed.kernel.results import TOLERANCE, Evaluation
from oed.kernel.scorer import precision_over_time, score
from oed.kernel.solution import Solution
from oed.records.stored.result import NUMBERS, Covariance, Margin, PrecisionOverTime, Result, StoredDrive
from oed.records.stored.selection import StoredSelection
from oed.records.stored.simulation import (
    Around,
    Attainable,
    Error,
    Fit,
    Scaled,
    Scatter,
    Simulated,
    SimulatedRobot,
    Spread,
    StoredFloor,
    StoredPlan,
    StoredTrial,
    TriedModel,
)
from oed.records.stored.study_record import (
    Provenance,
    StoredCertificate,
    StoredNuisance,
    StoredParameter,
    StoredState,
    UpperBound,
    WidenedBound,
)
from oed.simulation import Validation
from oed.simulation.trial.candidates import Candidate
from oed.simulation.trial.outcome import Floor, Outcome, Planned

PACKAGES = ("casadi", "numpy", "scipy", "pymoo")
"""Packages whose versions a record names: those that compute."""
DRAWN = 100
"""Points of a path that a report draws."""
TIMES = 8
"""Times of a drive at which it is said how precise it has been so far."""
FEWEST = 2
"""Repeats that say something of a floor."""
UNSCORED: Mapping[str, Any] = {
    "feasible": False,
    "identifiable": False,
    "singular": True,
    "violations": {},
    "singular_values": [],
    "standard_deviations": {},
    "covariances": [],
    "margins": [],
    **dict.fromkeys(NUMBERS),
}
"""What a result says of a drive that there is not, or that could not be scored."""


def result_of(
    solution: Solution,
    trajectory_file: str | None,
    criteria: Mapping[str, float | None] | None = None,
    selection: StoredSelection | None = None,
    usual_drift: Mapping[str, float] | None = None,
) -> Result:
    """One of a record's `results`.

    Args:
        solution: what was found.
        trajectory_file: name of the drive's CSV file, None for no file.
        criteria: what other criteria say of the drive, by their kinds.
        selection: which of its readings are taken.
        usual_drift: standard deviations if the robot drifted as robots usually do, by parameter; None where
            that is not scored.
    """
    evaluation, trajectory = solution.evaluation, solution.trajectory
    return Result.of(
        solution,
        evaluation,
        **(UNSCORED if evaluation is None else _parts_of(evaluation, solution)),
        trajectory=None if trajectory is None else trajectory_file,
        # The exact splines, so that nothing is lost; the poses, so that a report need not integrate.
        drive=None
        if trajectory is None or evaluation is None
        else StoredDrive.of(trajectory, poses=evaluation.states),
        criteria=criteria or {},
        selection=selection,
        steady_deviations=_steady_deviations(solution),
        usual_drift_deviations=_finite(usual_drift or {}),
        over_time=_over_time(solution),
    )


def _steady_deviations(solution: Solution) -> dict[str, float | None]:
    # As they would be if nothing drifted; {} where nothing does.
    problem, trajectory = _drifting(solution), solution.trajectory
    if problem is None or trajectory is None:
        return {}
    return _finite(score(problem.steady, trajectory).standard_deviations)


def _drifting(solution: Solution) -> Problem | None:
    # The problem of a process that drifts, with the integration steps that its drive was scored by.
    problem, evaluation = solution.problem, solution.evaluation
    if problem is None or evaluation is None or problem.steady is problem:
        return None
    steps = evaluation.steps
    return (problem if steps is None else problem.refined(steps.times)).unlimited


def _finite(deviations: Mapping[str, float]) -> dict[str, float | None]:
    return {name: size if math.isfinite(size) else None for name, size in deviations.items()}


def _over_time(solution: Solution) -> PrecisionOverTime | None:
    problem, trajectory = _drifting(solution), solution.trajectory
    if problem is None or trajectory is None:
        return None
    (one,) = problem.any_estimations
    times = np.linspace(0.0, max(run.duration for run in trajectory.each), TIMES + 1)[1:]

    def by_name(of: Problem) -> dict[str, list[float | None]]:
        columns = precision_over_time(of, trajectory, times).T.tolist()
        each = ([size if math.isfinite(size) else None for size in column] for column in columns)
        return dict(zip(one.parameters, each, strict=True))

    return PrecisionOverTime.of(
        t=times, standard_deviations=by_name(problem), steady_deviations=by_name(problem.steady)
    )


def _parts_of(evaluation: Evaluation, solution: Solution) -> dict[str, Any]:
    # What does not move through space has no path.
    model = None if solution.problem is None else solution.problem.model
    length = None if model is not None and not model.velocity_signal else evaluation.path_length
    return {
        "path_length": length,
        "covariances": [
            Covariance.of(parameters=evaluation.parameters[block], covariance=covariance)
            for block, covariance in evaluation.covariances.items()
        ],
        "margins": [
            Margin.of(margin, limit=margin.name, gain=solution.gains.get(margin.name))
            for margin in evaluation.margins
        ],
    }


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
    share = None if best is None else certificate.gap(best.objective, against)
    share = share if share is not None and math.isfinite(share) else None
    return StoredCertificate.of(
        certificate,
        gap=share,
        gap_to=against,
        loose=None if share is None else share > LOOSE,
        widened=_widened(certificate.widened),
        best=None if best is None else best.objective,
        drive=drive,
        spline_objective=spline,
        bounds=[UpperBound.of(one, upper_bound=one.value) for one in certificate.bounds],
    )


def _widened(widened: Certificate | None) -> WidenedBound | None:
    if widened is None or not math.isfinite(widened.upper_bound):
        return None
    return WidenedBound.of(widened, tolerance=TOLERANCE)


def validation_of(name: str, validation: Validation) -> Simulated:
    """What a record's `validation` says of the result `name`."""
    return Simulated.of(
        validation,
        name=name,
        predicted_covariance=validation.predicted,
        sampled_covariance=validation.sampled,
        paired_variance_ratio=validation.paired_ratio,
        paired_standard_error=validation.paired_error,
    )


def parameter_table(problem: Problem) -> list[StoredParameter]:
    """The estimated parameters."""
    return [
        StoredParameter.of(
            one.block, name=name, nominal=nominal, unit=unit, block=one.block.name, judged=name in one.judged
        )
        for one in problem.any_estimations
        for name, nominal, unit in zip(one.parameters, one.nominal, one.units, strict=True)
    ]


def state_table(problem: Problem) -> list[StoredState]:
    """The robot's states."""
    model = problem.model
    return [
        StoredState.of(name=name, unit=unit)
        for name, unit in zip(model.states, model.state_units, strict=True)
    ]


def nuisance_table(problem: Problem) -> list[StoredNuisance]:
    """The nuisance parameters."""
    return [
        StoredNuisance.of(entry, block=one.block.name)
        for one in problem.any_estimations
        for entry in one.block.nuisances
    ]


def provenance(source: str) -> Provenance:
    """What made a record: versions of the packages that compute, of Python and the platform, when, and the
    study's file.

    Args:
        source: what the study was read from.
    """
    file = PurePath(source)
    return Provenance(
        packages={name: package_version(name) for name in PACKAGES},
        python=platform.python_version(),
        platform=f"{platform.system()} {platform.machine()}",
        finished=datetime.now(UTC).isoformat(timespec="seconds"),
        study=file.name if file.suffix in (".yaml", ".yml") else "",
    )


def trial_of(found: Outcome) -> StoredTrial:
    """A record's `physics`."""
    asked = found.trial.model_dump(mode="json", exclude={"models"}, exclude_none=True)
    return StoredTrial.model_construct(
        **asked
        | {
            "robot": SimulatedRobot.model_construct(**asked["robot"]),
            "variation": Spread.model_construct(**asked["variation"]),
        },
        seed=found.seed,
        interrupted=found.interrupted,
        models=[_model(one) for one in found.models],
        fits=[
            Fit.of(name=name, kind=fit.robot.kind, method=fit.options.method)
            for name, fit in found.fits.items()
        ],
        planned=[_planned(one) for one in found.planned],
        floors=[_floor(one) for one in found.floors],
    )


def _model(one: Candidate) -> TriedModel:
    table = {entry.name: entry for entry in one.problem.system.parameters}
    parameters = [
        Scaled.of(table[name], scale=table[name].scale or 1.0)
        for name in one.problem.estimated_of_system or table
    ]
    return TriedModel.of(name=one.name, kind=label_of(one.problem.model), parameters=parameters)


def _planned(one: Planned) -> StoredPlan:
    solution, model = one.solution, one.model
    evaluation, trajectory = solution.evaluation, solution.trajectory
    return StoredPlan.of(
        solution,
        name=one.name,
        model=None if model is None else model.name,
        criterion=None if model is None else solution.criterion or model.problem.criterion.kind,
        feasible=one.drivable is not None,
        violations={} if evaluation is None else evaluation.violations,
        path_length=None if evaluation is None else evaluation.path_length,
        fastest=None if trajectory is None else np.abs(trajectory.inputs).max(),
        predicted=one.predicted,
        path=None if evaluation is None else _thinned(evaluation.states[:, :2]),
        inputs=None if trajectory is None else trajectory.inputs,
        aim=one.aim or None,
        discrepancy=None if one.discrepancy is None else one.discrepancy.model_dump(),
    )


def _thinned(path: Array) -> Array:
    picks = np.unique(np.linspace(0, len(path) - 1, min(len(path), DRAWN)).round().astype(int))
    return np.asarray(path[picks])


def _floor(floor: Floor) -> StoredFloor:
    done = len(floor.found)
    if done < FEWEST:
        return StoredFloor.of(floor, done=done, errors=[], scatter=[], attainable=[])
    return StoredFloor.of(
        floor,
        done=done,
        errors=_errors(floor),
        scatter=[_scatter(floor, *cell) for cell in floor.values],
        attainable=[_attainable(floor, *fit) for fit in enumerate(floor.fits)],
        drawn=[one.friction for one in floor.found],
        paths={name: _thinned(path) for name, path in floor.found[0].paths.items()},
    )


def _errors(floor: Floor) -> list[Error]:
    cells = itertools.product(enumerate(floor.drives), enumerate(floor.fits))
    return [_error(floor, *drive, *fit) for drive, fit in cells]


def _error(floor: Floor, row: int, drive: str, column: int, fit: str) -> Error:
    each = floor.repeats.errors[:, row, column]
    return Error.of(
        floor.repeats.median(row, column),
        drive=drive,
        fit=fit,
        along=floor.median("along", row, column),
        misfit=floor.median("misfit", row, column),
        refused=np.sum(~np.isfinite(each)),
        each=each,
        excess=Around.of(floor.excess.median(row, column)),
        excess_each=floor.excess.errors[:, row, column],
    )


def _attainable(floor: Floor, column: int, fit: str) -> Attainable:
    found = floor.attainable
    return Attainable.of(found.median(0, column), fit=fit, each=found.errors[:, 0, column])


def _scatter(floor: Floor, drive: str, fit: str) -> Scatter:
    values = floor.values[drive, fit]
    relative, total = floor.scatter(drive, fit)
    return Scatter.of(
        drive=drive,
        fit=fit,
        mean=values.mean(axis=0),
        relative=relative,
        total=total,
        each=[[float(f"{value:.7g}") for value in row] for row in values],
    )
