"""Records to report on: scored drives with searches' starts written by hand; nothing is solved."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np

from oed.evaluation import evaluate, parameter_table
from oed.record import Record, result_data
from oed.solution import Solution, Status
from oed.study import Study, parse_study

TEXT = """\
format: 1
name: Small <robot> | study
robot: {kind: differential_drive, wheel_radius: 4.9 cm, track: 18 cm}
trajectory: {duration: 4 s, samples: 20, spline: {degree: 3, coefficients: 8}, start: {x: 0 m, y: 0 m}}
measurement: {kind: displacements, segments: 4, regressor: REGRESSOR, noise: NOISE}
limits:
  wheel_speed: 10 rad/s
  wheel_acceleration: 20 rad/s^2
  workspace: {kind: rectangle, x: [-1 m, 1 m], y: [-1 m, 1 m]}
criterion: {kind: E, scaling: none}
solvers: [{kind: ipopt, starts: 3}]
"""
SHAPE = np.array([0.0, 0.5, 1.0, 1.0, 1.0, 1.0, 0.5, 0.0])
WAVE = np.array([0.0, 0.6, -0.8, 0.9, -0.7, 0.2, 0.3, 0.0])


def drive(study: Study, name: str, right: np.ndarray, left: np.ndarray) -> dict[str, Any]:
    """A result that was scored as given."""
    trajectory = study.problem.design.trajectory(np.column_stack([right, left]), [0.0, 0.0, 0.0])
    evaluation = evaluate(study.problem, trajectory)
    return result_data(Solution(name, "path", trajectory, evaluation, Status.SCORED), None)


def scored(regressor: str = "position", noise: str = "{position: 10 cm, heading: 10 deg}") -> dict[str, Any]:
    """A record's data: a winding drive, an arc, a straight (singular) and a fast drive (infeasible)."""
    text = TEXT.replace("REGRESSOR", regressor).replace("NOISE", noise)
    study = parse_study(text)
    shapes = {
        "ipopt": (6 * WAVE, 5 * SHAPE),
        "arc": (5 * SHAPE, 3 * SHAPE),
        "straight": (3 * SHAPE, 3 * SHAPE),
        "fast": (30 * SHAPE, 29 * SHAPE),
    }
    return {
        "format": 1,
        "oed_version": "1.2.3",
        "study": study.echo(),
        "study_text": study.text,
        "seed": 7,
        "parameters": parameter_table(study.problem),
        "results": [drive(study, name, *pair) for name, pair in shapes.items()],
        "certificate": None,
        "validation": None,
        "notes": [],
        "provenance": {
            "packages": {"casadi": "3.8.2", "numpy": "2.4.6"},
            "python": "3.11.7",
            "platform": "Linux x86_64",
            "finished": "2026-01-02T03:04:05+00:00",
        },
    }


def as_search(entry: dict[str, Any]) -> dict[str, Any]:
    """A result made to look like a search's: three starts, the last without a design, and two stages."""
    best = entry["objective"]
    found = [best, 0.9 * best, None]
    starts = [
        {"objective": value, "status": "converged", "wall_seconds": 0.5, "iterations": 10 * (index + 1)}
        for index, value in enumerate(found)
    ]
    return {
        **entry,
        "kind": "ipopt",
        "status": "converged",
        "message": "Converged.",
        "starts": starts,
        "stages": {"starts": best, "second_stage": 0.999 * best},
        "wall_seconds": 1.5,
    }


def full(**options: str) -> Record:
    """Four drives, one of them a search's, and a note."""
    data = scored(**options)
    data["results"][0] = as_search(data["results"][0])
    data["notes"] = ["`bound: true` is read, but <not> computed."]
    return Record(data)


def single() -> Record:
    data = copy.deepcopy(dict(full().data))
    data["results"] = data["results"][:1]
    data["notes"] = []
    return Record(data)


def many() -> Record:
    """Ten results."""
    data = copy.deepcopy(dict(full().data))
    first = data["results"]
    data["results"] = [{**first[index % 4], "name": f"result_{index}"} for index in range(10)]
    return Record(data)


def without_drive() -> Record:
    """A search that found nothing: null numbers, no drive."""
    data = copy.deepcopy(dict(single().data))
    entry = data["results"][0]
    numbers = ("objective", "lambda_min", "lambda_max", "condition_number", "smallest_singular_value")
    entry.update(dict.fromkeys((*numbers, "norm_y", "path_length", "drive", "trajectory")))
    entry.update(feasible=False, margins=[], standard_deviations={}, singular_values=[], stages={})
    entry.update(status="infeasible", message="One limit is in the way: wheel_speed (by 2.86 rad/s).")
    for start in entry["starts"]:
        start["objective"] = None
    return Record(data)


def only_infeasible_drive() -> Record:
    data = copy.deepcopy(dict(full().data))
    data["results"] = data["results"][3:]
    return Record(data)


def unbounded_numbers() -> Record:
    """A singular drive whose infinite numbers JSON holds as null."""
    data = copy.deepcopy(dict(single().data))
    entry = data["results"][0]
    entry.update(objective=None, condition_number=None, standard_deviations={"c21": None, "c22": 0.001})
    return Record(data)


def piecewise_constant() -> Record:
    """A degree-0 drive, no workspace, no limit on the acceleration."""
    data = copy.deepcopy(dict(single().data))
    drive = data["results"][0]["drive"]
    drive.update(degree=0, knots=[0.0, 2.0, 4.0], coefficients=[[3.0, 2.0], [-1.0, 4.0]])
    data["study"]["limits"] = {"wheel_speed": {"bounds": [-10.0, 10.0]}}
    return Record(data)


def empty() -> Record:
    data = copy.deepcopy(dict(single().data))
    data["results"] = []
    return Record(data)


RECORDS = {
    "full": full,
    "many": many,
    "without_drive": without_drive,
    "only_infeasible_drive": only_infeasible_drive,
    "unbounded_numbers": unbounded_numbers,
    "piecewise_constant": piecewise_constant,
    "empty": empty,
}
