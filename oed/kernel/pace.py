"""Experiments whose duration is chosen: how fast a drive goes through the longest one."""

from __future__ import annotations

from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.rollout import Drive

PACE = "share_of_duration"
"""Name of the input, of systems that have it, by which every period is shorter than the longest."""


def pace_of(drive: Drive) -> Expression | float:
    """Return the share of the longest period that each period lasts, (N, 1); 1 for a given duration."""
    names = drive.system.input_names
    return drive.inputs[:, names.index(PACE)] if PACE in names else 1.0
