"""What a physics simulator has to know of a robot: sizes, masses, springs, motors and friction.

Of four wheels, or of two and a caster; by a kinematic model; and how much robots differ from run to run.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from math import sqrt
from typing import Annotated, Any, Literal, Self, TypeVar

import numpy as np
from pydantic import Field, model_validator

from oed.foundation.arrays import Array
from oed.foundation.component import Component
from oed.foundation.errors import UserMistake
from oed.foundation.quantities import Duration, Length, Ratio, Unit
from oed.robots.models.model import Model
from oed.robots.models.wheels import PositiveLength, TwoSidedGeometry

Mass = Annotated[float, Unit("kg", "3 kg"), Field(gt=0)]
PositiveRatio = Annotated[Ratio, Field(gt=0)]
Spread = Annotated[Ratio, Field(ge=0)]
Robot = TypeVar("Robot", bound="PhysicsRobot")

GRAVITY = 9.81
"""[m/s^2]."""
WHEEL_SHARE = 0.05
"""Mass of a wheel, or of a caster, relative to the robot's."""
STIFFER = 50.0
"""Stiffness of a wheel's contact with the floor relative to its suspension's."""
LEAST_LOAD = 0.02
"""Share of the weight that everything which touches the ground has to carry for the robot to stand."""
WHEELBASE_TO_TRACK = 16 / 18
"""Of the paper's robot; a Husky's is 0.92, a Jackal's 0.70."""
CASTER_TO_TRACK = -0.5
"""How far behind the axle a caster sits; a TurtleBot3 Burger's is at 0.51."""
WIDTH_TO_RADIUS = 0.6
"""Of a wheel; a Husky's is 0.69, a Jackal's 0.41, a TurtleBot3's 0.55."""
MASS_TO_TRACK = 2.5
"""Power of the track that the mass follows: from the paper's robot it gives a Husky's 50 kg, and
a Jackal's 17 kg within a seventh."""


class Suspension(Component):
    """One wheel's spring and damper, upright. Rigid wheels on a rigid floor would chatter.

    Attributes:
        stiffness: [N/m].
        damping: [N s/m].
    """

    stiffness: Annotated[float, Field(gt=0)] = 1000.0
    damping: Annotated[float, Field(gt=0)] = 40.0


class Motor(Component):
    """One wheel's motor with its gear, and a controller of its speed by the error and the error's sum (PI).

    What a wheel has to push slows it down by torque / gain at first; within gain / sum_gain the sum makes up
    for it.

    Attributes:
        gain: torque per error of the speed [N m s/rad].
        sum_gain: torque per error of the angle, [N m/rad]; at 0 a wheel under load stays behind.
        torque: largest [N m].
        inertia: of the rotor and the gear as the wheel feels it [kg m^2].
    """

    gain: Annotated[float, Field(gt=0)] = 1.0
    sum_gain: Annotated[float, Field(ge=0)] = 10.0
    torque: Annotated[float, Field(gt=0)] = 1.0
    inertia: Annotated[float, Field(gt=0)] = 0.001


@dataclass(frozen=True)
class Support:
    """A wheel or a caster.

    Attributes:
        name: e.g. "front_right".
        ahead, left: place, relative to the robot's origin [m].
        radius: [m].
        friction: coefficient of sliding friction.
        scrub: radius at which friction resists turning about the upright axis [m].
        driven: whether a motor turns it.
    """

    name: str
    ahead: float
    left: float
    radius: float
    friction: float
    scrub: float = 0.0
    driven: bool = True


