"""What a film shows: drives, their room and the robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from oed.records.record import Record
from oed.report.parts.motion import Motion, motions_of, view_of
from oed.report.parts.reading import Entry, heading
from oed.report.parts.rooms import Room, robot_width, room_of
from oed.robots.models import Model

PAUSE = 0.6
"""Rest between two runs [s of the film]."""


@dataclass(frozen=True)
class Cast:
    """A drive to be shown.

    Attributes:
        title: its name, and what is special about it.
        runs: one after the other.
    """

    title: str
    runs: tuple[Motion, ...]

    def length(self, speed: float) -> float:
        """How long the film of it plays, without the rest at its end [s]."""
        return sum(run.duration for run in self.runs) / speed + PAUSE * (len(self.runs) - 1)

    def moment(self, time: float, speed: float) -> tuple[int, float]:
        """Which run is shown at a time of the film [s], from 0, and how far it is [s of the robot]."""
        start = 0.0
        for number, run in enumerate(self.runs):
            end = start + run.duration / speed + PAUSE
            if time < end or number == len(self.runs) - 1:
                break
            start = end
        return number, min(max(0.0, time - start) * speed, run.duration)


@dataclass(frozen=True)
class Scene:
    """What surrounds the drives of a film, and the robot.

    Attributes:
        title: of the study.
        room: in which it drives.
        view: x_min, x_max, y_min, y_max of what is in sight [m].
        width: of the robot [m]; 0 where it is not known.
        robot: itself, for what it tows.
    """

    title: str
    room: Room
    view: tuple[float, float, float, float]
    width: float
    robot: Model


def cast_of(entry: Entry) -> Cast:
    """A result that has a drive, ready to be shown."""
    return Cast(heading(entry), tuple(motions_of(entry)))


def scene_of(record: Record, entries: Sequence[Entry]) -> Scene:
    """What surrounds these drives of a record."""
    room = room_of(record)
    view = view_of(record, entries, room)
    return Scene(str(record.data["study"]["name"]), room, view, robot_width(record), record.study.robot)
