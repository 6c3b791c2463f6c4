"""Robots that differ from run to run, as one robot does on another floor and with another load."""

from __future__ import annotations

from typing import Annotated, TypeVar

import numpy as np
from pydantic import Field

from oed.foundation.component import Component
from oed.foundation.quantities import Length, Ratio
from oed.simulation.physics.robot import PhysicsRobot

Robot = TypeVar("Robot", bound=PhysicsRobot)
Spread = Annotated[Ratio, Field(ge=0)]


class Variation(Component):
    """How much repeats of one robot differ: standard deviations, of logarithms where they are ratios.

    Attributes:
        friction: of the floor, alike for all wheels.
        grip: of each wheel's friction by itself.
        gain: of the motors.
        centre_of_mass: of its place ahead and to the left [m].
    """

    friction: Spread = 0.1
    grip: Spread = 0.05
    gain: Spread = 0.0
    centre_of_mass: Annotated[Length, Field(ge=0)] = 0.0

    def draw(self, robot: Robot, rng: np.random.Generator) -> Robot:
        """A robot around a nominal one; the same numbers are drawn whatever varies.

        Raises:
            ValueError: it would not stand, its centre of mass being beyond its wheels.
        """
        floor, motor, *wheels = rng.normal(size=2 + len(robot.wheels))
        ahead, left = rng.normal(size=2) * self.centre_of_mass
        nominal = robot.grips or (1.0,) * len(robot.wheels)
        return robot.changed(
            friction=robot.friction * np.exp(self.friction * floor),
            grips=tuple(
                grip * float(np.exp(self.grip * one)) for grip, one in zip(nominal, wheels, strict=True)
            ),
            motor=robot.motor.model_copy(
                update={
                    name: float(getattr(robot.motor, name) * np.exp(self.gain * motor))
                    for name in ("gain", "sum_gain")
                }
            ),
            centre_of_mass=(robot.centre_of_mass[0] + ahead, robot.centre_of_mass[1] + left),
        )
