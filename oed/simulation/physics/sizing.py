"""From a kinematic model, which knows wheel radii and track, to a robot with masses and springs."""

from __future__ import annotations

from typing import Any

from oed.foundation.component import Component
from oed.foundation.errors import UserMistake
from oed.robots.models.model import Model
from oed.robots.models.wheels import TwoSidedGeometry
from oed.simulation.physics.robot import FourWheels, Motor, PhysicsRobot, Suspension, TwoWheelsAndCaster

WHEELBASE_TO_TRACK = 16 / 18
"""Of the paper's robot; a Husky's is 0.92, a Jackal's 0.70."""
CASTER_TO_TRACK = -0.5
"""How far behind the axle a caster sits; a TurtleBot3 Burger's is at 0.51."""
WIDTH_TO_RADIUS = 0.6
"""Of a wheel; a Husky's is 0.69, a Jackal's 0.41, a TurtleBot3's 0.55."""
MASS_TO_TRACK = 2.5
"""Power of the track that the mass follows: from the paper's robot it gives a Husky's 50 kg, and
a Jackal's 17 kg within a seventh."""


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
