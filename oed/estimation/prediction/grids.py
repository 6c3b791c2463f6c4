"""One grid of times for all that was read during a drive: poses, and what other sensors read."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from oed.estimation.prediction.segments import Labelled
from oed.foundation.arrays import Array, Bools
from oed.logs.log import Log, SensorReadings

TOGETHER = 1e-6
"""Times that differ by less are one [s]: stamps are rounded so."""
LONGEST = 0.1
"""Longest step of a grid, but for gaps [s]: robots hardly change their motion within it."""
LEAST = 0.5
"""Share of a period's readings that there have to be for a mean."""
BRIDGED = 10.0
"""Longest time in which nothing is read and the wheels carry on [s]."""
GAP = 5.0
"""How many times the usual period a step in time has to be to count as a gap."""


@dataclass(frozen=True)
class Grid:
    """Readings of a drive at all its times.

    Attributes:
        times: (n,) on the poses' clock [s].
        readings: poses, then what the sensors read, (n, quantities), SI; what is read of a period stands at
            its begin, as the mean of all readings in it. 0 where there is none.
        valid: which of them there are, (n, quantities).
        averaged: of how many readings each is the mean, (n, quantities).
        of_periods: which quantities are read of periods, (quantities,).
    """

    times: Array
    readings: Array
    valid: Bools
    averaged: Array
    of_periods: Bools


def grid_of(log: Log, sensors: Labelled, offset: float) -> Grid:
    """The grid of a log.

    Args:
        log: whose poses and readings are put there.
        sensors: that read beside the poses, by their names.
        offset: of the clocks [s].
    """
    if not sensors:
        there, none = np.ones(log.poses.shape), np.zeros(len(log.quantities), dtype=bool)
        return Grid(log.pose_times, log.poses, there > 0, there, none)
    read = {one.sensor: one for one in log.sensors}
    own = [(sensor, read.get(name)) for name, sensor in sensors]
    moments = [one.on("poses", offset) for sensor, one in own if one and sensor.when == "at samples"]
    times = _finer(_merged(np.concatenate([log.pose_times, *moments])), log.gap)
    parts = [_at_times(log.pose_times, log.poses, times)]
    for sensor, one in own:
        width = len(sensor.entries)
        if one is None:
            parts.append((np.zeros((len(times), width)), np.zeros((len(times), width))))
        elif sensor.when == "in periods":
            parts.append(_in_periods(one, times, offset))
        else:
            parts.append(_at_times(one.on("poses", offset), one.values, times))
    readings, counts = (np.concatenate(columns, axis=1) for columns in zip(*parts, strict=True))
    of_periods = [False] * len(log.quantities)
    of_periods += [sensor.when == "in periods" for sensor, _ in own for _ in sensor.entries]
    valid = counts > 0
    return Grid(times, readings, valid, np.where(valid, counts, 1.0), np.array(of_periods, dtype=bool))


def _merged(times: Array) -> Array:
    rising = np.sort(times)
    return np.asarray(rising[np.concatenate([[True], np.diff(rising) > TOGETHER])])


def _finer(times: Array, gap: float | None) -> Array:
    # With further times in long steps that are no gaps: inputs change within them, and carry the drive on.
    steps, longest = np.diff(times), BRIDGED if gap is None else gap
    parts = np.where(steps <= longest, np.ceil(steps / LONGEST - TOGETHER), 1).astype(int).clip(1)
    first = np.concatenate([[0], np.cumsum(parts)])
    return np.asarray(np.interp(np.arange(first[-1] + 1), first, times))


def _at_times(times: Array, values: Array, grid: Array) -> tuple[Array, Array]:
    # Readings at some of the grid's times, and whether there is one, (n, q) each.
    found, counts = np.zeros((len(grid), values.shape[1])), np.zeros((len(grid), values.shape[1]))
    rows = np.searchsorted(grid, times + TOGETHER / 2, side="right") - 1
    there = np.isfinite(values)
    at, columns = rows[np.nonzero(there)[0]], np.nonzero(there)[1]
    found[at, columns] = values[there]
    counts[at, columns] = 1.0
    return found, counts


def _in_periods(read: SensorReadings, grid: Array, offset: float) -> tuple[Array, Array]:
    # Means over the grid's periods, and of how many readings, (n, q): of several the mean of straight lines
    # between them, which adds up over periods; of one its value.
    width = read.values.shape[1]
    found, counts = np.zeros((len(grid), width)), np.zeros((len(grid), width))
    edges = read.on(read.clock, 0.0)
    marks = grid + (offset if read.clock == "inputs" else 0.0)
    inside = np.searchsorted(edges, marks)
    many = np.diff(inside)
    # Of a period that begins or ends outside of the readings the mean is not known, of a moment in it is.
    covered = (many == 1) | ((marks[:-1] >= edges[0]) & (marks[1:] <= edges[-1]))
    # Nor is that of one in which most readings are missing.
    usual = float(np.median(np.diff(edges))) if len(edges) > 1 else np.inf
    covered &= many * usual >= LEAST * np.diff(grid)
    integral = np.diff(read.integrals_at(marks), axis=0) / np.diff(grid)[:, None]
    alone = read.values[np.minimum(inside[:-1], len(edges) - 1)]
    found[:-1] = np.where(many[:, None] > 1, integral, alone)
    counts[:-1] = np.where(covered, many, 0)[:, None]
    return found, counts
