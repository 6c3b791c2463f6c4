"""What poses alone say of themselves: which of them are outliers, and how noisy they are.

Checks before a fit must neither take a reading that is metres off for motion, nor noise for it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from oed.foundation.arrays import Array, Bools
from oed.logs.log import Log

WINDOW, FAST = 11, 95.0
"""Steps of a running median, and the percentile of these while the wheels turn that is a drive's fast motion.
A few outliers within a window leave its median alone."""
JUMP = 5.0
"""How many times as fast a step is that is none of the robot's."""
FEW = 3
"""Poses between two jumps that are too few to be a place where the robot was."""
MEDIAN = 0.6745
"""Median of |e| of a standard normal e."""
THIRD = np.sqrt(20.0)
"""Standard deviation of third differences of white noise of deviation 1."""
SHAKEN = 1e-12
"""Steps of less [m, rad] are none: a jump from a pose that is held is one all the same."""


def without_outliers(log: Log) -> Log:
    """The log without the few poses that its others jump to and back from."""
    marks = np.flatnonzero(jumps(log)) + 1
    runs = np.split(np.arange(len(log.poses)), marks)
    kept = np.concatenate([run if len(run) >= FEW else run[:0] for run in runs])
    if not len(marks) or len(kept) < len(log.poses) / 2:
        return log
    return replace(log, pose_times=log.pose_times[kept], poses=log.poses[kept])


def jumps(log: Log) -> Bools:
    """Which steps between poses (poses - 1,) are several times as fast as the drive's fast ones."""
    found = np.zeros(max(len(log.poses) - 1, 0), dtype=bool)
    if len(found) < WINDOW:
        return found
    turned = log.integrals_at(log.pose_times)
    driven = np.any(turned[WINDOW:] != turned[:-WINDOW], axis=1)
    for places in _kinds(log):
        lengths = np.linalg.norm(np.diff(log.poses[:, places], axis=0), axis=1)
        speeds = lengths / np.diff(log.pose_times)
        usual = np.median(sliding_window_view(speeds, WINDOW), axis=1)
        fast = np.percentile(usual[driven] if driven.any() else usual, FAST)
        found |= (speeds > JUMP * fast) & (lengths > SHAKEN)
    return found


def _kinds(log: Log) -> list[list[int]]:
    # Positions jump together, each angle by itself.
    flat = [place for place, name in enumerate(log.quantities) if name in ("x", "y")]
    angles = [[place] for place, name in enumerate(log.quantities) if name not in ("x", "y")]
    return [flat, *angles] if flat else angles


def white_noise(log: Log) -> Array:
    """Standard deviation of each quantity's white noise (quantities,), SI.

    By third differences, in which smooth motion is next to nothing, and their median, which outliers leave
    alone. Of few poses 0.
    """
    if len(log.poses) <= WINDOW:
        return np.zeros(len(log.quantities))
    third = np.abs(np.diff(log.poses, n=3, axis=0))
    return np.asarray(np.median(third, axis=0) / (MEDIAN * THIRD))
