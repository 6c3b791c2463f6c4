"""The paths of a record's drives, run by run, as they are drawn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from oed.records.record import Record, drive_of
from oed.report.parts.reading import NOWHERE, Entry, heading, segments, with_drive
from oed.robots.models.arcs import mean_speeds, moves

Array = npt.NDArray[np.float64]

LATERAL = 0.01
"""Share of its way that a drive goes sideways, above which its robot counts as one of those."""


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
    edges: npt.NDArray[np.int64]
    trailer: Array | None = None

    @property
    def steps(self) -> Array:
        """Distance from each sample to the next, (N,) [m]."""
        return np.asarray(np.hypot(np.diff(self.x), np.diff(self.y)))

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
        feasible: whether the drive keeps every limit.
        sideways: whether the robot drives sideways as well, so that its heading has to be shown.
    """

    title: str
    runs: tuple[Run, ...]
    feasible: bool
    sideways: bool = False

    @property
    def goes(self) -> bool:
        """Whether the robot leaves its place."""
        return any(run.steps.sum() >= NOWHERE for run in self.runs)


@dataclass(frozen=True)
class Bundle:
    """A drive's paths with the robots that may be, each (n, 2) [m].

    Attributes:
        title: the result's name, and how many robots leave the limits.
        inside, outside: of robots that keep the limits, and of those that leave them.
        nominal: of the nominal robot, run by run.
    """

    title: str
    inside: tuple[Array, ...]
    outside: tuple[Array, ...]
    nominal: tuple[Array, ...]


def paths_of(record: Record, entries: list[Entry]) -> list[Path]:
    """The paths of results that have drives, from the poses saved with them."""
    sideways = moves_sideways(record)
    return [path_of(record, entry, sideways) for entry in entries]


def path_of(record: Record, entry: Entry, sideways: bool | None = None) -> Path:
    """The path of a result that has a drive; `sideways` where that is known of its robot already."""
    drive = drive_of(entry)
    assert drive is not None
    across = moves_sideways(record) if sideways is None else sideways
    runs = tuple(_run(record, poses, drive.period, across) for poses in poses_of(entry))
    return Path(heading(entry), runs, bool(entry["feasible"]), across)


def poses_of(entry: Entry) -> list[Array]:
    """The poses of every run, each (N + 1, states)."""
    poses = np.array(entry["drive"]["poses"], dtype=float)
    return np.split(poses, entry["drive"].get("runs", 1))


def moves_sideways(record: Record) -> bool:
    """Whether the record's robot drives sideways as well as ahead: by its kind, or seen from its drives."""
    if record.study.robot.sideways:
        return True
    return any(_goes_sideways(poses) for entry in with_drive(record) for poses in poses_of(entry))


def _goes_sideways(poses: Array) -> bool:
    _, lateral = moves(poses)
    sideways = float(np.abs(lateral).sum())
    length = float(np.hypot(*np.diff(poses[:, :2], axis=0).T).sum())
    return sideways > max(NOWHERE, LATERAL * length)


def _run(record: Record, poses: Array, period: float, sideways: bool) -> Run:
    x, y, angle = poses[:, :3].T
    speed = mean_speeds(poses, period, record.study.trajectory.integration)
    if not sideways:
        speed = np.where(moves(poses)[0] >= 0, speed, -speed)
    return Run(x, y, angle, speed, _edges(record, len(speed)), _trailer(record, poses))


def _trailer(record: Record, poses: Array) -> Array | None:
    robot = record.study.robot
    return robot.body(poses)[:, -1] if robot.towed and poses.shape[1] > 3 else None


def _edges(record: Record, samples: int) -> npt.NDArray[np.int64]:
    count = segments(record, samples) or 1
    return np.rint(np.linspace(0, samples, count + 1)).astype(np.int64)[1:-1]
