"""What drives, as far as commands need it: its inputs, its states, whether it moves sideways."""

from __future__ import annotations

from dataclasses import dataclass

from oed.exporters.recorded import motions_of
from oed.foundation.errors import FileFlaw, RecordError
from oed.records.record import FILE, Record
from oed.records.stored.result import StoredDrive
from oed.robots.models import Input, Model, moves_sideways

POSE = (("x", "m"), ("y", "m"), ("heading", "rad"))


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
        raise RecordError([FileFlaw(str(record.file or FILE), 0, 0, "inputs", text)])
    inputs = tuple(Input(one.name, one.quantity, one.unit) for one in record.inputs)
    motions = motions_of(record, drive, 1.0)
    named = [(one.name, one.unit) for one in record.states]
    states = named or [*POSE, *((f"state_{place + 1}", "") for place in range(3, motions[0].states.shape[1]))]
    names, units = zip(*states, strict=True)
    return Vehicle(inputs, names, units, any(motion.sideways for motion in motions), None)
