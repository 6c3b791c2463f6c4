"""What a film shows: drives, their room and the robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from oed.records.record import Record
from oed.records.stored.result import Result
from oed.report.figures.driven import Box, Motion, Room, motions_of, robot_width, room_of, view_of
from oed.report.parts.reading import heading
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
        view: what is in sight.
        width: of the robot [m]; 0 where it is not known.
        robot: itself, for what it tows.
    """

    title: str
    room: Room
    view: Box
    width: float
    robot: Model


def cast_of(result: Result) -> Cast:
    """A result that has a drive, ready to be shown."""
    return Cast(heading(result), tuple(motions_of(result)))


def scene_of(record: Record, results: Sequence[Result]) -> Scene:
    """What surrounds these drives of a record."""
    room = room_of(record)
    view = view_of(record, results, room)
    return Scene(record.study.name, room, view, robot_width(record), record.study.robot)
