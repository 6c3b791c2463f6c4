"""How a robot moves along its drives, at any time, and what has to be in sight of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from oed.records.record import Record
from oed.report.figures.driven import Array, path_of, poses_of
from oed.report.parts.reading import Entry
from oed.report.parts.rooms import Room
from oed.robots.models.arcs import between

MARGIN = 0.08
"""Room around the paths and the workspace, as a share of their size."""
TURN = 0.05
"""Largest turn between two places of a motion [rad]: arcs look round."""
FINEST = 40
"""Places between two samples at most."""


@dataclass(frozen=True)
class Motion:
    """A run as it is seen: so close in time that straight lines between its places look like its arcs.

    Attributes:
        times: from 0 to its duration, (n,) [s].
        poses: x, y, heading, and of a tractor its trailer's angle, at the times, (n, states) [m, m, rad].
    """

    times: Array
    poses: Array

    @property
    def duration(self) -> float:
        """How long it takes [s]."""
        return float(self.times[-1])

    def at(self, time: float) -> Array:
        """The pose at a time [s], (states,)."""
        return np.array([np.interp(time, self.times, column) for column in self.poses.T])

    def until(self, time: float) -> Array:
        """The path from the start to where the robot is at a time [s], (k, 2) [m]."""
        passed = self.poses[: int(np.searchsorted(self.times, time, side="right")), :2]
        return np.vstack([passed, self.at(time)[:2]])


def motions_of(entry: Entry) -> list[Motion]:
    """The runs of a result that has a drive."""
    runs = poses_of(entry)
    duration = float(entry["drive"]["knots"][-1]) / len(runs)
    return [motion(poses, duration) for poses in runs]


def motion(poses: Array, duration: float) -> Motion:
    """The motion through poses (N + 1, states) at even times, by the arcs between them."""
    states = poses[:, : 4 if poses.shape[1] > 3 else 3]
    sharpest = float(np.abs(np.diff(states[:, 2])).max(initial=0.0))
    steps = int(np.clip(math.ceil(sharpest / TURN), 1, FINEST))
    shares = np.arange(steps) / steps
    parts = np.concatenate([between(*pair, shares) for pair in pairwise(states)])
    fine = np.vstack([parts, states[-1]])
    return Motion(np.linspace(0.0, duration, len(fine)), fine)


def view_of(record: Record, entries: Sequence[Entry], room: Room) -> tuple[float, float, float, float]:
    """x_min, x_max, y_min, y_max [m] of a view on drives, workspace and obstacles, with a margin."""
    boxes = [one.extent for one in (room.floor, *room.hatched) if one is not None]
    shapes = [(x, y) for left, right, bottom, top in boxes for x, y in ((left, bottom), (right, top))]
    paths = [run.points for entry in entries for run in path_of(record, entry, sideways=False).runs]
    own = np.vstack(paths)
    points = np.vstack([own - room.body_radius, own + room.body_radius, np.reshape(shapes, (-1, 2))])
    (left, bottom), (right, top) = points.min(axis=0), points.max(axis=0)
    pad = MARGIN * max(right - left, top - bottom, 0.1)
    return float(left - pad), float(right + pad), float(bottom - pad), float(top + pad)
