"""What is measured. A new measurement is a file here and a name in `MEASUREMENTS`, a sensor in `SENSORS`."""

from oed.kernel.measurement.measurement import Block, Measurement, Nuisance, regression
from oed.kernel.measurement.sensor import Moment, Sensor
from oed.robots.sensors.displacements import Displacements, PoseNoise
from oed.robots.sensors.placed import LeverArm, PosePrior
from oed.robots.sensors.poses import AbsoluteNoise, Poses
from oed.robots.sensors.python_sensor import PythonSensor
from oed.robots.sensors.ranges import Ranges
from oed.robots.sensors.several import SENSORS, Several
from oed.robots.sensors.trailer_angle import TrailerAngle
from oed.robots.sensors.yaw_rate import YawRate

MEASUREMENTS: tuple[type[Measurement], ...] = (Displacements, *SENSORS, PythonSensor, Several)  # type: ignore[type-abstract]

__all__ = [
    "MEASUREMENTS",
    "SENSORS",
    "AbsoluteNoise",
    "Block",
    "Displacements",
    "LeverArm",
    "Measurement",
    "Moment",
    "Nuisance",
    "PoseNoise",
    "PosePrior",
    "Poses",
    "PythonSensor",
    "Ranges",
    "Sensor",
    "Several",
    "TrailerAngle",
    "YawRate",
    "regression",
]
