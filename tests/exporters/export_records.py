"""Saved records to export from: drives given by hand; nothing is solved, nothing is scored."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.solution import Solution, Status
from oed.records.outcomes import result_of
from oed.robots.models import Model
from oed.study.study import Study
from oed.workflow.runner import record
from oed.workflow.studies import parse_study

TEXT = """\
format: 1
name: Out to the robot
robot: ROBOT
trajectory: {duration: 2 s, samples: 8, spline: {degree: 1, coefficients: 4}, rest_to_rest: false, RUNS}
measurement: {kind: poses, noise: {position: 1 cm, heading: 1 deg}}
limits:
  wheel_speed: 10 rad/s
LIMITS
criterion: {kind: E, scaling: relative}
"""
DIFFERENTIAL = (
    "{kind: differential_drive, wheel_radius_right: 5.1 cm, wheel_radius_left: 4.9 cm, track: 20 cm}"
)
TRICYCLE = "{kind: tricycle, wheel_radius: 10 cm, wheelbase: 40 cm, steering_offset: 2 deg}"
MECANUM = "{kind: mecanum, wheel_radius: 5 cm, half_wheelbase_plus_half_track: 30 cm}"
STEERED = "steering_angle: 40 deg"
UNICYCLE = "{kind: unicycle, gain_v: 0.8, gain_omega: 1.25}"
COMMANDED = "commanded_speed: 10 m/s\n  commanded_yaw_rate: 10 rad/s"


@cache
def study_of(robot: str = DIFFERENTIAL, limits: str = "", runs: int = 1) -> Study:
    """A study of 8 periods of 0.25 s in each run."""
    text = TEXT.replace("ROBOT", robot).replace("RUNS", f"runs: {runs}")
    text = text.replace("  wheel_speed: 10 rad/s\n", "") if robot == UNICYCLE else text
    return parse_study(text.replace("LIMITS", f"  {limits}" if limits else ""))


def winding(study: Study) -> Trajectory:
    """A drive with other inputs in every period, from other poses in every run."""
    space, model = study.problem.design, study.problem.model
    rng = np.random.default_rng(0)
    largest = np.array([1.0 if one.drives else 0.1 for one in model.inputs])
    inputs = rng.uniform(1.0, 5.0, (space.all_samples, len(largest))) * largest
    starts = study.problem.start_states(rng.uniform(-1, 1, (space.runs, 3)))
    return Trajectory.from_samples(
        inputs, space.whole_duration, starts, rest_to_rest=space.rest_to_rest, runs=space.runs
    )


def entry(name: str, drive: Trajectory | None, feasible: bool = True) -> dict[str, Any]:
    """A record's result, of which nothing but the drive is known; exports do not read its poses."""
    held = None
    if drive is not None:
        arrays = {key: getattr(drive, key).tolist() for key in ("knots", "coefficients", "start")}
        poses = np.zeros((drive.samples + drive.runs, drive.starts.shape[1])).tolist()
        sizes = {"degree": drive.degree, "samples": drive.samples, "runs": drive.runs}
        held = {**arrays, **sizes, "poses": poses}
    solution = Solution(name, "path", None, None, Status.SCORED)
    known = {"objective": 1.0 if feasible else None, "path_length": None if drive is None else 1.0}
    return {**result_of(solution, None).plain(), "feasible": feasible, **known, "drive": held}


def saved(folder: Path, study: Study, results: list[dict[str, Any]] | None = None) -> Path:
    """A folder with the study's record: its winding drive, by the name `my drive`."""
    folder.mkdir(parents=True, exist_ok=True)
    chosen = [entry("my drive", winding(study))] if results is None else results
    data = {**record(study, [], 0).data, "results": chosen}
    (folder / "record.json").write_text(json.dumps(data))
    return folder


def simulated(model: Model, drive: Trajectory) -> np.ndarray:
    """The poses of a run of a robot with two wheels, written independently of the package: (N + 1, 3)."""
    right, left, track = model.nominal[:3]
    x, y, heading = drive.start
    poses = [(x, y, heading)]
    for wheel_right, wheel_left in drive.inputs:
        speed = (right * wheel_right + left * wheel_left) / 2
        yaw_rate = (right * wheel_right - left * wheel_left) / track
        radius, before, heading = speed / yaw_rate, heading, heading + yaw_rate * drive.period
        x += radius * (np.sin(heading) - np.sin(before))
        y -= radius * (np.cos(heading) - np.cos(before))
        poses.append((x, y, heading))
    return np.array(poses)
