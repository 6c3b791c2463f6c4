"""Robots. A new one is a file here and its import below, which lists it in `MODELS`."""

from oed.kernel.dynamics.system import Input as Input
from oed.kernel.dynamics.system import Parameter as Parameter
from oed.kernel.dynamics.system import follows_state as follows_state
from oed.robots.models.arcs import Integration as Integration
from oed.robots.models.arcs import chord as chord
from oed.robots.models.arcs import sinc as sinc
from oed.robots.models.bicycle_dynamic import BicycleDynamic as BicycleDynamic
from oed.robots.models.command_driven import COMMANDS as COMMANDS
from oed.robots.models.command_driven import Unicycle as Unicycle
from oed.robots.models.differential_drive import DifferentialDrive as DifferentialDrive
from oed.robots.models.differential_drive import OffsetDrive as OffsetDrive
from oed.robots.models.differential_drive import TractorTrailer as TractorTrailer
from oed.robots.models.model import Model as Model
from oed.robots.models.omnidirectional import Mecanum as Mecanum
from oed.robots.models.omnidirectional import OmniThree as OmniThree
from oed.robots.models.python_robot import PythonRobot as PythonRobot
from oed.robots.models.skid_steer import SkidSteer as SkidSteer
from oed.robots.models.skid_steer import SkidSteerIcr as SkidSteerIcr
from oed.robots.models.skid_steer_slip import SkidSteerSlip as SkidSteerSlip
from oed.robots.models.steered import Ackermann as Ackermann
from oed.robots.models.steered import Tricycle as Tricycle
from oed.robots.models.twists import moves_sideways as moves_sideways

MODELS: tuple[type[Model], ...] = tuple(
    found
    for _, found in sorted(globals().items())
    if isinstance(found, type) and issubclass(found, Model) and found is not Model
)
"""Every robot imported above: what a study's `robot: {kind: ...}` may name."""
