"""What a trial of a simulated robot with slip came to, as records hold it."""

from __future__ import annotations

import itertools

import numpy as np
import numpy.typing as npt

from oed.kernel.dynamics.system import label_of
from oed.records.stored.trial import (
    Around,
    Error,
    Fit,
    Scaled,
    Scatter,
    SimulatedRobot,
    Spread,
    StoredFloor,
    StoredPlan,
    StoredTrial,
    TriedModel,
)
from oed.simulation.trial.candidates import Candidate
from oed.simulation.trial.outcome import Floor, Outcome, Planned

Array = npt.NDArray[np.float64]

DRAWN = 100
"""Points of a path that a report draws."""
FEWEST = 2
"""Repeats that say something of a floor."""


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
        Scaled.of(table[name], scale=table[name].scale or 1.0) for name in one.problem.estimate or table
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
    )


def _thinned(path: Array) -> Array:
    picks = np.unique(np.linspace(0, len(path) - 1, min(len(path), DRAWN)).round().astype(int))
    return np.asarray(path[picks])


def _floor(floor: Floor) -> StoredFloor:
    done = len(floor.found)
    if done < FEWEST:
        return StoredFloor.of(floor, done=done, errors=[], scatter=[])
    return StoredFloor.of(
        floor,
        done=done,
        errors=_errors(floor),
        scatter=[_scatter(floor, *cell) for cell in floor.values],
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
    )


def _scatter(floor: Floor, drive: str, fit: str) -> Scatter:
    values = floor.values[drive, fit]
    relative, total = floor.scatter(drive, fit)
    return Scatter.of(
        drive=drive,
        fit=fit,
        mean=values.mean(axis=0),
        relative=relative,
        total=Around.of(total),
        each=[[float(f"{value:.7g}") for value in row] for row in values],
    )
