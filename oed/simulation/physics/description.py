"""A robot on a plane floor in the simulator's own language, MJCF."""

from __future__ import annotations

from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np
import numpy.typing as npt

from oed.foundation.arrays import Array
from oed.simulation.physics.robot import GRAVITY, WHEEL_SHARE, PhysicsRobot, Support

Value = str | int | float | npt.ArrayLike

FRICTION_RATIO = 1000.0
"""How much firmer contacts hold sideways than upwards: below friction's limit wheels hardly creep."""
LEAST_FRICTION = 1e-5
"""Coefficient that none goes below: the simulator takes no contacts without friction."""
FAR = 1e6
"""Beyond all wheel angles [rad]."""
SLIDING_ONLY, SLIDING_AND_TURNING = 3, 4
"""The simulator's `condim`."""

FLOOR, ROBOT, CAMERA = "floor", "robot", "chase"


def describe(robot: PhysicsRobot) -> str:
    """The MJCF of a robot that stands on a plane floor.

    Wheels touch the floor in one point, as balls do: where they touch then does not jump as the robot
    pitches and rolls on its springs. Their width acts by friction about the upright axis.
    """
    root = Element("mujoco", model=robot.kind)
    _options(root, robot)
    _floor_colours(root)
    world = _add(root, "worldbody")
    _geom(world, FLOOR, "plane", (0, 0, 0.05), material="floor")
    body = _chassis(world, robot)
    contact, actuator = _add(root, "contact"), _add(root, "actuator")
    for support, load in zip(robot.supports, robot.loads, strict=True):
        _support(body, robot, support, float(load))
        _contact(contact, support)
    for wheel in robot.wheels:
        _add(actuator, "velocity", joint=wheel.name, kv=robot.motor.gain)
    for wheel in robot.wheels:
        # A spring to where the wheel should be by now: the sum of the speed's errors.
        _add(actuator, "intvelocity", joint=wheel.name, kp=robot.motor.sum_gain, actrange=(-FAR, FAR))
    return tostring(root, encoding="unicode")


def _options(root: Element, robot: PhysicsRobot) -> None:
    option = _add(
        root,
        "option",
        timestep=robot.step,
        gravity=(0, 0, -GRAVITY),
        integrator="implicitfast",
        cone="elliptic",
        impratio=FRICTION_RATIO,
        tolerance=1e-10,
        # A wheel's contact moves few of all joints.
        jacobian="sparse",
    )
    # A state that is not finite is reported, not started anew. One robot is one island: none is looked for.
    _add(option, "flag", autoreset="disable", island="disable")


def _floor_colours(root: Element) -> None:
    asset = _add(root, "asset")
    light, dark = (0.85, 0.85, 0.85), (0.7, 0.7, 0.72)
    size = {"width": 64, "height": 64}
    _add(asset, "texture", name="floor", type="2d", builtin="checker", rgb1=light, rgb2=dark, **size)
    _add(asset, "material", name="floor", texture="floor", texuniform="true", texrepeat=(5, 5))


def _chassis(world: Element, robot: PhysicsRobot) -> Element:
    body = _add(world, "body", name=ROBOT, pos=(0, 0, robot.height))
    _add(body, "freejoint", name=ROBOT)
    size, mass = _size(robot), _chassis_mass(robot)
    squares = size**2
    inertia = mass / 12 * (squares.sum() - squares)
    _add(body, "inertial", pos=_chassis_centre(robot), mass=mass, diaginertia=inertia)
    middle = float(np.mean([support.ahead for support in robot.supports]))
    _geom(body, "chassis", "box", size / 2 * (1, 0.8, 0.5), pos=(middle, 0, size[2] / 4))
    # Light and camera move along without turning; it looks forward from behind and above.
    far = 3 * float(max(size))
    _add(body, "light", mode="track", pos=(0, 0, 2 * far), dir=(0, 0, -1))
    place, axes = (-far, 0, 0.6 * far), (0, -1, 0, 0.5, 0, 0.87)
    _add(body, "camera", name=CAMERA, mode="track", pos=place, xyaxes=axes)
    return body


