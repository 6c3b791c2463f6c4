"""Robots. A new one is a file here and a name in `MODELS`."""

from oed.models.ackermann import Ackermann
from oed.models.differential_drive import DifferentialDrive
from oed.models.differential_drive_with_offset import DifferentialDriveWithOffset
from oed.models.mecanum import Mecanum
from oed.models.model import Input, Integration, Model, Parameter, chord, sinc, step
from oed.models.omni_three import OmniThree
from oed.models.skid_steer import SkidSteer
from oed.models.skid_steer_icr import SkidSteerIcr
from oed.models.tractor_trailer import TractorTrailer
from oed.models.tricycle import Tricycle

MODELS: tuple[type[Model], ...] = (
    DifferentialDrive,
    DifferentialDriveWithOffset,
    SkidSteer,
    SkidSteerIcr,
    Tricycle,
    Ackermann,
    Mecanum,
    OmniThree,
    TractorTrailer,
)

__all__ = [
    "MODELS",
    "Ackermann",
    "DifferentialDrive",
    "DifferentialDriveWithOffset",
    "Input",
    "Integration",
    "Mecanum",
    "Model",
    "OmniThree",
    "Parameter",
    "SkidSteer",
    "SkidSteerIcr",
    "TractorTrailer",
    "Tricycle",
    "chord",
    "sinc",
    "step",
]
