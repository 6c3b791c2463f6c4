"""Robots that are driven by speed and yaw rate, from logs of their twins: gains, lags, odometry."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from bags import START, TYPES, header, pose, twist_message, write_bag
from pulls import require_pulls
from simulated import fit_of, unknowns_of
from studies import saved_study
from twin_drives import STEP, Twin, driven, pulls, tracked, waves, write_csv

from oed.estimation.assessment.covariance import information
from oed.logs import Log
from oed.robots.models.model import robot_of
from oed.workflow.estimate_logs import estimate
from oed.workflow.studies import parse_study

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
calibration: {segment: log, noise: constant, sensor_place: []}
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


def odometry_log(folder: Path, seed: int, seconds: float = 20.0) -> Path:
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
    record = estimate(saved_study(tmp_path, ODOMETRY), [odometry_log(tmp_path, seed) for seed in (0, 1)])
    assert max(map(abs, pulls(record, ODOMETRY_TRUTH).values())) < 3, record.values
    assert max(record.errors.values()) < 0.01
    assert [log.clock_offset for log in record.logs] == pytest.approx([0.08] * 2, abs=0.01)


LAGGING = """\
format: 1
name: Robot on commands that follows with a lag
robot: {kind: unicycle, lag_v: 100 ms, lag_omega: 200 ms}
trajectory: {duration: 60 s, samples: 60}
measurement: {kind: poses, noise: {position: 2 mm, heading: 0.3 deg}}
limits: {commanded_speed: 1 m/s, commanded_yaw_rate: 2 rad/s}
log: {kind: rosbag, commands: /cmd_vel, poses: /mocap}
calibration: {segment: log, noise: constant, sensor_place: []}
"""
LAGGING_TRUTH = {"gain_v": 0.957, "gain_omega": 0.884, "lag_v": 0.163, "lag_omega": 0.287}
COMMAND_RATE = 20.0


def lagging_twin(seed: int, seconds: float) -> Twin:
    """A robot from rest whose speed and yaw rate follow held commands as first-order lags."""
    rng = np.random.default_rng(seed)
    steps = rng.uniform(-1, 1, (2, round(seconds) + 2)) * [[0.4], [1.2]]

    def inputs(times: np.ndarray) -> np.ndarray:
        # Commands of a new size every second, sent anew at their rate.
        sent = np.floor(times * COMMAND_RATE + 1e-9) / COMMAND_RATE
        return steps[:, np.floor(sent + 1e-9).astype(int)].T

    def twists(rows: np.ndarray) -> np.ndarray:
        asked = rows * [LAGGING_TRUTH["gain_v"], LAGGING_TRUTH["gain_omega"]]
        left = np.exp(-STEP / np.array([LAGGING_TRUTH["lag_v"], LAGGING_TRUTH["lag_omega"]]))
        rates = np.zeros((len(rows) + 1, 2))
        for at, row in enumerate(asked):
            rates[at + 1] = row + (rates[at] - row) * left
        means = (rates[1:] + rates[:-1]) / 2
        return np.insert(means, 1, 0.0, axis=1)

    return driven(inputs, twists, seconds)


def lagging_bag(folder: Path, seed: int, seconds: float = 9.0) -> Path:
    """Twist commands without a header, recorded as they come; mocap at 50 Hz on a clock 60 ms behind."""
    twin, messages = lagging_twin(seed, seconds), []
    for row in twin.rows(COMMAND_RATE):
        sent = twist_message("geometry_msgs/msg/Twist", 0.0, *twin.inputs[row])
        messages.append(("/cmd_vel", START + twin.times[row], sent))
    seen = twin.rows(50, 0.3)
    make = TYPES["geometry_msgs/msg/PoseStamped"]
    for time, own in zip(twin.times[seen], tracked(twin, seen, seed, (0.002, np.radians(0.3))), strict=True):
        head = header(START + time - 0.06, "map")
        messages.append(("/mocap", START + time, make(header=head, pose=pose(own))))
    return write_bag(folder / str(seed), messages)


@pytest.mark.slow
def test_commands_in_a_bag_that_a_robot_follows_with_a_lag(tmp_path: Path):
    record = estimate(saved_study(tmp_path, LAGGING), [lagging_bag(tmp_path, seed) for seed in (0, 1)])
    assert max(map(abs, pulls(record, LAGGING_TRUTH).values())) < 3, record.values
    assert record.errors["gain_v"] < 0.01
    assert record.errors["lag_omega"] < 0.01


def small_log(seed: int, seconds: float = 6.0) -> Log:
    """What a short bag holds, on one clock: commands, and poses of a camera at 20 Hz."""
    twin = lagging_twin(seed, seconds)
    rows, seen = twin.rows(COMMAND_RATE), twin.rows(20, 0.2)
    poses = tracked(twin, seen, seed, (0.005, np.radians(1)))
    poses[:, 2] = np.unwrap(poses[:, 2])
    return Log(
        name=str(seed),
        file=f"{seed}.csv",
        input_times=twin.times[rows],
        integrals=twin.turned[rows],
        pose_times=twin.times[seen],
        poses=poses,
    )


@pytest.mark.slow
def test_intervals_of_short_logs_hold_the_truth():
    # That a robot may drift is allowed for elsewhere; this one does not.
    unknowns = unknowns_of(robot_of(parse_study(LAGGING).problem.system))
    fits = [fit_of([small_log(seed)], unknowns) for seed in range(20)]
    errors = np.array([fit.values for fit in fits]) - [LAGGING_TRUTH[name] for name in unknowns.names]
    require_pulls(errors, [information(fit).matrix for fit in fits])
