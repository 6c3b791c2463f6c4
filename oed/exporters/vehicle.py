"""What drives, as far as commands need it: by its model or, where a user's code is not run, by the poses of
a record.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from oed.foundation.arrays import Array
from oed.foundation.errors import RecordError
from oed.records.record import FILE, Record
from oed.records.stored.result import StoredDrive
from oed.robots.models import COMMANDS, Input, Model, moves_sideways
from oed.robots.models.arcs import goes_sideways, moves

FARTHEST_TURN = 0.75
"""Share of a full turn in one period beyond which no speed follows from a chord."""


@dataclass(frozen=True)
class Vehicle:
    """What drives.

    Attributes:
        inputs: of the robot.
        states: their names.
        state_units: SI.
        sideways: whether it ever has a lateral speed.
        model: how its inputs move it; None where only its record says so.
    """

    inputs: tuple[Input, ...]
    states: tuple[str, ...]
    state_units: tuple[str, ...]
    sideways: bool
    model: Model | None

    @property
    def on_commands(self) -> bool:
        """Whether its inputs are the speed and the yaw rate that it is asked for."""
        return tuple(entry.quantity for entry in self.inputs) == COMMANDS

    @property
    def input_names(self) -> tuple[str, ...]:
        """Names of the inputs."""
        return tuple(entry.name for entry in self.inputs)


def vehicle_of(model: Model) -> Vehicle:
    """A robot whose model is at hand."""
    return Vehicle(model.inputs, model.states, model.state_units, moves_sideways(model), model)


def recorded_vehicle(record: Record, drive: StoredDrive) -> Vehicle:
    """A robot as its record has it.

    Raises:
        RecordError: a record that does not name the robot's inputs.
    """
    if not record.inputs:
        text = "missing: an older record does not name the inputs of a robot of somebody's own; run it again"
        raise RecordError.about(record.file or FILE, text, "inputs")
    inputs = tuple(Input(one.name, one.quantity, one.unit) for one in record.inputs)
    motions = motions_of(record, drive, 1.0)
    states = [(one.name, one.unit) for one in record.states]
    if not states:
        others = range(len(Model.states), motions[0].states.shape[1])
        pose = zip(Model.states, Model.state_units, strict=True)
        states = [*pose, *((f"state_{place + 1}", "") for place in others)]
    names, units = zip(*states, strict=True)
    sideways = any(goes_sideways(motion.states, least=0.0) for motion in motions)
    return Vehicle(inputs, names, units, sideways, None)


@dataclass(frozen=True)
class RecordedMotion:
    """The states of a run at even times, (N + 1, states): x [m], y [m], heading [rad] and others.

    Attributes:
        states: them.
        period: from each to the next [s].
        arcs: whether the robot was taken along arcs, rather than chords, from each to the next.
    """

    states: Array
    period: float
    arcs: bool

    def at(self, times: Array) -> Array:
        """The states at `times` [s], (K, states): along arcs of constant twist; at rest after the end."""
        places = np.clip(times / self.period, 0.0, len(self.states) - 1)
        first = np.minimum(places.astype(int), len(self.states) - 2)
        share = (places - first)[:, None]
        begin, change = self.states[first], self.states[first + 1] - self.states[first]
        found = begin + share * change
        turn = change[:, 2:3]
        # Both chords are of one arc: their directions differ by half of what is left of the turn.
        length = share * self._shortening(share * turn) / self._shortening(turn)
        found[:, :2] = begin[:, :2] + length * _turned(change[:, :2], (share - 1) * turn / 2)
        return np.asarray(found)

    def twists_between(self, states: Array, rate: float) -> Array:
        """Forward and lateral speed [m/s] and yaw rate [rad/s] from each of `states` to the next, (K, 3)."""
        turn = np.diff(states[:, 2:3], axis=0)
        body = np.column_stack(moves(states)) / self._shortening(turn)
        return np.asarray(np.column_stack([body, turn]) * rate)

    def driven(self, held: Array, rate: float) -> tuple[Array, Array]:
        """Twists, and states at the times of inputs held at a rate [Hz]: where the design has it then."""
        states = self.at(np.arange(len(held) + 1) / rate)
        return self.twists_between(states, rate), states

    def _shortening(self, turn: Array) -> Array:
        # Of a chord against its arc.
        most = 2 * np.pi * FARTHEST_TURN
        return np.asarray(np.sinc(np.clip(turn, -most, most) / (2 * np.pi) * self.arcs))


def _turned(vectors: Array, angles: Array) -> Array:
    cosine, sine = np.cos(angles[:, 0]), np.sin(angles[:, 0])
    x, y = vectors.T
    return np.column_stack([cosine * x - sine * y, sine * x + cosine * y])


def motions_of(record: Record, drive: StoredDrive, period: float) -> list[RecordedMotion]:
    """The motion in every run of a drive.

    Args:
        record: knows the study.
        drive: of one of its results.
        period: of its samples [s].
    """
    arcs = record.robot_study.space.integration == "arc"
    runs = np.split(np.array(drive.poses, dtype=float), drive.runs)
    return [RecordedMotion(states, period, arcs) for states in runs]
