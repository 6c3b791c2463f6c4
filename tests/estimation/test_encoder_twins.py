"""Encoders as robots have them, from the logs of their twins: what is estimated is what was true."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from studies import saved_study
from twin_drives import Twin, driven, pulls, tracked, waves, write_csv

from oed.workflow.estimate_logs import estimate

CAR = """\
format: 1
name: Car-sized tricycle
robot: {kind: tricycle, wheel_radius: 30 cm, wheelbase: 1.7 m, steering_gain: 1}
trajectory: {duration: 60 s, samples: 60}
measurement: {kind: poses, noise: {position: 1 cm, heading: 0.2 deg}}
limits: {wheel_speed: 6 rad/s, steering_angle: 50 deg}
log:
  time: {column: ms, unit: ms}
  inputs:
    wheel_speed: {column: rim, form: speed, unit: m/s, radius: 30 cm, held: between}
    steering_angle: {column: steering, form: ticks, ticks_per_turn: 4096, cumulative: true, wrap: 4096,
      zero: 4000, sign: -1}
  poses: {file: "{stem}_gnss.csv", time: t, x: x, y: y, heading: {column: yaw, unit: deg}}
calibration: {segment: log, noise: constant, sensor_place: []}
"""
CAR_TRUTH = {"wheel_radius": 0.3124, "wheelbase": 1.662, "steering_offset": 0.021, "steering_gain": 0.93}


def car_drive(seed: int, seconds: float) -> Twin:
    """The drive wheel of a tricycle is the one that steers."""

    def inputs(times: np.ndarray) -> np.ndarray:
        return np.column_stack([waves(times, seed, 1.5, 3.0), waves(times, seed + 99, 0.3)])

    def twists(rows: np.ndarray) -> np.ndarray:
        acting = CAR_TRUTH["steering_gain"] * rows[:, 1] + CAR_TRUTH["steering_offset"]
        rim = CAR_TRUTH["wheel_radius"] * rows[:, 0]
        return np.column_stack([rim * np.cos(acting), 0 * rim, rim * np.sin(acting) / CAR_TRUTH["wheelbase"]])

    return driven(inputs, twists, seconds)


def car_log(folder: Path, seed: int, seconds: float = 15.0) -> Path:
    """Speeds of the rim as the car's computer has them, by 30 cm; steering ticks that begin anew; GNSS."""
    twin = car_drive(seed, seconds)
    rows, seen = twin.rows(40), twin.rows(10, 0.1)
    ticks = np.mod(np.round(-twin.inputs[rows, 1] / (2 * np.pi) * 4096) + 4000, 4096)
    columns = {"ms": 1e3 * twin.times[rows], "rim": 0.3 * twin.inputs[rows, 0], "steering": ticks}
    poses = tracked(twin, seen, seed, (0.01, np.radians(0.2)))
    poses[:, 2] = np.degrees(poses[:, 2])
    table = dict(zip(("x", "y", "yaw"), poses.T, strict=True))
    write_csv(folder / f"{seed}_gnss.csv", {"t": twin.times[seen], **table})
    return write_csv(folder / f"{seed}.csv", columns)


@pytest.mark.slow
def test_a_car_whose_steering_encoder_wraps(tmp_path: Path):
    record = estimate(saved_study(tmp_path, CAR), [car_log(tmp_path, seed) for seed in (0, 1)])
    assert max(map(abs, pulls(record, CAR_TRUTH).values())) < 3, record.values
    assert record.errors["steering_gain"] < 0.01
    assert record.errors["wheelbase"] < 0.03


MECANUM = """\
format: 1
name: Mecanum robot with four unequal wheels
robot:
  kind: mecanum
  wheel_radius_front_left: 5 cm
  wheel_radius_front_right: 5 cm
  wheel_radius_rear_left: 5 cm
  wheel_radius_rear_right: 5 cm
  half_wheelbase_plus_half_track: 35 cm
trajectory: {duration: 60 s, samples: 60}
measurement: {kind: poses, noise: {position: 1 mm, heading: 0.1 deg}}
limits: {wheel_speed: 12 rad/s}
log:
  inputs:
    wheel_speed_front_left: {column: ticks, form: ticks, ticks_per_turn: 2048, gear: 12}
    wheel_speed_front_right:
      {column: counter, form: ticks, ticks_per_turn: 2048, gear: 12, cumulative: true, wrap: 65536}
    wheel_speed_rear_left: {column: rpm, form: speed, unit: rpm, held: between}
    wheel_speed_rear_right: {column: angle, form: angle, unit: deg, wrap: 360, sign: -1}
  poses: {heading: yaw}
calibration: {segment: log, noise: constant, sensor_place: []}
"""
MECANUM_TRUTH = {
    "wheel_radius_front_left": 0.0507,
    "wheel_radius_front_right": 0.0496,
    "wheel_radius_rear_left": 0.0489,
    "wheel_radius_rear_right": 0.0512,
    "half_wheelbase_plus_half_track": 0.366,
}


def mecanum_log(folder: Path, seed: int, seconds: float = 10.0) -> Path:
    """Every wheel by an encoder of its own sort, at 50 Hz; mocap in the same rows."""
    radii, arm = np.array(list(MECANUM_TRUTH.values())[:4]), MECANUM_TRUTH["half_wheelbase_plus_half_track"]
    # Rolling of each wheel by forward speed, lateral speed and yaw rate: rollers that form an X from above.
    rolling = np.array([[1, -1, -arm], [1, 1, arm], [1, 1, -arm], [1, -1, arm]])

    def inputs(times: np.ndarray) -> np.ndarray:
        sizes = enumerate((0.2, 0.2, 0.5))
        return np.column_stack([waves(times, 10 * seed + at, size) for at, size in sizes]) @ rolling.T / radii

    def twists(speeds: np.ndarray) -> np.ndarray:
        # The wheels agree: any of them that has no say would roll by as much.
        return np.linalg.lstsq(rolling, radii[:, None] * speeds.T, rcond=None)[0].T

    twin = driven(inputs, twists, seconds)
    rows = twin.rows(50)
    ticks = np.round(twin.turned[rows] / (2 * np.pi) * 2048 * 12)
    columns = {
        "t": twin.times[rows],
        "ticks": np.diff(ticks[:, 0], prepend=0.0),
        "counter": np.mod(ticks[:, 1] + 60_000, 65536),
        "rpm": twin.inputs[rows, 2] * 30 / np.pi,
        "angle": np.mod(-np.degrees(twin.turned[rows, 3]), 360),
        **dict(zip(("x", "y", "yaw"), tracked(twin, rows, seed, (0.001, np.radians(0.1))).T, strict=True)),
    }
    return write_csv(folder / f"{seed}.csv", columns)


@pytest.mark.slow
def test_a_mecanum_robot_of_four_unequal_wheels(tmp_path: Path):
    record = estimate(saved_study(tmp_path, MECANUM), [mecanum_log(tmp_path, 0)])
    assert max(map(abs, pulls(record, MECANUM_TRUTH).values())) < 3.5, record.values
    assert max(record.errors[name] for name in list(MECANUM_TRUTH)[:4]) < 0.0002
    assert all("counter_wrapped" in {one.name for one in log.findings} for log in record.logs)