def _size(robot: PhysicsRobot) -> Array:
    # Of the box that stands for everything but the wheels: length, width, height.
    places = [support.ahead for support in robot.supports]
    return np.array([max(places) - min(places) + robot.height, robot.track, 2 * robot.height])


def _chassis_mass(robot: PhysicsRobot) -> float:
    return robot.mass * (1 - WHEEL_SHARE * len(robot.supports))


def _chassis_centre(robot: PhysicsRobot) -> Array:
    # Where the rest's centre has to be for all together to have theirs where it is said to be.
    height = robot.height if robot.centre_of_mass_height is None else robot.centre_of_mass_height
    whole = np.array([*robot.centre_of_mass, height - robot.height])
    wheels = np.sum([_place(robot, support) for support in robot.supports], axis=0)
    return np.asarray((whole - WHEEL_SHARE * wheels) * (robot.mass / _chassis_mass(robot)))


def _place(robot: PhysicsRobot, support: Support) -> Array:
    return np.array([support.ahead, support.left, support.radius - robot.height])


def _support(body: Element, robot: PhysicsRobot, support: Support, load: float) -> None:
    name, mass, spring = support.name, WHEEL_SHARE * robot.mass, robot.suspension
    wheel = _add(body, "body", name=name, pos=_place(robot, support))
    # Springs are wound so far that the robot stands level.
    wound = (mass * GRAVITY - load) / spring.stiffness
    springs = {"stiffness": spring.stiffness, "damping": spring.damping, "springref": wound}
    _add(wheel, "joint", name=f"{name}_spring", type="slide", axis=(0, 0, 1), **springs)
    if support.driven:
        motor = robot.motor
        hinge = _add(wheel, "joint", name=name, type="hinge", axis=(0, 1, 0), armature=motor.inertia)
        hinge.set("actuatorfrcrange", _written((-motor.torque, motor.torque)))
    inertia = mass * support.radius**2 * np.array([0.25, 0.5, 0.25])
    _add(wheel, "inertial", pos=(0, 0, 0), mass=mass, diaginertia=inertia)
    # A wheel's radius is what it rolls on: the middle of what its contact gives way.
    _geom(wheel, name, "sphere", support.radius + load / robot.contact_stiffness / 2, group=3)
    if support.driven:
        _tread(wheel, robot, support)


def _tread(wheel: Element, robot: PhysicsRobot, support: Support) -> None:
    # To be seen only; a spoke shows that it turns.
    name, radius, width = support.name, support.radius, robot.wheel_width
    black, orange = (0.2, 0.2, 0.2, 1), (0.9, 0.6, 0.1, 1)
    _geom(wheel, f"{name}_tread", "cylinder", (radius, width / 2), zaxis=(0, 1, 0), rgba=black)
    _geom(wheel, f"{name}_spoke", "box", (0.9 * radius, 0.51 * width, 0.1 * radius), rgba=orange)


def _contact(contact: Element, support: Support) -> None:
    turning = support.friction * support.scrub
    sliding = max(support.friction, LEAST_FRICTION)
    _add(
        contact,
        "pair",
        name=support.name,
        geom1=FLOOR,
        geom2=support.name,
        condim=SLIDING_AND_TURNING if turning > LEAST_FRICTION else SLIDING_ONLY,
        friction=(sliding, sliding, max(turning, LEAST_FRICTION), 0, 0),
    )


def _geom(parent: Element, name: str, kind: str, size: npt.ArrayLike, **more: Value) -> None:
    # Nothing touches but the pairs that are listed.
    _add(parent, "geom", name=name, type=kind, size=size, contype=0, conaffinity=0, **more)


def _add(parent: Element, tag: str, **attributes: Value) -> Element:
    written = {key: _written(value) for key, value in attributes.items()}
    return SubElement(parent, tag, written)


def _written(value: Value) -> str:
    if isinstance(value, str):
        return value
    return " ".join(f"{number:.17g}" for number in np.atleast_1d(np.asarray(value, dtype=float)))
