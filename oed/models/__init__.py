"""Robots. A new one is a file here and a name in `MODELS`."""

from oed.models.differential_drive import DifferentialDrive
from oed.models.model import Input, Integration, Model, Parameter, chord, sinc, step
from oed.models.skid_steer import SkidSteer

MODELS: tuple[type[Model], ...] = (DifferentialDrive, SkidSteer)

__all__ = [
    "MODELS",
    "DifferentialDrive",
    "Input",
    "Integration",
    "Model",
    "Parameter",
    "SkidSteer",
    "chord",
    "sinc",
    "step",
]
