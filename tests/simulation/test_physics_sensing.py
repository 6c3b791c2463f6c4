"""Logs of simulated drives: rates, noise, encoders, and the geometry that a calibration finds in them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from builders import problem_of
from physics_drives import rich_drive

from oed.estimation import CalibrationOptions, calibrate
from oed.foundation.errors import PartError, UserMistake
from oed.logs.log import Log
from oed.robots.models import DifferentialDrive
from oed.robots.sensors import Poses
from oed.robots.sensors.poses import AbsoluteNoise
from oed.simulation.physics import FourWheels, Motion, Sensing, TwoWheelsAndCaster

pytestmark = pytest.mark.slow

NARROW = TwoWheelsAndCaster(wheel_width=0.002)
EXACT = AbsoluteNoise()


@pytest.fixture(scope="module")
def motion() -> Motion:
    return rich_drive(FourWheels())


def read(motion: Motion, seed: int = 0, **keys) -> Log:
    return Sensing(**keys).read(motion, np.random.default_rng(seed))


def errors(motion: Motion, log: Log) -> np.ndarray:
    true = [np.interp(log.pose_times, motion.times, column) for column in motion.poses.T]
    return log.poses - np.column_stack(true)


def test_poses_come_at_their_rate_and_encoders_at_the_motions(motion: Motion):
    log = read(motion, pose_rate="10 Hz", noise=EXACT)
    assert log.pose_times == pytest.approx(0.1 * np.arange(51), abs=1e-9)
    assert np.array_equal(log.input_times, motion.times)
    assert np.array_equal(log.integrals, motion.wheel_angles)
    assert errors(motion, log) == pytest.approx(np.zeros((51, 3)), abs=1e-12)
    assert log.quantities == ("x", "y", "heading")


def test_noise_has_the_size_it_is_said_to_have(motion: Motion):
    noise = AbsoluteNoise(position="2 mm", heading="1 deg")
    logs = [read(motion, seed, noise=noise, pose_rate=50) for seed in range(10)]
    deviations = np.std(np.concatenate([errors(motion, log) for log in logs]), axis=0)
    assert deviations == pytest.approx([0.002, 0.002, math.radians(1)], rel=0.1)


def test_noise_may_grow_with_speed(motion: Motion):
    noise = AbsoluteNoise(position_per_speed=0.05)
    logs = [read(motion, seed, noise=noise, pose_rate=50) for seed in range(10)]
    speeds = np.linalg.norm(np.gradient(motion.poses[:, :2], motion.times, axis=0), axis=1)
    scatter = np.std([errors(motion, log)[:, 0] for log in logs], axis=0)
    fast = speeds > 0.1
    assert np.median(scatter[fast] / speeds[fast]) == pytest.approx(0.05, rel=0.15)
    assert np.max(scatter[speeds < 0.01]) < 0.001


def test_noise_may_grow_with_the_yaw_rate(motion: Motion):
    noise = AbsoluteNoise(heading_per_yaw_rate=0.05)
    logs = [read(motion, seed, noise=noise, pose_rate=50) for seed in range(10)]
    rates = np.abs(np.gradient(motion.poses[:, 2], motion.times))
    scatter = np.std([errors(motion, log)[:, 2] for log in logs], axis=0)
    turning = rates > 0.3
    assert turning.sum() > 20
    assert np.median(scatter[turning] / rates[turning]) == pytest.approx(0.05, rel=0.15)
    assert np.max(scatter[rates < 0.01], initial=0.0) < 0.001


def test_noise_may_be_a_covariance(motion: Motion):
    matrix = ((4e-6, 3e-6, 0), (3e-6, 4e-6, 0), (0, 0, 1e-4))
    logs = [read(motion, seed, noise={"covariance": matrix}, pose_rate=50) for seed in range(10)]
    found = np.cov(np.concatenate([errors(motion, log) for log in logs]), rowvar=False)
    assert found == pytest.approx(np.array(matrix), abs=5e-6)
    with pytest.raises(PartError, match=r"covariance \(3, 3\) of one pose, got 2 rows"):
        Sensing(noise={"covariance": ((1, 0), (0, 1))})


def test_encoders_count_ticks(motion: Motion):
    log = read(motion, ticks_per_turn=500)
    tick = 2 * math.pi / 500
    counts = log.integrals / tick
    assert counts == pytest.approx(np.round(counts), abs=1e-9)
    assert log.integrals[0] == pytest.approx([0, 0])
    assert np.max(np.abs(log.integrals - motion.wheel_angles)) <= tick


def test_it_is_drawn_from_the_generator_alone(motion: Motion):
    one, other = (read(motion, 4, ticks_per_turn=100) for _ in range(2))
    assert np.array_equal(one.poses, other.poses)
    assert np.array_equal(one.integrals, other.integrals)


def test_poses_are_not_read_more_often_than_the_motion_was_logged(motion: Motion):
    with pytest.raises(UserMistake, match=r"logged at 200 Hz or more.* got one at 50 Hz"):
        read(motion, pose_rate=200)


def test_a_calibration_finds_the_geometry_of_two_wheels():
    sensing = Sensing(noise=AbsoluteNoise(position="1 mm", heading="0.1 deg"), ticks_per_turn=4096)
    rng = np.random.default_rng(0)
    logs = [sensing.read(rich_drive(NARROW, 6, seed), rng, f"drive {seed}") for seed in range(2)]
    model = DifferentialDrive(wheel_radius=0.05, track=0.2)
    measurement = Poses(noise=sensing.noise, initial_pose="unknown")
    problem = problem_of(model=model, measurement=measurement)
    found = calibrate(problem, logs, CalibrationOptions(sensor_place=(), clock_offset=False, segment=4.0))
    assert found.parameters == ("wheel_radius_right", "wheel_radius_left", "track")
    assert found.values == pytest.approx([0.049, 0.049, 0.18], rel=0.01)
    assert found.values[:2] == pytest.approx([0.049, 0.049], rel=0.003)
