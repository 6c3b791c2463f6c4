"""The room that a study's robot drives in: outline, obstacles, beacons, and how large the robot is in it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from oed.records.record import Record
from oed.report.parts.reading import beacons
from oed.robots.limits import Obstacle, Workspace
from oed.robots.limits.outline import Outline

Array = npt.NDArray[np.float64]

SLENDER = 1.35
"""How far a player's triangle reaches from the origin, in half its width."""


@dataclass(frozen=True)
class Room:
    """What surrounds the paths.

    Attributes:
        workspace: None without one.
        obstacles: in it.
        beacons: (n, 2) [m].
        body_radius: the distance that the robot's origin keeps from walls and obstacles [m], 0 of a point.
    """

    workspace: Workspace | None = None
    obstacles: tuple[Obstacle, ...] = ()
    beacons: Array = field(default_factory=lambda: np.zeros((0, 2)))
    body_radius: float = 0.0

    @property
    def floor(self) -> Outline | None:
        """What is drawn of the workspace; None for nothing."""
        return None if self.workspace is None else self.workspace.outline

    @property
    def hatched(self) -> tuple[Outline, ...]:
        """What is drawn of the obstacles."""
        return tuple(one.outline for one in self.obstacles if one.outline is not None)


def room_of(record: Record) -> Room:
    """The room of a record's study."""
    limits: Any = record.study.limits
    obstacles = () if limits.obstacles is None else limits.obstacles.shapes
    return Room(limits.workspace, obstacles, beacons(record), record.study.robot.body_radius)


def surroundings_text(room: Room) -> str:
    """What the shapes around the paths are."""
    area = "The shaded area is the workspace." if room.workspace else "The study sets no workspace."
    return f"{area} Hatched shapes are obstacles." if room.obstacles else area


def body_text(room: Room) -> str:
    """What the circles at the paths' ends are; "" for a robot that is a point."""
    if not room.body_radius:
        return ""
    circles = f"Thin circles at start and end are the robot's body of radius {room.body_radius:g} m"
    kept = ["inside the workspace"] if room.workspace else []
    kept += ["clear of obstacles"] if room.obstacles else []
    return f"{circles}, which has to stay {' and '.join(kept)}." if kept else f"{circles}."


def robot_width(record: Record) -> float:
    """Width [m] of the triangle that stands for the robot; 0 where its size is not known."""
    robot = record.study.robot
    width = min(robot.body_width or math.inf, 2 * (robot.body_radius or math.inf) / SLENDER)
    return width if math.isfinite(width) else 0.0
