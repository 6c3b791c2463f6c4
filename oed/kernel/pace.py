"""Experiments whose duration is chosen: how fast a drive goes through the longest one."""

from __future__ import annotations

from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.rollout import Drive

PACE = "share_of_duration"
"""Name of the input, of systems that have it, by which every period is shorter than the longest."""


def pace_of(drive: Drive) -> Expression | float:
    """By which share every period is as long as the longest, (N, 1); 1 where the duration is given."""
    names = drive.system.input_names
    return drive.inputs[:, names.index(PACE)] if PACE in names else 1.0
