"""Physics of wheels on a floor: drives of robots that obey no kinematic model exactly.

    robot = physics_robot(model)                   # or FourWheels(friction=0.6), TwoWheelsAndCaster()
    motion = drive(robot, wheel_speeds, period)    # (N, 2) [rad/s], each held for `period` [s]
    log = Sensing(pose_rate=10).read(motion, rng)  # for `oed.calibration.calibrate`

It needs the package's extra `physics`.
"""

from oed.validation.physics.driving import Motion, drive
from oed.validation.physics.four_wheels import FourWheels
from oed.validation.physics.rendering import frames
from oed.validation.physics.robot import Motor, PhysicsRobot, Support, Suspension
from oed.validation.physics.sensing import Sensing
from oed.validation.physics.sizing import physics_robot
from oed.validation.physics.two_wheels import TwoWheelsAndCaster
from oed.validation.physics.variation import Variation

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
