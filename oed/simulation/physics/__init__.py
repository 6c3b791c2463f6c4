"""Physics of wheels on a floor: drives of robots that obey no kinematic model exactly.

    robot = physics_robot(model)                   # or FourWheels(friction=0.6), TwoWheelsAndCaster()
    motion = drive(robot, wheel_speeds, period)    # (N, 2) [rad/s], each held for `period` [s]
    log = Sensing(pose_rate=10).read(motion, rng)  # for `oed.estimation.calibrate`

It needs the package's extra `physics`.
"""

from oed.simulation.physics.driving import Motion, drive, frames
from oed.simulation.physics.robot import (
    FourWheels,
    Motor,
    PhysicsRobot,
    Support,
    Suspension,
    TwoWheelsAndCaster,
    Variation,
    physics_robot,
)
from oed.simulation.physics.sensing import Sensing

PHYSICS_ROBOTS: tuple[type[PhysicsRobot], ...] = (FourWheels, TwoWheelsAndCaster)
"""What `kind` may name: for `Annotated[PhysicsRobot, OneOf(PHYSICS_ROBOTS)]`."""

__all__ = [
    "PHYSICS_ROBOTS",
    "FourWheels",
    "Motion",
    "Motor",
    "PhysicsRobot",
    "Sensing",
    "Support",
    "Suspension",
    "TwoWheelsAndCaster",
    "Variation",
    "drive",
    "frames",
    "physics_robot",
]
