"""Commands as a table, CSV, and as JSON: for any program."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from typing import Any

import numpy as np

from oed.exporters.commands import Commands
from oed.exporters.request import Request
from oed.exporters.vehicle import Vehicle
from oed.foundation.files import write_text

FORMAT = 1
"""Of the JSON file."""
TWIST = {"v": (0, "m/s"), "omega": (2, "rad/s"), "v_lateral": (1, "m/s")}
"""Columns of twists and their units, by name."""


def write_csv(request: Request) -> Path:
    """Write a row per command: t, the inputs, v, omega (v_lateral), and the state when it begins; SI.

    Of a robot whose inputs are called v and omega these are its commands.

    Several runs follow each other, told apart by a first column `run`, each on its own clock. The last row
    of a run is the command to stop. `oed.records.path_file.read_trajectory` takes it for a period like the
    others: what it reads ends with one period at rest.
    """
    path = request.path("commands.csv")
    write_text(path, _csv(request))
    return path


def _csv(request: Request) -> str:
    vehicle, runs = request.vehicle, request.runs
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    twists = {name: column for name, column in _twists(vehicle).items() if name not in vehicle.input_names}
    names = ["t", *vehicle.input_names, *twists, *vehicle.states]
    several = len(runs) > 1
    writer.writerow([*(["run"] if several else []), *names])
    for number, run in enumerate(runs, start=1):
        twist = run.twists[:, list(twists.values())]
        table = np.column_stack([np.round(run.times, 9), run.inputs, twist, run.poses])
        writer.writerows([*([number] if several else []), *row] for row in table.tolist())
    return buffer.getvalue()


def _twists(vehicle: Vehicle) -> dict[str, int]:
    # Columns of the twists that a robot can have, by name.
    return {name: column for name, (column, _) in TWIST.items() if vehicle.sideways or name != "v_lateral"}


def write_json(request: Request) -> Path:
    """Write the same as JSON, with the robot and the units; numbers SI, lists of one length in each run."""
    path = request.path("commands.json")
    write_text(path, json.dumps(_json(request), allow_nan=False) + "\n")
    return path


def _json(request: Request) -> dict[str, Any]:
    return {
        "format": FORMAT,
        "study": request.record.study.name,
        "result": request.name,
        "robot": request.record.echo["robot"],
        "rate": request.runs[0].rate,
        "inputs": list(request.vehicle.input_names),
        "units": _units(request),
        "departures": request.departures,
        "runs": [_json_run(request, run) for run in request.runs],
    }


def _units(request: Request) -> dict[str, str]:
    vehicle = request.vehicle
    return {
        "t": "s",
        **{entry.name: entry.unit for entry in vehicle.inputs},
        **{name: TWIST[name][1] for name in _twists(vehicle)},
        **dict(zip(vehicle.states, vehicle.state_units, strict=True)),
    }


def _json_run(request: Request, run: Commands) -> dict[str, Any]:
    vehicle = request.vehicle
    return {
        "t": np.round(run.times, 9).tolist(),
        "inputs": dict(zip(vehicle.input_names, run.inputs.T.tolist(), strict=True)),
        "twist": {name: run.twists[:, column].tolist() for name, column in _twists(vehicle).items()},
        "poses": dict(zip(vehicle.states, run.poses.T.tolist(), strict=True)),
    }
