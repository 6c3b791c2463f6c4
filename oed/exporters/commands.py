"""What a robot is commanded, step by step, and what it does then: the same for every format."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from oed.foundation.arrays import ROUNDING, Array, Bools
from oed.kernel.dynamics.rollout import roll_out
from oed.kernel.dynamics.trajectory import Trajectory
from oed.robots.models import Input, Model
from oed.robots.models.twists import asked_twists

Motion = Callable[[Array, float], tuple[Array, Array]]
"""Twists (K, 3) and states (K + 1, states) of inputs (K, inputs) that are held at a rate [Hz]."""


@dataclass(frozen=True)
class Commands:
    """The commands of one run. Each holds from its time to the next; the last stops the robot.

    Attributes:
        rate: of the commands [Hz].
        inputs: (K + 1, inputs), SI. In the last row speeds are 0; angles keep their last value.
        moving: of each input whether it is a speed (else an angle, or what else only shapes the motion).
        twists: forward speed [m/s], lateral speed to the left [m/s], yaw rate [rad/s] that the inputs ask for
            with the robot's nominal parameters, (K + 1, 3); 0 in the last row. Of a throttle what it makes.
        poses: the states that these commands lead to from the run's start, (K + 1, states).
    """

    rate: float
    inputs: Array
    moving: Bools
    twists: Array
    poses: Array

    @property
    def times(self) -> Array:
        """When each command begins, (K + 1,) [s], from 0."""
        return np.asarray(np.arange(len(self.inputs)) / self.rate)

    @property
    def turned(self) -> Array:
        """Time integral of the inputs from the run's start, (K + 1, inputs): of a wheel's speed the angle
        turned [rad].
        """
        sums = np.cumsum(self.inputs[:-1], axis=0) / self.rate
        return np.vstack([np.zeros((1, self.inputs.shape[1])), sums])

    @property
    def positions(self) -> Array:
        """Positions of the joints that the inputs drive, (K + 1, inputs): of wheels the angle turned, of
        steered axes the angle commanded [rad].
        """
        return np.where(self.moving, self.turned, self.inputs)

    @property
    def velocities(self) -> Array:
        """Velocities of these joints, (K + 1, inputs), [rad/s]: held for a period they lead from each
        position to the next.
        """
        nothing = np.zeros((1, self.inputs.shape[1]))
        rates = np.vstack([np.diff(self.positions, axis=0) * self.rate, nothing])
        return np.where(self.moving, self.inputs, rates)


def commands(model: Model, trajectory: Trajectory, rate: float | None = None) -> tuple[Commands, ...]:
    """The commands of every run of a robot's drive, its poses integrated by its rule.

    Args:
        model: the robot, with its integration rule.
        trajectory: the drive.
        rate: of the commands [Hz], above 0; by default the drive's own, one command per period.
    """
    motions = [partial(_simulated, model, run.start) for run in trajectory.each]
    return commands_along(model.inputs, motions, trajectory, rate)


def _simulated(model: Model, start: Array, held: Array, rate: float) -> tuple[Array, Array]:
    # With numbers in place of symbols a roll-out is a simulation.
    parameters, period = np.array(model.nominal), np.array(1 / rate)
    drive = roll_out(model, inputs=held, start=start, parameters=parameters, period=period)
    # What is pushed asks for no twist: it makes one.
    pushed = any(entry.pushes for entry in model.inputs)
    twists = np.array(drive.signals["twist"]) if pushed else asked_twists(model, held)
    return twists, np.array(drive.states)


def commands_along(
    inputs: Sequence[Input], motions: Sequence[Motion], trajectory: Trajectory, rate: float | None
) -> tuple[Commands, ...]:
    """The commands of every run of a drive.

    Args:
        inputs: of the robot.
        motions: how it moves in every run.
        trajectory: the drive.
        rate: of the commands [Hz]; by default the drive's own.
    """
    chosen = 1 / trajectory.period if rate is None else rate
    moving = np.array([entry.drives for entry in inputs])
    found = []
    for run, motion in zip(trajectory.each, motions, strict=True):
        held = resampled(run.inputs, run.period, chosen, moving)
        twists, poses = motion(held, chosen)
        last = np.where(moving, 0.0, held[-1:])
        found.append(
            Commands(chosen, np.vstack([held, last]), moving, np.vstack([twists, np.zeros((1, 3))]), poses)
        )
    return tuple(found)


def resampled(inputs: Array, period: float, rate: float, moving: Bools) -> Array:
    """Inputs held for `period` [s] each, (N, inputs), as inputs to be held for 1 / rate each, (K, inputs).

    Where the new clock divides the old one, every input is repeated and nothing changes. Else each new
    input is the mean of the old ones over its time, so that wheels turn by the same angle in each new
    period. A last period that ends after the drive is filled with standing still.

    Args:
        inputs: SI.
        period: [s].
        rate: [Hz].
        moving: of each input whether it is a speed; what is none is averaged over the drive's time alone.
    """
    finer = period * rate
    whole = max(1, round(finer))
    if abs(finer - whole) <= ROUNDING * whole:
        return np.repeat(inputs, whole, axis=0)
    duration = len(inputs) * period
    count = max(1, math.ceil(duration * rate - ROUNDING))
    edges = np.arange(count + 1) / rate
    edges[-1] = max(edges[-1], duration)
    known = np.arange(len(inputs) + 1) * period
    sums = np.vstack([np.zeros((1, inputs.shape[1])), np.cumsum(inputs, axis=0) * period])
    changes = np.diff(np.column_stack([np.interp(edges, known, column) for column in sums.T]), axis=0)
    inside = np.diff(np.minimum(edges, duration))[:, None]
    return np.asarray(np.where(moving, changes * rate, changes / inside))


def joint_name(entry: Input) -> str:
    """Name of the joint that an input drives: of `wheel_speed_right` it is `wheel_right_joint`, of
    `steering_angle` it is `steering_joint`.
    """
    part, _, what = entry.quantity.rpartition("_")
    stem = entry.name.replace(entry.quantity, part) if part and what in ("speed", "angle") else entry.name
    return f"{stem}_joint"
