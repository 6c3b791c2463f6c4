"""What is measured. A new measurement is a file here and a name in `MEASUREMENTS`, a sensor in `SENSORS`."""

from oed.measurements.displacements import Displacements, PoseNoise
from oed.measurements.measurement import Block, Measurement, Nuisance, regression
from oed.measurements.poses import AbsoluteNoise, Poses
from oed.measurements.ranges import Ranges
from oed.measurements.sensor import LeverArm, Moment, PosePrior, Sensor
from oed.measurements.several import SENSORS, Several
from oed.measurements.trailer_angle import TrailerAngle
from oed.measurements.yaw_rate import YawRate

MEASUREMENTS: tuple[type[Measurement], ...] = (Displacements, *SENSORS, Several)

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
    "Ranges",
    "Sensor",
    "Several",
    "TrailerAngle",
    "YawRate",
    "regression",
]
