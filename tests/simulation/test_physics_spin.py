"""How a simulated robot turns and rolls, next to what theory says and what makers of robots publish."""

from __future__ import annotations

import numpy as np
import pytest
from physics_drives import coulomb_widening, steady, travelled, widening

from oed.robots.models import SkidSteer
from oed.simulation.physics import FourWheels, PhysicsRobot, TwoWheelsAndCaster, physics_robot

pytestmark = pytest.mark.slow

PAPER = FourWheels()
NARROW = TwoWheelsAndCaster(wheel_width=0.002)
robots = pytest.mark.parametrize("robot", [PAPER, NARROW], ids=lambda robot: robot.kind)


class TestASpinOfFourWheels:
    def test_theory_in_one_line(self):
        expected = 1 + (0.16**2 + 0.03**2 / 3) / 0.18**2
        assert coulomb_widening(PAPER) == pytest.approx(expected)
        assert expected == pytest.approx(1.799, abs=1e-3)

    @pytest.mark.parametrize("friction", [0.4, 1.2])
    def test_widens_the_track_as_dry_friction_does(self, friction: float):
        robot = FourWheels(friction=friction)
        assert widening(robot) == pytest.approx(coulomb_widening(robot), rel=1e-3)

    @pytest.mark.parametrize("speed", [1.0, 15.0])
    def test_whatever_its_speed(self, speed: float):
        assert widening(PAPER, speed) == pytest.approx(coulomb_widening(PAPER), rel=1e-3)

    @pytest.mark.parametrize("ahead", [-0.02, 0.01])
    def test_widens_less_with_uneven_loads(self, ahead: float):
        robot = FourWheels(centre_of_mass=(ahead, 0))
        # Slowly, for theory has no inertia: beside its centre of mass a spinning robot leans outwards.
        assert widening(robot, 1.0) == pytest.approx(coulomb_widening(robot), rel=2e-3)
        assert widening(robot) < widening(PAPER) - 0.05

    def test_depends_on_how_evenly_wheels_grip(self):
        robot = FourWheels(grips=(1, 0.6, 1, 0.6))
        assert widening(robot, 1.0) == pytest.approx(coulomb_widening(robot), rel=2e-3)
        assert widening(robot) < widening(PAPER) - 0.2

    def test_does_not_hold_the_wheels_back(self):
        motion = steady(PAPER, 5, -5)
        speeds = (motion.wheel_angles[-1] - motion.wheel_angles[-10]) / (motion.times[-1] - motion.times[-10])
        assert speeds == pytest.approx([5, -5], rel=1e-4)

    def test_does_not_depend_on_the_step(self):
        coarse, fine = (widening(FourWheels(step=step)) for step in (0.001, 0.00025))
        assert coarse == pytest.approx(fine, rel=1e-6)

    @pytest.mark.parametrize(
        ("radius", "track", "wheelbase", "width", "mass", "published"),
        [
            # husky/husky and clearpathrobotics/clearpath_common: husky.urdf.xacro, a200/control.yaml.
            pytest.param(0.1651, 0.555, 0.512, 0.1143, 50, 1.875, id="husky"),
            # jackal/jackal: jackal.urdf.xacro, control.yaml.
            pytest.param(0.098, 0.37559, 0.262, 0.04, 17, 1.5, id="jackal"),
        ],
    )
    def test_agrees_with_published_wheel_separation_multipliers(
        self, radius: float, track: float, wheelbase: float, width: float, mass: float, published: float
    ):
        model = SkidSteer(wheel_radius=radius, track=track)
        robot = physics_robot(model, wheelbase=wheelbase, mass=mass, wheel_width=width)
        assert widening(robot) == pytest.approx(published, rel=0.01)


class TestASpinOfTwoWheels:
    def test_is_about_the_geometric_track(self):
        assert widening(NARROW) == pytest.approx(1, abs=2e-3)

    def test_is_wider_for_wide_wheels(self):
        robot = TwoWheelsAndCaster(wheel_width=0.03)
        assert widening(robot) == pytest.approx(1 + 0.03**2 / 3 / 0.18**2, abs=2e-3)


@robots
def test_wheels_roll_on_their_radius(robot: PhysicsRobot):
    turned, moved = travelled(steady(robot, 8, 8, 3.0))
    assert moved[0] / turned.mean() == pytest.approx(0.049, rel=1e-4)
    assert moved[1:] == pytest.approx([0, 0], abs=1e-6)


def test_each_side_rolls_on_its_own_radius():
    robot = NARROW.changed(wheel_radius=None, wheel_radius_right=0.05, wheel_radius_left=0.048)
    turned, moved = travelled(steady(robot, 4.8, 5.0))
    assert moved[2] == pytest.approx((0.05 * turned[0] - 0.048 * turned[1]) / 0.18, abs=1e-4)


@robots
def test_wheels_follow_the_command_and_the_robot_its_wheels(robot: PhysicsRobot):
    motion = steady(robot, 5, -5)
    rates = np.diff(motion.poses[:, 2]) / np.diff(motion.times)
    wheels = np.diff(motion.wheel_angles, axis=0) / np.diff(motion.times)[:, None]
    # The controllers' memory takes gain / sum_gain = 0.1 s to forget the start.
    late = motion.times[1:] > 0.4
    assert wheels[late] == pytest.approx(np.array([[5, -5]] * late.sum()), abs=0.02)
    assert rates[late] == pytest.approx(rates[-1], rel=0.01)
