"""What is drawn of a record: the paths of its drives, run by run, and the room that they are in."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from oed.foundation.arrays import Array, Places
from oed.kernel.measurement.measurement import sensors_of
from oed.records.record import Record
from oed.records.stored.result import Result
from oed.report.parts.reading import NOWHERE, called, heading, segments, with_drive
from oed.robots.limits import Obstacle, Workspace
from oed.robots.limits.shapes import Outline
from oed.robots.models.arcs import goes_sideways, signed_speeds
from oed.robots.sensors.mapped import points_seen

SLENDER = 1.35
"""How far a player's triangle reaches from the origin, in half its width."""
MARGIN = 0.08
"""Room around the paths and the workspace, as a share of their size."""


@dataclass(frozen=True)
class Box:
    """What is in sight: from `low` to `high`, (2,) each [m]."""

    low: Array
    high: Array

    @classmethod
    def of(cls, *points: Array) -> Box:
        """The smallest one with all points, each (n, 2)."""
        every = np.vstack(points)
        return cls(every.min(axis=0), every.max(axis=0))

    @classmethod
    def around(cls, boxes: Iterable[Box]) -> Box:
        """The smallest one with all of these."""
        return cls.of(*(np.vstack([one.low, one.high]) for one in boxes))

    @property
    def size(self) -> Array:
        """Width and height [m]."""
        return np.asarray(self.high - self.low)

    def padded(self, by: float) -> Box:
        """With so much more on every side [m]."""
        return Box(self.low - by, self.high + by)

    def within(self, other: Box) -> Box | None:
        """What of it is in the other; None for nothing."""
        low, high = np.maximum(self.low, other.low), np.minimum(self.high, other.high)
        return Box(low, high) if np.all(low <= high) else None


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

    @property
    def area(self) -> Box | None:
        """Where the workspace is; None for nothing."""
        return None if self.floor is None else _box(self.floor)

    @property
    def shapes(self) -> list[Box]:
        """Where the obstacles are."""
        return [_box(one) for one in self.hatched]


def _box(outline: Outline) -> Box:
    left, right, bottom, top = outline.extent
    return Box(np.array([left, bottom]), np.array([right, top]))


def room_of(record: Record) -> Room:
    """The room of a record's study."""
    limits: Any = record.robot_study.limits
    beacons = points_seen(sensors_of(record.study.measurement))
    obstacles = () if limits.obstacles is None else limits.obstacles.shapes
    return Room(limits.workspace, obstacles, beacons, record.robot_study.robot.body_radius)


def robot_width(record: Record) -> float:
    """Width [m] of the triangle that stands for the robot; 0 where its size is not known."""
    robot = record.robot_study.robot
    width = min(robot.body_width or math.inf, 2 * (robot.body_radius or math.inf) / SLENDER)
    return width if math.isfinite(width) else 0.0


@dataclass(frozen=True)
class Run:
    """A run of a drive, from its start to its end.

    Attributes:
        x, y, heading: at the samples, (N + 1,) [m, m, rad].
        speed: mean over each period, (N,) [m/s]; negative where the robot drives backwards, of one that
            drives sideways as well never.
        edges: sample indices at which segments meet, the ends left out.
        trailer: positions of a trailer's axle at the samples, (N + 1, 2) [m]; None without one.
    """

    x: Array
    y: Array
    heading: Array
    speed: Array
    edges: Places
    trailer: Array | None = None

    @property
    def steps(self) -> Array:
        """Distance from each sample to the next, (N,) [m]."""
        return np.asarray(np.hypot(np.diff(self.x), np.diff(self.y)))

    @property
    def ends(self) -> Array:
        """Where it starts and where it ends, (2, 2) [m]."""
        return np.column_stack([self.x, self.y])[[0, -1]]

    @property
    def points(self) -> Array:
        """All that is drawn of it, (n, 2) [m]."""
        own = np.column_stack([self.x, self.y])
        return own if self.trailer is None else np.vstack([own, self.trailer])


@dataclass(frozen=True)
class Path:
    """A drive's path.

    Attributes:
        title: the result's name.
        runs: one after the other.
        feasible: whether the drive satisfies every limit.
        sideways: whether the robot drives sideways as well, so that its heading has to be shown.
        robots: paths of simulated robots with other parameters, by robot and run, (n, 2) each [m].
    """

    title: str
    runs: tuple[Run, ...]
    feasible: bool
    sideways: bool = False
    robots: tuple[tuple[Array, ...], ...] = ()

    @property
    def goes(self) -> bool:
        """Whether the robot leaves its place."""
        return any(run.steps.sum() >= NOWHERE for run in self.runs)

    @property
    def tows(self) -> bool:
        """Whether it has a trailer."""
        return any(run.trailer is not None for run in self.runs)


def path_of(record: Record, result: Result) -> Path:
    """The path of a result that has a drive, from the poses saved with it."""
    drive = result.drive
    assert drive is not None
    sideways = moves_sideways(record)
    runs = tuple(_run(record, poses, drive.trajectory.period, sideways) for poses in drive.by_run)
    return Path(heading(result, called(record, result)), runs, result.feasible, sideways)


def simulated_robots(record: Record) -> tuple[tuple[Array, ...], ...]:
    """Return paths of simulated robots on the best drive, by robot and run; () where there are none."""
    best, departures, robustness = record.best, record.departures, record.robustness
    bundles = [departures.bundle] if departures is not None and departures.bundle is not None else []
    bundles += robustness.bundles if robustness is not None else []
    chosen = [bundle for bundle in bundles if best is not None and bundle.name == best.name]
    return tuple(tuple(map(np.array, runs)) for bundle in chosen[:1] for runs in bundle.paths)


def moves_sideways(record: Record) -> bool:
    """Whether the record's robot drives sideways as well as ahead: by its kind, or seen from its drives."""
    drives = [one.drive for one in with_drive(record) if one.drive is not None]
    return record.robot_study.robot.sideways or any(
        goes_sideways(poses, NOWHERE) for drive in drives for poses in drive.by_run
    )


def _run(record: Record, poses: Array, period: float, sideways: bool) -> Run:
    x, y, angle = poses[:, :3].T
    speed = signed_speeds(poses, period, record.robot_study.space.integration, sideways)
    count = segments(record, len(speed)) or 1
    edges = np.rint(np.linspace(0, len(speed), count + 1)).astype(np.int64)[1:-1]
    return Run(x, y, angle, speed, edges, _trailer(record, poses))


def _trailer(record: Record, poses: Array) -> Array | None:
    robot = record.robot_study.robot
    return robot.body(poses)[:, -1] if robot.towed and poses.shape[1] > 3 else None


def view_of(record: Record, results: Sequence[Result]) -> Box:
    """A view on drives, workspace and obstacles, with a margin."""
    room = room_of(record)
    runs = [poses for one in results if one.drive is not None for poses in one.drive.by_run]
    trailers = (_trailer(record, poses) for poses in runs)
    paths = [*(poses[:, :2] for poses in runs), *(path for path in trailers if path is not None)]
    shapes = [*room.shapes, *([] if room.area is None else [room.area])]
    box = Box.around([Box.of(*paths).padded(room.body_radius), *shapes])
    return box.padded(MARGIN * max(*box.size, 0.1))
