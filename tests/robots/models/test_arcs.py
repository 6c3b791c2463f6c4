"""Arcs between samples, against the steps of a robot that drives them."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from oed.kernel.dynamics.system import stepper
from oed.robots.models import DifferentialDrive, Mecanum, Model
from oed.robots.models.arcs import Integration, between, moves, signed_speeds

SHARES = np.array([0.0, 0.25, 0.5, 1.0])
ROBOTS = (
    (DifferentialDrive(wheel_radius=0.05, track=0.2), (9.0, -4.0)),
    (DifferentialDrive(wheel_radius=0.05, track=0.2), (3.0, 3.0)),
    (Mecanum(wheel_radius=0.05, half_wheelbase_plus_half_track=0.3), (9.0, 1.0, -2.0, 4.0)),
)


def driven(robot: Model, inputs: tuple[float, ...], period: float, rule: Integration = "arc") -> np.ndarray:
    """Where a robot is after a period [s]."""
    start = ca.DM([0.3, -0.2, 1.1])
    return np.array(stepper(robot.system(rule))(start, ca.DM(inputs), ca.DM(robot.nominal), period)).ravel()


@pytest.mark.parametrize(("robot", "inputs"), ROBOTS)
def test_between_two_samples_a_robot_is_where_shorter_steps_lead(robot: Model, inputs: tuple[float, ...]):
    first, last = driven(robot, inputs, 0.0), driven(robot, inputs, 1.2)
    expected = [driven(robot, inputs, share * 1.2) for share in SHARES]
    np.testing.assert_allclose(between(first, last, SHARES), expected, atol=1e-12)


def test_of_more_than_a_turn_only_the_ends_are_known():
    first, last = np.zeros(3), np.array([1.0, 0.0, 7.0])
    np.testing.assert_allclose(between(first, last, SHARES), SHARES[:, None] * last)


@pytest.mark.parametrize("rule", ["arc", "midpoint"])
@pytest.mark.parametrize(("robot", "inputs"), ROBOTS)
def test_speeds_and_ways_are_those_of_the_twist(robot: Model, inputs: tuple[float, ...], rule: Integration):
    poses = np.array([driven(robot, inputs, 0.0), driven(robot, inputs, 0.8, rule)])
    forward, lateral, yaw_rate = np.array(robot.twist(ca.DM(inputs), ca.DM(robot.nominal))).ravel()
    assert signed_speeds(poses, 0.8, rule, sideways=True) == pytest.approx(np.hypot(forward, lateral))
    shortened = np.sinc(0.8 * yaw_rate / (2 * np.pi)) if rule == "arc" else 1.0
    along, across = moves(poses)
    assert along == pytest.approx(0.8 * forward * shortened)
    assert across == pytest.approx(0.8 * lateral * shortened, abs=1e-12)
