"""Records of other robots, rooms and several runs: drives scored as given; nothing is solved."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from recorded import record_from

from oed.kernel.evaluation import evaluate
from oed.kernel.solution import Solution, Status
from oed.records.record import Record
from oed.study.study import Study
from oed.workflow.runner import record as record_of
from oed.workflow.studies import parse_study

HEAD = """\
format: 1
name: NAME
robot: ROBOT
trajectory: {duration: 8 s, samples: 40, spline: {degree: 3, coefficients: 8}, RUNS}
DISPLACED
LIMITS
criterion: {kind: E, scaling: relative}
"""
DISPLACED = "measurement: {kind: displacements, segments: 4, noise: {position: 1 cm, heading: 1 deg}}"
POSES = "measurement: {kind: poses, noise: {position: 1 cm, heading: 1 deg}}"
ROOM = """\
limits:
  wheel_speed: {bounds: 10 rad/s}
  wheel_acceleration: 40 rad/s^2
  workspace: {kind: polygon, points: [[-1, -1], [2, -1], [2, 0.2], [0.8, 0.2], [0.8, 1.4], [-1, 1.4]]}
  obstacles:
    - {kind: circle, x: 1.4 m, y: -0.5 m, radius: 0.2 m}
    - {kind: polygon, points: [[-0.8, 0.9], [-0.4, 0.9], [-0.4, 1.2], [-0.6, 1.0], [-0.8, 1.2]]}
"""
CIRCLE = """\
limits:
  wheel_speed: 10 rad/s
  wheel_acceleration: 40 rad/s^2
  wheel_jerk: 500 rad/s^3
  steering_angle: 35 deg
  steering_rate: 200 deg/s
  body_speed: 1 m/s
  yaw_rate: 90 deg/s
  lateral_acceleration: 1 m/s^2
  turning_radius: 0.4 m
  workspace: {kind: circle, x: 0.4, y: 0, radius: 1.2 m}
"""
REST = np.array([0.0, 0.5, 1.0, 1.0, 1.0, 1.0, 0.5, 0.0])
WAVE = np.array([0.0, 0.6, -0.8, 0.9, -0.7, 0.2, 0.3, 0.0])
TURN = np.array([0.0, 0.5, 1.0, -0.6, -1.0, 0.3, 0.6, 0.0])
Runs = list[tuple[tuple[np.ndarray, ...], tuple[float, ...]]]
"""Of every run, its inputs' coefficients and its start state."""


def text_of(robot: str, limits: str, runs: str = "runs: 1", name: str = "Rooms") -> str:
    """A study's text."""
    text = (
        HEAD.replace("DISPLACED", DISPLACED)
        .replace("NAME", name)
        .replace("ROBOT", robot)
        .replace("RUNS", runs)
    )
    return text.replace("LIMITS", limits.rstrip())


def scored(study: Study, name: str, runs: Runs) -> Solution:
    """A drive of these runs, scored as given."""
    coefficients = np.vstack([np.column_stack(inputs) for inputs, _ in runs])
    trajectory = study.problem.design.trajectory(coefficients, [start for _, start in runs])
    return Solution(name, "path", trajectory, evaluate(study.problem, trajectory), Status.SCORED)


def recorded(text: str, drives: dict[str, Runs]) -> dict[str, Any]:
    """A record's data as `oed run` would leave it."""
    study = parse_study(text)
    return record_of(study, [scored(study, name, runs) for name, runs in drives.items()], 7).data


MECANUM = "{kind: mecanum, wheel_radius: 5 cm, half_wheelbase_plus_half_track: 30 cm, body_radius: 15 cm}"


@cache
def crab() -> Record:
    """A mecanum robot with a body among obstacles: three runs, one sideways, one ahead, one winding."""
    left = (-3 * REST, 3 * REST, 3 * REST, -3 * REST)
    ahead = (5 * REST, 5 * REST, 5 * REST, 5 * REST)
    winding = (-2 * REST, 5 * REST + 2 * TURN, -REST - TURN, 4 * REST + 3 * TURN)
    starts = "start: [{x: 0, y: 0}, {x: -0.6, y: -0.6}, {x: 0, y: 0}]"
    places = ((0.0, 0.0, 0.0), (-0.6, -0.6, 0.0), (0.0, 0.0, 0.0))
    text = text_of(MECANUM, ROOM, f"runs: 3, {starts}", "Crab")
    drives = {
        "ipopt": list(zip((left, ahead, winding), places, strict=True)),
        "other": list(zip((ahead, winding, left), places, strict=True)),
    }
    return record_from(recorded(text, drives))


@cache
def steered() -> Record:
    """An Ackermann robot in a circle, many limits, two drives of two runs each from one start."""
    robot = "{kind: ackermann, wheel_radius: 5 cm, wheelbase: 33 cm}"
    text = text_of(robot, CIRCLE, "runs: 2", "Steered").replace(DISPLACED, POSES)
    start = (0.0, 0.0, 0.0)
    drives = {
        "ipopt": [((7 * TURN, 0.5 * REST), start), ((4 * REST, 0.5 * TURN), start)],
        "fast": [((9 * REST, 0.6 * TURN), start), ((-5 * REST, 0.7 * WAVE), start)],
    }
    return record_from(recorded(text, drives))


@cache
def towing() -> Record:
    """A tractor with a trailer, its wheels limited one by one, in an L-shaped room."""
    lengths = "wheel_radius: 5 cm, track: 20 cm, hitch_offset: 10 cm, trailer_length: 40 cm"
    robot = f"{{kind: tractor_trailer, {lengths}}}"
    limits = ROOM.replace(
        "{bounds: 10 rad/s}", "{wheel_speed_right: 10 rad/s, wheel_speed_left: [-5 rad/s, 8 rad/s]}"
    )
    text = text_of(robot, f"{limits}  trailer_angle: 60 deg\n", "runs: 1", "Towing")
    start = (0.0, 0.0, 0.0, 0.0)
    drives: dict[str, Runs] = {
        "ipopt": [((4 * REST + TURN, 3 * REST + 2 * WAVE), start)],
        "arc": [((4 * REST, 2 * REST), start)],
    }
    return record_from(recorded(text, drives))


@cache
def omni() -> Record:
    """A robot on three wheels, one run, no workspace."""
    robot = "{kind: omni_three, wheel_radius: 4 cm, centre_distance: 20 cm}"
    text = text_of(robot, "limits: {wheel_speed: 12 rad/s}", name="Omni")
    # One of its coefficients is 0: nothing is relative to that.
    text = text.replace("scaling: relative", "scaling: none")
    return record_from(
        recorded(text, {"ipopt": [((5 * REST + TURN, -REST, -4 * REST + 2 * TURN), (0.0, 0.0, 0.0))]})
    )


@cache
def stepped() -> Record:
    """Piecewise constant wheel speeds in two runs."""
    robot = "{kind: differential_drive, wheel_radius: 4.9 cm, track: 18 cm}"
    text = text_of(robot, "limits: {wheel_speed: 12 rad/s}", "runs: 2, rest_to_rest: false", "Stepped")
    text = text.replace("degree: 3", "degree: 0")
    start = (0.0, 0.0, 0.0)
    return record_from(
        recorded(text, {"ipopt": [((6 * WAVE, 5 * REST), start), ((5 * REST, 2 * REST), start)]})
    )


ROOMS = {"crab": crab, "steered": steered, "towing": towing, "omni": omni, "stepped": stepped}