class PhysicsRobot(TwoSidedGeometry, ABC):
    """A robot with a right and a left side as a physics simulator sees it; of the paper's size by default.

    Its origin is the middle of its driven wheels.

    Attributes:
        wheel_width: of the part that touches the ground [m].
        mass: of all together [kg].
        friction: coefficient of sliding friction between wheels and floor.
        grips: factors of it, wheel by wheel in the order of `wheels`; () for all 1.
        centre_of_mass: ahead of the origin, and to the left [m].
        centre_of_mass_height: above the floor [m]; that of the wheels' centres if None.
        suspension, motor: of each wheel.
        step: of the simulation [s].
    """

    kind: str
    track: PositiveLength = 0.18
    wheel_width: PositiveLength = 0.03
    mass: Mass = 3.0
    friction: PositiveRatio = 0.8
    grips: tuple[PositiveRatio, ...] = ()
    centre_of_mass: tuple[Length, Length] = (0.0, 0.0)
    centre_of_mass_height: PositiveLength | None = None
    suspension: Suspension = Suspension()
    motor: Motor = Motor()
    step: Annotated[Duration, Field(gt=0, le=0.001)] = 0.0005

    @property
    @abstractmethod
    def supports(self) -> tuple[Support, ...]:
        """What stands on the floor, driven wheels first."""

    @model_validator(mode="before")
    @classmethod
    def _of_the_papers_size(cls, given: Any) -> Any:
        radii = ("wheel_radius", "wheel_radius_right", "wheel_radius_left")
        if isinstance(given, Mapping) and all(given.get(name) is None for name in radii):
            return {**given, "wheel_radius": 0.049}
        return given

    @model_validator(mode="after")
    def _can_be_stepped(self) -> Self:
        # Beyond these a wheel hops, or its motor hunts, faster than steps can follow.
        hop = sqrt(self.contact_stiffness / (WHEEL_SHARE * self.mass))
        motor = self.motor.gain / self.motor.inertia
        longest = min(1 / hop, 2 / motor)
        if self.step > longest:
            raise ValueError(
                f"expected a step of at most {longest:.2g} s for wheels so stiffly sprung and motors so "
                f"quick, got {self.step:g} s"
            )
        return self

    @model_validator(mode="after")
    def _stands(self) -> Self:
        if self.grips and len(self.grips) != len(self.wheels):
            names = ", ".join(wheel.name for wheel in self.wheels)
            raise ValueError(
                f"expected as many grips as driven wheels ({names}), or none, got {len(self.grips)}"
            )
        shares = self.loads / (self.mass * GRAVITY)
        expected = f"expected a centre of mass between the wheels, got {self.centre_of_mass}"
        if not np.allclose(self._places @ shares, [1, *self.centre_of_mass], atol=1e-9):
            raise ValueError(f"{expected}: the robot would fall over")
        if np.min(shares) < LEAST_LOAD:
            idle = self.supports[int(np.argmin(shares))].name
            raise ValueError(f"{expected}: nothing would stand on {idle}")
        return self

    @property
    def wheels(self) -> tuple[Support, ...]:
        """The driven ones of the supports."""
        return tuple(support for support in self.supports if support.driven)

    @property
    def contact_stiffness(self) -> float:
        """Of one wheel on the floor [N/m]."""
        return STIFFER * self.suspension.stiffness

    @property
    def height(self) -> float:
        """Of the origin above the floor: the wheels' mean radius [m]."""
        return sum(self.radii) / 2

    @property
    def loads(self) -> Array:
        """What each support carries at rest, (supports,) [N], with equal springs."""
        # Four springs are one more than statics tells apart: equal ones share with least squares.
        shares = np.linalg.pinv(self._places) @ np.array([1.0, *self.centre_of_mass])
        return np.asarray(self.mass * GRAVITY * shares)

    @property
    def _places(self) -> Array:
        # Loads times these are the weight and its moments, (3, supports).
        return np.array([[1.0, support.ahead, support.left] for support in self.supports]).T

    def changed(self, **values: Any) -> Self:
        """This robot with other values of some fields, checked.

        Raises:
            ValueError: no such field, or a value that the robot cannot have.
        """
        return type(self).model_validate({**self.model_dump(exclude_none=True), **values})

    def wheel(self, name: str, ahead: float, left: float, place: int) -> Support:
        """A driven wheel, the `place`-th of the robot, that stands `left` of the middle [m].

        Args:
            name: of the wheel.
            ahead: of the origin [m].
            left: of the middle [m].
            place: of the wheel among all.
        """
        grip = self.grips[place] if place < len(self.grips) else 1.0
        # A wide wheel that slides resists turning as if at the root mean square of its rows' places.
        scrub = self.wheel_width / sqrt(12)
        radius = self.radii[0] if left < 0 else self.radii[1]
        return Support(name, ahead, left, radius, grip * self.friction, scrub)


