"""Simulated drives as such: start, repeatability, symmetry, steps, and what breaks."""

from __future__ import annotations

import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from physics_drives import PERIOD, rich_drive, rich_speeds

from oed.foundation.errors import Failure, UserMistake
from oed.simulation.physics import FourWheels, Motion, PhysicsRobot, TwoWheelsAndCaster, drive
from oed.simulation.physics.engine import Engine

pytestmark = pytest.mark.slow

FOUR, TWO = FourWheels(), TwoWheelsAndCaster()
robots = pytest.mark.parametrize("robot", [FOUR, TWO], ids=lambda robot: robot.kind)


@cache
def from_origin(robot: PhysicsRobot) -> Motion:
    return drive(robot, rich_speeds(2), PERIOD)


@robots
def test_it_starts_at_rest_at_the_start_pose(robot: PhysicsRobot):
    motion = drive(robot, [(0, 0)] * 3, PERIOD, start=(1, 2, 3))
    assert motion.poses[0] == pytest.approx([1, 2, 3], abs=1e-12)
    assert motion.poses == pytest.approx(np.tile(motion.poses[0], (len(motion.poses), 1)), abs=1e-7)
    assert motion.wheel_angles == pytest.approx(np.zeros((len(motion.times), 2)), abs=1e-6)


def test_it_is_logged_at_the_rate_asked_for():
    motion = drive(TWO, rich_speeds(0.5), PERIOD, rate=30)
    assert motion.times[0] == 0
    assert motion.times[-1] == pytest.approx(0.5)
    assert np.diff(motion.times) == pytest.approx(1 / 30, abs=TWO.step)
    assert motion.wheel_angles.shape == (len(motion.times), 2)
    assert motion.poses.shape == (len(motion.times), 3)
    with pytest.raises(ValueError, match="read-only"):
        motion.poses[0] = 0


def test_commands_are_held_for_periods_that_steps_do_not_divide():
    motion = drive(TWO, [(2, 2)] * 7, 0.0337)
    assert motion.times[-1] == pytest.approx(7 * 0.0337)


def test_headings_run_on():
    motion = drive(FOUR, [(10, -10)] * 30, PERIOD, start=(0, 0, 3.1))
    assert motion.poses[-1, 2] > 3.1 + 2 * np.pi
    assert np.all(np.diff(motion.poses[:, 2]) >= 0)


@robots
def test_the_same_drive_twice_is_the_same(robot: PhysicsRobot):
    first, again = rich_drive(robot, 2.0), drive(robot, rich_speeds(2), PERIOD, start=(0.3, -0.2, 3.0))
    assert np.array_equal(again.poses, first.poses)
    assert np.array_equal(again.wheel_angles, first.wheel_angles)


@robots
def test_where_it_starts_does_not_matter(robot: PhysicsRobot):
    there, here = rich_drive(robot, 2.0), from_origin(robot)
    rotation = np.array([[np.cos(3), -np.sin(3)], [np.sin(3), np.cos(3)]])
    moved = here.poses[:, :2] @ rotation.T + (0.3, -0.2)
    assert there.poses == pytest.approx(np.column_stack([moved, here.poses[:, 2] + 3]), abs=1e-5)


@robots
def test_sides_exchanged_drive_the_mirror_image(robot: PhysicsRobot):
    one, other = from_origin(robot), drive(robot, rich_speeds(2)[:, ::-1], PERIOD)
    assert other.poses * (1, -1, -1) == pytest.approx(one.poses, abs=1e-5)
    assert other.wheel_angles[:, ::-1] == pytest.approx(one.wheel_angles, abs=1e-4)


@robots
def test_half_the_step_hardly_changes_where_it_ends(robot: PhysicsRobot):
    usual, finer = (rich_drive(robot.changed(step=step), 2.0) for step in (robot.step, robot.step / 2))
    assert usual.poses[-1, :2] == pytest.approx(finer.poses[-1, :2], abs=0.0004)
    assert usual.poses[-1, 2] == pytest.approx(finer.poses[-1, 2], abs=0.002)
    assert usual.wheel_angles[-1] == pytest.approx(finer.wheel_angles[-1], abs=0.005)


@robots
def test_errors_fall_with_the_step(robot: PhysicsRobot):
    steps = (0.001, 0.0005, 0.00025)
    coarse, usual, fine = (rich_drive(robot.changed(step=step), 2.0).poses[-1] for step in steps)
    assert np.linalg.norm(usual - fine) < 0.4 * np.linalg.norm(coarse - fine)


@pytest.mark.parametrize(
    ("speeds", "keys", "message"),
    [
        ([1, 2, 3], {}, r"of shape \(N, 2\), got \(3,\)"),
        ([[1, 2, 3]], {}, r"of shape \(N, 2\), got \(1, 3\)"),
        (np.zeros((0, 2)), {}, "of shape"),
        ([[1, np.nan]], {}, "finite"),
        ([[1, 2]], {"start": (0, 0)}, "a start pose x, y, heading"),
        ([[1, 2]], {"start": (0, 0, np.inf)}, "finite"),
        ([[1, 2]], {"period": 0}, "a positive period, got 0"),
        ([[1, 2]], {"rate": -1}, "a positive rate, got -1"),
    ],
)
def test_wrong_inputs_are_refused(speeds, keys, message: str):
    with pytest.raises(UserMistake, match=message):
        drive(FOUR, speeds, **{"period": PERIOD, **keys})


def test_a_robot_that_tips_over_says_so():
    tall = FourWheels(centre_of_mass_height=0.6)
    with pytest.raises(Failure, match=r"tipped over at 0\.\d+ s"):
        drive(tall, [(20, 20)] * 20 + [(-20, -20)] * 20, PERIOD)


def test_a_simulation_that_breaks_down_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    engine = Engine(FOUR)
    engine.data.qvel[0] = np.inf
    with pytest.raises(Failure, match=r"broke down at .* expected a step of less than 0\.0005 s"):
        engine.advance((1, 1), 10)
    assert not list(tmp_path.iterdir())


def test_springs_that_never_rest_say_so():
    bouncing = FourWheels(suspension={"stiffness": 1000, "damping": 1e-3})
    with pytest.raises(Failure, match="does not come to rest on its springs"):
        drive(bouncing, [(1, 1)], PERIOD)


def test_without_the_engine_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(UserMistake, match=r"pip install 'oed\[physics\]'"):
        drive(FOUR, [(1, 1)], PERIOD)
