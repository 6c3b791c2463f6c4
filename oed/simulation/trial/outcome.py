"""What a trial found, as plain data for a record."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from oed.estimation.methods.fitting import Fitting
from oed.kernel.dynamics.system import label_of
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.solution import Solution
from oed.simulation.trial.candidates import Candidate
from oed.simulation.trial.experiment import Found
from oed.simulation.trial.options import Trial
from oed.simulation.trial.statistics import Interval, Repeats, interval, scatter, total

Array = npt.NDArray[np.float64]

DRAWN = 100
"""Points of a path that a report draws."""


@dataclass(frozen=True)
class Planned:
    """A drive to calibrate from.

    Attributes:
        name: of the drive.
        model: that it is designed for; None of an everyday path.
        solution: with the drive, scored for that model or else for the study's own.
        told: standard deviations of the study's own parameters that it promises; None without a drive.
    """

    name: str
    model: Candidate | None
    solution: Solution
    told: Mapping[str, float] | None

    @property
    def drivable(self) -> Trajectory | None:
        """The drive, where it keeps the limits."""
        evaluation = self.solution.evaluation
        return self.solution.trajectory if evaluation is not None and evaluation.feasible else None


@dataclass(frozen=True)
class Floor:
    """What was found on one floor.

    Attributes:
        drives: names.
        fits: names of models, or of a model by a further method.
        repeats: held-out errors, (repeats, drives, fits) [m].
        values: estimates by (drive, fit), (repeats, p), SI; where none was refused.
        scales: of the parameters, by fit.
    """

    drives: tuple[str, ...]
    fits: tuple[str, ...]
    repeats: Repeats
    values: Mapping[tuple[str, str], Array]
    scales: Mapping[str, Array]


@dataclass(frozen=True)
class Outcome:
    """Everything that a trial did.

    Attributes:
        trial: what was asked.
        models: on trial, the study's own first.
        planned: drives.
        fits: how models were calibrated, by name.
        found: of every repeat that was done, by the floor's number and its own.
        seed: of every random draw.
    """

    trial: Trial
    models: tuple[Candidate, ...]
    planned: tuple[Planned, ...]
    fits: Mapping[str, Fitting]
    found: Mapping[tuple[int, int], Found]
    seed: int

    def data(self, *, interrupted: bool) -> dict[str, Any]:
        """A record's `physics`."""
        return {
            **self.trial.model_dump(mode="json", exclude={"models"}, exclude_none=True),
            "seed": self.seed,
            "interrupted": interrupted,
            "models": [_model_data(one) for one in self.models],
            "fits": [
                {"name": name, "kind": fit.robot.kind, "method": fit.options.method}
                for name, fit in self.fits.items()
            ],
            "planned": [_planned_data(one) for one in self.planned],
            "floors": [
                self._floor_data(number, friction) for number, friction in enumerate(self.trial.frictions)
            ],
        }

    def _floor_data(self, number: int, friction: float) -> dict[str, Any]:
        done = [found for (floor, _), found in sorted(self.found.items()) if floor == number]
        if len(done) < 2:
            return {"friction": friction, "done": len(done), "errors": [], "scatter": []}
        floor = self._floor(done)
        return {
            "friction": friction,
            "done": len(done),
            "drawn": [round(one.friction, 6) for one in done],
            "errors": [self._error_data(floor, done, *cell) for cell in _each(floor)],
            "scatter": [_scatter_data(floor, *cell) for cell in floor.values],
            "paths": {name: _drawn(path) for name, path in done[0].paths.items()},
        }

    def _floor(self, done: list[Found]) -> Floor:
        drives = tuple(done[0].paths)
        each = np.array([np.median(one.end, axis=-1) for one in done])
        cells = [(drive, fit) for drive in drives for fit in self.fits]
        return Floor(
            drives=drives,
            fits=tuple(self.fits),
            repeats=Repeats(each, self.trial.resamples, self.seed),
            values={
                cell: np.array([one.values[cell] for one in done])
                for cell in cells
                if all(cell in one.values for one in done)
            },
            scales={name: _scales(fit) for name, fit in self.fits.items()},
        )

    def _error_data(self, floor: Floor, done: list[Found], drive: str, fit: str) -> dict[str, Any]:
        row, column = floor.drives.index(drive), floor.fits.index(fit)
        each = floor.repeats.errors[:, row, column]
        along = [np.median(one.along[row, column]) for one in done]
        misfit = [one.misfit[row, column] for one in done]
        return {
            "drive": drive,
            "fit": fit,
            **_interval_data(floor.repeats.median(row, column)),
            "along": _plain(float(np.median(along))),
            "misfit": _plain(float(np.median(misfit))),
            "refused": int(np.sum(~np.isfinite(each))),
            "each": [_plain(round(value, 7)) for value in each],
        }


def _each(floor: Floor) -> list[tuple[str, str]]:
    return [(drive, fit) for drive in floor.drives for fit in floor.fits]


def _scales(fit: Fitting) -> Array:
    table = {one.name: one.scale or 1.0 for one in fit.robot.parameters}
    return np.array([table[name] for name in fit.parameters])


def _scatter_data(floor: Floor, drive: str, fit: str) -> dict[str, Any]:
    values, scales = floor.values[drive, fit], floor.scales[fit]
    relative = scatter(values, scales)
    judged = total(scatter(values[floor.repeats.picks], scales))
    return {
        "drive": drive,
        "fit": fit,
        "mean": values.mean(axis=0).tolist(),
        "relative": relative.tolist(),
        "total": _interval_data(interval(float(total(relative)), judged)),
        "each": [[float(f"{value:.7g}") for value in row] for row in values],
    }


def _interval_data(found: Interval) -> dict[str, float | None]:
    return {"value": _plain(found.value), "low": _plain(found.low), "high": _plain(found.high)}


def _model_data(one: Candidate) -> dict[str, Any]:
    names = one.problem.estimate or tuple(entry.name for entry in one.problem.robot.parameters)
    table = {entry.name: entry for entry in one.problem.robot.parameters}
    return {
        "name": one.name,
        "kind": label_of(one.problem.model),
        "parameters": [
            {
                "name": name,
                "nominal": table[name].nominal,
                "unit": table[name].unit,
                "scale": table[name].scale or 1.0,
            }
            for name in names
        ],
    }


def _planned_data(one: Planned) -> dict[str, Any]:
    evaluation, trajectory = one.solution.evaluation, one.solution.trajectory
    return {
        "name": one.name,
        "model": None if one.model is None else one.model.name,
        "criterion": None
        if one.model is None
        else one.solution.criterion or one.model.problem.criterion.kind,
        "status": one.solution.status.value,
        "message": one.solution.message,
        "feasible": one.drivable is not None,
        "violations": {} if evaluation is None else dict(evaluation.violations),
        "path_length": None if evaluation is None else evaluation.path_length,
        "fastest": None if trajectory is None else float(np.abs(trajectory.inputs).max()),
        "wall_seconds": round(one.solution.wall_seconds, 3),
        "promised": None if one.told is None else {name: _plain(size) for name, size in one.told.items()},
        "path": None if evaluation is None else _drawn(evaluation.states[:, :2]),
        "inputs": None if trajectory is None else np.round(trajectory.inputs, 6).tolist(),
    }


def _plain(value: float) -> float | None:
    # As JSON has it: none where it is infinite or no number.
    return float(value) if np.isfinite(value) else None


def _drawn(path: Array) -> list[list[float]]:
    picks = np.unique(np.linspace(0, len(path) - 1, min(len(path), DRAWN)).round().astype(int))
    return [[float(x), float(y)] for x, y in np.round(path[picks], 4)]
