"""Logs of a car with inertia, driven by SciPy: throttle and steering as they were held, and noisy poses."""

from __future__ import annotations

import cars
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import oed

PERIOD, COUNT = 0.05, 160
NOISE = (0.005, 0.005, 0.01)
STUDY = """
format: 1
name: Car
robot:
  kind: bicycle_dynamic
  drive_gain: 5 m/s^2
  viscous_drag: 1.3 1/s
  stiffness_front: 21 m/s^2/rad
  stiffness_rear: 31 m/s^2/rad
  front_axle: 16 cm
  rear_axle: 17 cm
  gyration_radius: 14 cm
measurement: {kind: poses, noise: {position: 5 mm, heading: 0.01 rad}}
estimate: [drive_gain, viscous_drag, stiffness_front, stiffness_rear, gyration_radius]
calibration: {method: joint, segment: log, sensor_place: [], noise: constant}
log:
  time: t
  inputs:
    throttle: {column: throttle}
    steering_angle: {column: steering_angle, held: next}
  poses: {x: x, y: y, heading: {column: heading, unit: rad}}
"""


def write_log(path) -> None:
    """A drive from rest, as it is logged at 20 Hz."""
    rng, times = np.random.default_rng(5), PERIOD * np.arange(COUNT + 1)
    throttle = 0.25 + 0.45 * np.sin(1.1 * times) + 0.15 * np.sin(2.3 * times)
    inputs = np.column_stack([throttle, 0.33 * np.sin(2.1 * times) + 0.1 * np.sin(3.7 * times)])
    states = [np.zeros(6)]
    for held in inputs[:-1]:
        given = {"rtol": 1e-7, "atol": 1e-9, "method": "LSODA", "args": (held,)}
        found = solve_ivp(
            lambda _, now, one: cars.slopes(now, one, cars.CAR), (0, PERIOD), states[-1], **given
        )
        states.append(found.y[:, -1])
    poses = np.array(states)[:, :3] + rng.normal(0, NOISE, (COUNT + 1, 3))
    table = np.column_stack([times, inputs, poses])
    header = "t,throttle,steering_angle,x,y,heading"
    np.savetxt(path, table, delimiter=",", header=header, comments="", fmt="%.8f")


@pytest.mark.slow
def test_parameters_are_found_from_throttle_and_steering(tmp_path):
    write_log(tmp_path / "drive.csv")
    (tmp_path / "study.yaml").write_text(STUDY)
    record = oed.estimate(oed.load_study(tmp_path / "study.yaml"), tmp_path / "drive.csv")
    found = {one.name: (one.value, one.standard_error) for one in record.parameters}
    assert set(found) == {name for name in cars.CAR if not name.endswith("axle")}
    for name, (value, deviation) in found.items():
        assert abs(value - cars.CAR[name]) < 3 * deviation
        assert abs(value / cars.CAR[name] - 1) < 0.05
