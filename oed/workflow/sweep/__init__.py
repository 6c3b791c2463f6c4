"""A grid of studies: one study with some of its keys at every combination of the values given."""

from oed.records.record import SWEEP_FILE as FILE
from oed.records.record import load_sweep
from oed.workflow.sweep.axes import Axis, parse_axis
from oed.workflow.sweep.points import Point, grid
from oed.workflow.sweep.run import Swept, sweep

__all__ = ["FILE", "Axis", "Point", "Swept", "grid", "load_sweep", "parse_axis", "sweep"]