class FourWheels(PhysicsRobot):
    """Four driven wheels, the two of a side at the same commanded speed; a motor for each.

    Attributes:
        wheelbase: distance of front and rear axles [m].
    """

    kind: Literal["four_wheels"] = "four_wheels"
    wheelbase: PositiveLength = 0.16

    @property
    def supports(self) -> tuple[Support, ...]:
        """Front right, rear right, front left, rear left."""
        ahead, left = self.wheelbase / 2, self.track / 2
        return (
            self.wheel("front_right", ahead, -left, 0),
            self.wheel("rear_right", -ahead, -left, 1),
            self.wheel("front_left", ahead, left, 2),
            self.wheel("rear_left", -ahead, left, 3),
        )


class TwoWheelsAndCaster(PhysicsRobot):
    """Two driven wheels on one axle and a ball that slides on the floor with little friction.

    Attributes:
        caster: how far ahead of the axle the ball sits; negative behind it [m].
        caster_friction: its coefficient of sliding friction.
    """

    kind: Literal["two_wheels_and_caster"] = "two_wheels_and_caster"
    centre_of_mass: tuple[Length, Length] = (-0.02, 0.0)
    caster: Length = -0.09
    caster_friction: Annotated[Ratio, Field(ge=0)] = 0.01

    @property
    def supports(self) -> tuple[Support, ...]:
        """Right, left, caster."""
        left, ball = self.track / 2, min(self.radii) / 2
        return (
            self.wheel("right", 0.0, -left, 0),
            self.wheel("left", 0.0, left, 1),
            Support("caster", self.caster, 0.0, ball, self.caster_friction, driven=False),
        )


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


def physics_robot(
    model: Model, *, wheelbase: float | None = None, mass: float | None = None, **fields: Any
) -> PhysicsRobot:
    """The physics of a robot with a model's wheel radii and track.

    A robot that skids gets four wheels; any other with wheel radii and a track two, and a caster half a track
    behind, a quarter of the way to which the centre of mass lies. What is not given is the paper's robot's,
    scaled: the mass with the track, springs and motors so that everything happens in the same time.

    Args:
        model: with wheel radii and a track.
        wheelbase: of four wheels [m]; 8/9 of the track by default.
        mass: [kg]; (track / 18 cm)^2.5 times 3 kg by default.
        fields: other fields of the robot, as they are in files.

    Raises:
        UserMistake: the model has no wheel radii and track, or a wheelbase is given for two wheels.
        ValueError: a field that the robot does not have.
    """
    sides: Component = model
    if not isinstance(sides, TwoSidedGeometry):
        text = "expected a robot with wheel radii and a track, such as skid_steer or differential_drive"
        raise UserMistake(f"{text}, got {model.kind}")
    right, left = sides.radii
    known = {"wheel_radius_right": right, "wheel_radius_left": left, "track": sides.track}
    known |= _scaled(sides, mass)
    if model.skids:
        base = WHEELBASE_TO_TRACK * sides.track if wheelbase is None else wheelbase
        return FourWheels.model_validate({**known, "wheelbase": base, **fields})
    if wheelbase is not None:
        raise UserMistake(
            f"expected no wheelbase of a {model.kind}, which has two wheels, got {wheelbase:g} m"
        )
    caster = CASTER_TO_TRACK * sides.track
    placed = {"caster": caster, "centre_of_mass": (caster / 4, 0.0)}
    return TwoWheelsAndCaster.model_validate({**known, **placed, **fields})


def _scaled(model: TwoSidedGeometry, mass: float | None) -> dict[str, Any]:
    paper, radius = FourWheels(), sum(model.radii) / 2
    weight = paper.mass * (model.track / paper.track) ** MASS_TO_TRACK if mass is None else mass
    heavier, larger = weight / paper.mass, radius / paper.height
    spring, motor = Suspension(), Motor()
    return {
        "mass": weight,
        "wheel_width": WIDTH_TO_RADIUS * radius,
        "suspension": {
            "stiffness": heavier * spring.stiffness,
            "damping": heavier * spring.damping,
        },
        "motor": {
            "gain": heavier * larger**2 * motor.gain,
            "sum_gain": heavier * larger**2 * motor.sum_gain,
            "torque": heavier * larger * motor.torque,
            "inertia": heavier * larger**2 * motor.inertia,
        },
    }
