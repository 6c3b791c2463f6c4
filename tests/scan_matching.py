"""A twin of Censi's Kheperas: drives of known truth, their wheels' log, and how the lidar on them moved.

Everything is written out here: arcs, the lidar's motion, its errors and the matches that went wrong.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from twin_drives import arcs

from oed.robots.models import DifferentialDrive

NOMINAL = DifferentialDrive(wheel_radius=0.02, track=0.09)
TRUTH = {"wheel_radius_right": 0.0207, "wheel_radius_left": 0.0206, "track": 0.0885}
MOUNTED = (-0.003, 0.006, -1.56)
"""Of the lidar: ahead, to the left [m], turned [rad]."""
HELD = 37
"""Periods that the wheels turn alike: no multiple of those between scans."""
NOISE = (1e-3, 2e-3)
"""Deviations of a match [m, rad]."""


@dataclass(frozen=True)
class Matched:
    """A drive whose lidar was matched.

    Attributes:
        times, turned: the wheels' clock (n,) [s] and angles (n, 2) [rad].
        spans: when each match begins and ends, (m, 2) [s].
        motions: x, y [m], heading [rad] of the lidar, (m, 3).
        wrong: which matches went wrong, (m,).
    """

    times: np.ndarray
    turned: np.ndarray
    spans: np.ndarray
    motions: np.ndarray
    wrong: np.ndarray

    def write(self, folder: Path, name: str = "drive", **more: np.ndarray) -> list[Path]:
        """The wheels' log, and its matches beside it."""
        log, beside = folder / f"{name}.csv", folder / f"{name}_matches.csv"
        table = np.column_stack([self.times, self.turned])
        np.savetxt(log, table, "%.9g", ",", header="t,right,left", comments="")
        names = ",".join(["t0", "t1", "dx", "dy", "dtheta", *more])
        table = np.column_stack([self.spans, self.motions, *more.values()])
        np.savetxt(beside, table, "%.12g", ",", header=names, comments="")
        return [log]


LOG: dict[str, Any] = {
    "time": "t",
    "inputs": {
        "wheel_speed_right": {"column": "right", "form": "angle"},
        "wheel_speed_left": {"column": "left", "form": "angle"},
    },
    "relative_poses": {
        "file": "{stem}_matches.csv",
        "t0": "t0",
        "t1": "t1",
        "x": "dx",
        "y": "dy",
        "heading": "dtheta",
    },
}
"""The study's key `log` for what `write` writes."""


def seen(before: np.ndarray, after: np.ndarray, place: Sequence[float] = MOUNTED) -> np.ndarray:
    """How a sensor at `place` moved (m, 3) while its robot did from poses (m, 3) to others."""
    arm = place[0] + 1j * place[1]
    (first, heading), (last, later) = (
        (pose[:, 0] + 1j * pose[:, 1] + arm * np.exp(1j * pose[:, 2]), pose[:, 2]) for pose in (before, after)
    )
    moved = (last - first) * np.exp(-1j * (heading + place[2]))
    return np.column_stack([moved.real, moved.imag, later - heading])


def wheel_speeds(times: np.ndarray, seed: int, held: int = HELD) -> np.ndarray:
    """Turns in place both ways, straight lines, arcs: (n, 2) [rad/s], each for so many periods."""
    rng = np.random.default_rng([seed, 7])
    each = np.array([[1, -1], [-1, 1], [1, 1], [-1, -1], [1, 0.4], [0.4, 1], [1, -0.3]])
    chosen = rng.permutation(np.tile(each, (1 + len(times) // (7 * held), 1)))
    return 1.2 * np.repeat(chosen, held, axis=0)[: len(times)]


def matched(
    seed: int = 0,
    *,
    seconds: float = 120.0,
    period: float = 0.1,
    every: int = 8,
    held: int = HELD,
    noise: Callable[[np.ndarray], np.ndarray] | None = None,
    bad: float = 0.0,
    offset: float = 0.0,
    truth: dict[str, float] | None = None,
    place: Sequence[float] = MOUNTED,
) -> Matched:
    """A drive.

    Args:
        seed: of the drive and the errors.
        seconds: how long.
        period: of the wheels' log [s].
        every: of its readings a scan.
        held: periods that the wheels turn alike.
        noise: errors (m, 3) of standard normal numbers; independent ones of `NOISE` by default.
        bad: share of matches that go wrong.
        offset: what the wheels' clock shows when the lidar's shows 0 [s].
        truth: the robot's parameters.
        place: of the lidar.
    """
    rng = np.random.default_rng([seed, 3])
    times = period * np.arange(round(seconds / period) + 1)
    speeds = wheel_speeds(times[1:], seed, held)
    right, left, track = (truth or TRUTH).values()
    forward = (right * speeds[:, 0] + left * speeds[:, 1]) / 2
    turning = (right * speeds[:, 0] - left * speeds[:, 1]) / track
    twists = np.column_stack([forward, 0 * forward, turning])
    poses = arcs((0.0, 0.0, 0.3), twists, np.diff(times))
    scans = np.arange(0, len(times), every)
    motions = seen(poses[scans[:-1]], poses[scans[1:]], place)
    errors = rng.normal(size=motions.shape)
    motions += errors * [NOISE[0], NOISE[0], NOISE[1]] if noise is None else noise(errors)
    wrong = rng.random(len(motions)) < bad
    astray = rng.uniform(-1, 1, motions.shape) * [0.15, 0.15, 0.3]
    motions[wrong] += astray[wrong]
    turned = np.vstack([np.zeros(2), np.cumsum(speeds * period, axis=0)])
    spans = np.column_stack([times[scans[:-1]], times[scans[1:]]]) - offset
    return Matched(times, turned, spans, motions, wrong)
