"""Simulated drives that several tests look at, and what the theory of rigid wheels says of a spin."""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.optimize import fsolve

from oed.simulation.physics import Motion, PhysicsRobot, drive

PERIOD = 0.1


def rich_speeds(seconds: float, seed: int = 0) -> np.ndarray:
    """Smooth wheel speeds (N, 2) from rest, forwards, backwards and turning, mostly below 10 rad/s."""
    times = PERIOD * np.arange(round(seconds / PERIOD))
    rng = np.random.default_rng(seed)
    waves = rng.uniform(0.3, 1.5, (2, 3, 1)) * times + rng.uniform(0, 2 * np.pi, (2, 3, 1))
    return (2 + 2.2 * np.sin(waves).sum(axis=1)).T * np.minimum(times, 1)[:, None]


@cache
def rich_drive(robot: PhysicsRobot, seconds: float = 5.0, seed: int = 0) -> Motion:
    return drive(robot, rich_speeds(seconds, seed), PERIOD, start=(0.3, -0.2, 3.0))


@cache
def steady(robot: PhysicsRobot, right: float, left: float, seconds: float = 1.0) -> Motion:
    """The same speeds all the time, but for what it takes to get there."""
    return drive(robot, [(right, left)] * round(seconds / PERIOD), PERIOD)


def travelled(motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Wheel angles and poses gained in the second half, when the motion is steady."""
    half = len(motion.times) // 2
    return motion.wheel_angles[-1] - motion.wheel_angles[half], motion.poses[-1] - motion.poses[half]


def widening(robot: PhysicsRobot, speed: float = 5.0) -> float:
    """Effective over geometric track, in a spin on the spot."""
    turned, moved = travelled(steady(robot, speed, -speed))
    right, left = robot.radii
    return float((right * turned[0] - left * turned[1]) / moved[2] / robot.track)


def coulomb_widening(robot: PhysicsRobot) -> float:
    """The same of rigid wheels with dry friction that slide in a steady spin: all forces balance.

    With even loads it is 1 + (wheelbase^2 + width^2 / 3) / track^2, whatever the friction.
    """
    wheels = [(wheel, load) for wheel, load in zip(robot.supports, robot.loads, strict=True) if wheel.driven]

    def imbalance(unknown: np.ndarray) -> list[float]:
        rim, forward, lateral = unknown
        total = np.zeros(3)
        for wheel, load in wheels:
            along = forward - wheel.left - (rim if wheel.left < 0 else -rim)
            across, turning = lateral + wheel.ahead, wheel.scrub
            share = -wheel.friction * load / np.sqrt(along**2 + across**2 + turning**2)
            moment = wheel.ahead * across - wheel.left * along + turning**2
            total += share * np.array([along, across, moment])
        return list(total)

    half = robot.track / 2
    return float(fsolve(imbalance, [1.5 * half, 0.0, 0.0])[0] / half)
