"""A simulated robot that drives a trajectory and logs it as a CSV, in the package's own columns."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import casadi as ca
import numpy as np
import numpy.typing as npt

from oed.kernel.dynamics.rollout import roll_out
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.problem import Problem

ROOM_STUDY = """
format: 1
name: A robot in a room
robot: {kind: differential_drive, wheel_radius: 33 mm, track: 160 mm}
trajectory:
  duration: 20 s
  samples: 40
  spline: {degree: 3, coefficients: 10}
  start: {x: 0 m, y: 0 m, heading: 0 deg}
measurement: {kind: poses, noise: {position: 1 cm, heading: 1 deg}}
limits:
  wheel_speed: 6 rad/s
  wheel_acceleration: 10 rad/s^2
  workspace: {kind: rectangle, x: [-1 m, 1 m], y: [-1 m, 1 m]}
seed: 1
"""
"""A study without searches or paths."""

QUICKLY = "calibration: {segment: 20 s, noise: specified, clock_offset: false}\n"
"""Logs taken for what they are: estimated in a third of the time of an estimate that looks into them."""


def write_log(
    path: Path,
    problem: Problem,
    trajectory: Trajectory,
    truth: Mapping[str, float],
    rng: np.random.Generator | None = None,
    noise: tuple[float, float] = (0.01, 0.0175),
) -> Path:
    """Drive with the true parameters; log every pose with errors (position [m], heading [rad])."""
    robot = problem.model.with_values(truth)
    drive = roll_out(
        robot,
        inputs=ca.DM(trajectory.inputs),
        start=ca.DM(trajectory.start),
        parameters=ca.DM(robot.nominal),
        period=ca.DM(trajectory.period),
    )
    poses = np.array(ca.evalf(drive.poses))
    if rng is not None:
        poses = poses + rng.normal(size=poses.shape) * [noise[0], noise[0], noise[1]]
    held: list[npt.NDArray[np.float64] | list[str]] = [*trajectory.inputs, [""] * len(robot.inputs)]
    rows = [",".join(["t", *robot.input_names, "x", "y", "heading"])]
    for index, (inputs, pose) in enumerate(zip(held, poses, strict=True)):
        rows.append(",".join(map(str, [index * trajectory.period, *inputs, *pose])))
    path.write_text("\n".join(rows) + "\n")
    return path
