"""A grid of studies: one study with some of its keys at every combination of the values given."""

from oed.workflow.sweep.axes import Axis, parse_axis
from oed.workflow.sweep.points import Point, grid
from oed.workflow.sweep.run import FILE, Swept, load_sweep, sweep

__all__ = ["FILE", "Axis", "Point", "Swept", "grid", "load_sweep", "parse_axis", "sweep"]
