"""Sensors. A new one is a file here and a name in `MEASUREMENTS`."""

from oed.measurements.displacements import Displacements, PoseNoise
from oed.measurements.measurement import Block, Measurement

MEASUREMENTS: tuple[type[Measurement], ...] = (Displacements,)

__all__ = ["MEASUREMENTS", "Block", "Displacements", "Measurement", "PoseNoise"]
