"""Robots that are driven by speed and yaw rate, from logs of their twins: gains, lags, odometry."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from studies import saved_study
from twins import Twin, driven, pulls, tracked, waves, write_csv

from oed.workflow.estimate_logs import estimate

ODOMETRY = """\
format: 1
name: Robot whose odometry exists only as poses
robot: {kind: unicycle, omega_per_v: 0}
trajectory: {duration: 60 s, samples: 60}
measurement: {kind: poses, noise: {position: 2 mm, heading: 0.3 deg}}
limits: {commanded_speed: 1 m/s, commanded_yaw_rate: 2 rad/s}
log:
  inputs: {form: poses, x: {column: odom_x, unit: cm}, y: {column: odom_y, unit: cm}, heading: odom_yaw}
  poses: {file: "{stem}_mocap.csv", time: t, x: x, y: y, heading: yaw}
"""
ODOMETRY_TRUTH = {"gain_v": 1.034, "gain_omega": 0.962, "omega_per_v": 0.021}


def odometry_twins(seed: int, seconds: float) -> tuple[Twin, Twin]:
    """What a robot's wheels make of wrong radii and a wrong track, from 0 on, and what it truly does."""

    def inputs(times: np.ndarray) -> np.ndarray:
        return np.column_stack([waves(times, seed, 0.2, 0.15), waves(times, seed + 50, 0.5)])

    def truly(rows: np.ndarray) -> np.ndarray:
        turns = ODOMETRY_TRUTH["gain_omega"] * rows[:, 1] + ODOMETRY_TRUTH["omega_per_v"] * rows[:, 0]
        return np.column_stack([ODOMETRY_TRUTH["gain_v"] * rows[:, 0], 0 * turns, turns])

    def summed_up(rows: np.ndarray) -> np.ndarray:
        return np.insert(rows, 1, 0.0, axis=1)

    return driven(inputs, summed_up, seconds, (0, 0, 0)), driven(inputs, truly, seconds)


def odometry_log(folder: Path, seed: int, seconds: float = 30.0) -> Path:
    """Odometry at 25 Hz to a tenth of a millimetre, in cm; mocap at 20 Hz from its own computer."""
    odometry, twin = odometry_twins(seed, seconds)
    rows, seen = twin.rows(25), twin.rows(20, 0.2)
    x, y, yaw = odometry.poses[rows].T
    poses = tracked(twin, seen, seed, (0.002, np.radians(0.3)))
    write_csv(
        folder / f"{seed}_mocap.csv",
        {"t": twin.times[seen] - 0.08, **dict(zip(("x", "y", "yaw"), poses.T, strict=True))},
    )
    logged = {
        "odom_x": np.round(100 * x, 2),
        "odom_y": np.round(100 * y, 2),
        "odom_yaw": np.angle(np.exp(1j * yaw)),
    }
    return write_csv(folder / f"{seed}.csv", {"t": twin.times[rows], **logged})


@pytest.mark.slow
def test_odometry_as_poses_against_a_tracker(tmp_path: Path):
    record = estimate(saved_study(tmp_path, ODOMETRY), [odometry_log(tmp_path, seed) for seed in (0, 1, 2)])
    assert max(map(abs, pulls(record, ODOMETRY_TRUTH).values())) < 3, record.values
    assert max(record.errors.values()) < 0.01
    assert [log.clock_offset for log in record.logs] == pytest.approx([0.08] * 3, abs=0.01)
