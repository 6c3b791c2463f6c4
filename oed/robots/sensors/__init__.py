"""What is measured. A new measurement is a file here and a name in `MEASUREMENTS`, a sensor in `SENSORS`."""

from oed.kernel.measurement.blocks import Block as Block
from oed.kernel.measurement.blocks import Nuisance as Nuisance
from oed.kernel.measurement.blocks import regression as regression
from oed.kernel.measurement.measurement import Measurement as Measurement
from oed.kernel.measurement.sensor import Moment as Moment
from oed.kernel.measurement.sensor import Sensor as Sensor
from oed.robots.own_parts import PythonSensor as PythonSensor
from oed.robots.sensors.biased import TrailerAngle as TrailerAngle
from oed.robots.sensors.biased import YawRate as YawRate
from oed.robots.sensors.displacements import Displacements as Displacements
from oed.robots.sensors.displacements import PoseNoise as PoseNoise
from oed.robots.sensors.drift import Drift as Drift
from oed.robots.sensors.landmarks import Landmarks as Landmarks
from oed.robots.sensors.landmarks import SightNoise as SightNoise
from oed.robots.sensors.landmarks import Tags as Tags
from oed.robots.sensors.mapped import Ranges as Ranges
from oed.robots.sensors.mounting import CameraArm as CameraArm
from oed.robots.sensors.mounting import LeverArm as LeverArm
from oed.robots.sensors.mounting import Mounting as Mounting
from oed.robots.sensors.pose_noise import Discrepancy as Discrepancy
from oed.robots.sensors.poses import AbsoluteNoise as AbsoluteNoise
from oed.robots.sensors.poses import Poses as Poses
from oed.robots.sensors.prior import PosePrior as PosePrior
from oed.robots.sensors.relative_poses import RelativePoses as RelativePoses
from oed.robots.sensors.several import SENSORS as SENSORS
from oed.robots.sensors.several import Several as Several

MEASUREMENTS: tuple[type[Measurement | Sensor], ...] = (Displacements, *SENSORS, PythonSensor, Several)
