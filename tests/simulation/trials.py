"""A small trial on a simulated robot whose drives are drawn, not searched for."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any, Literal

import numpy as np
import pytest
from builders import random_drive

from oed.kernel.problem import Problem
from oed.kernel.solution import Solution, scored
from oed.optimize import Context, Progress, Silent, Solver
from oed.records.outcomes import trial_of
from oed.simulation.physics import Motion, PhysicsRobot, drive
from oed.simulation.trial import aims, experiment, run, run_trial
from oed.simulation.trial.experiment import Found, Repeat, repeated
from oed.study.study import Study
from oed.workflow.studies import parse_study

STUDY = """\
format: 1
name: Small trial
robot: {kind: differential_drive, wheel_radius: 4.9 cm, track: 32 cm}
trajectory: {duration: 6 s, samples: 60, spline: {degree: 3, coefficients: 8}, start: {x: 0 m, y: 0 m}}
measurement: {kind: poses, noise: {position: 1 cm, heading: 1 deg}}
limits:
  wheel_speed: 10 rad/s
  wheel_acceleration: 20 rad/s^2
  workspace: {kind: rectangle, x: [-1 m, 1 m], y: [-1 m, 1 m]}
criterion: {kind: D}
solvers: [{kind: ipopt, starts: 1, perturbations: 0, second_stage: none}]
physics:
  robot: {kind: four_wheels, step: 1 ms}
  frictions: [0.6]
  repeats: 3
  held_out: 2
  models:
    - {kind: skid_steer_slip, name: lag, wheel_radius: 4.9 cm, track: 32 cm, yaw_lag: 10 ms}
  drives: [circle, random]
  methods: [two_stage]
  resamples: 100
"""
SHORT = STUDY.replace("duration: 6 s, samples: 60", "duration: 5 s, samples: 50").replace(
    "repeats: 3", "repeats: 2"
)


class Drawn(Solver):
    """A solver that does not search: a random drive, whatever the robot."""

    kind: Literal["drawn"] = "drawn"

    def search(self, problem: Problem, context: Context) -> Solution:
        """Of a seed of its own, slow enough to stay in the room."""
        drawn = scored(problem, random_drive(problem, 7, amplitude=3.0), self.label)
        return replace(drawn, kind=self.kind)


@cache
def study_of(text: str = STUDY) -> Study:
    return parse_study(text)


def tried(text: str = SHORT, *, workers: int = 1, progress: Progress | None = None) -> dict[str, Any]:
    """What a trial found, with drives that are drawn."""
    study = study_of(text)
    assert study.file.physics is not None
    listener = progress or Silent()
    with pytest.MonkeyPatch.context() as patched:
        for module in (aims, experiment):
            patched.setattr(module, "drive", moved)
        found = run_trial(
            study.problem, study.file.physics, Drawn(), seed=0, workers=workers, progress=listener
        )
    return trial_of(found).plain()


MOTIONS: dict[tuple[Any, ...], Motion] = {}


def moved(robot: PhysicsRobot, inputs: np.ndarray, period: float, **further: Any) -> Motion:
    """How a robot moves, simulated once: designs that are drawn are the same for several models and aims."""
    one = robot, inputs.tobytes(), inputs.shape, period, repr(further)
    if one not in MOTIONS:
        MOTIONS[one] = drive(robot, inputs, period, **further)
    return MOTIONS[one]


DRIVEN: dict[tuple[int, int], Found | None] = {}


def driven_once(repeat: Repeat) -> Found | None:
    """What a robot of the small trial finds, by its floor and number."""
    one = repeat.floor, repeat.number
    if one not in DRIVEN:
        DRIVEN[one] = repeated(repeat)
    return DRIVEN[one]


@cache
def small_trial() -> dict[str, Any]:
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(run, "repeated", driven_once)
        return tried()
