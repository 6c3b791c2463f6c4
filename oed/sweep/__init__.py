"""A grid of studies: one study with some of its keys at every combination of the values given."""

from oed.sweep.axes import Axis, parse_axis
from oed.sweep.points import Point, grid
from oed.sweep.run import FILE, load_sweep, sweep

__all__ = ["FILE", "Axis", "Point", "grid", "load_sweep", "parse_axis", "sweep"]
