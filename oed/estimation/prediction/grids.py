"""One grid of times for all that was read during a drive: poses, and what other sensors read."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from oed.estimation.prediction.segments import Labelled
from oed.foundation.arrays import Array, Bools, Places
from oed.logs.log import BRIDGED, Log, SensorReadings

TOGETHER = 1e-6
"""Times that differ by less are one [s]: stamps are rounded so."""
LONGEST = 0.1
"""Longest step of a grid of several sensors [s]: robots hardly change their motion within it."""
LEAST = 0.5
"""Share of a period's readings that there have to be for a mean."""
GAP = 5.0
"""How many times the usual period a step in time has to be to count as a gap."""
STEPS = (0.02, 0.1)
"""Shortest and longest steps of the grid through a gap of the poses [s]: shorter ones show no more of a
robot's motion."""


@dataclass(frozen=True)
class Grid:
    """Readings of a drive at all its times.

    Attributes:
        times: (n,) on the poses' clock [s]; through gaps, too, as far as the wheels carry a drive on.
        read: places of those at which something is read.
        readings: poses, then what the sensors read, (n, quantities), SI; what is read of a period stands at
            its begin, as the mean of all readings in it. 0 where there is none.
        valid: which of them there are, (n, quantities).
        averaged: of how many readings each is the mean, (n, quantities).
        of_periods: which quantities are read of periods, (quantities,).
    """

    times: Array
    read: Places
    readings: Array
    valid: Bools
    averaged: Array
    of_periods: Bools

    @property
    def read_times(self) -> Array:
        """Times at which something is read [s]."""
        return self.times[self.read]


def grid_of(log: Log, sensors: Labelled, offset: float) -> Grid:
    """The grid of a log.

    Args:
        log: whose poses and readings are put there.
        sensors: that read beside the poses, by their names.
        offset: of the clocks [s].
    """
    if not sensors:
        return _of_poses(log)
    read = {one.sensor: one for one in log.sensors}
    own = [(sensor, read.get(name)) for name, sensor in sensors]
    moments = [one.on("poses", offset) for sensor, one in own if one and sensor.when == "at samples"]
    times, places = _finer(_merged(np.concatenate([log.pose_times, *moments])), LONGEST, LONGEST, log.gap)
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
    averaged = np.where(valid, counts, 1.0)
    return Grid(times, places, readings, valid, averaged, np.array(of_periods, dtype=bool))


def usual_of(times: Array) -> float:
    """The median of the steps of times (n,) [s]."""
    return float(np.median(np.diff(times)))


def _of_poses(log: Log) -> Grid:
    usual = usual_of(log.pose_times)
    times, places = _finer(log.pose_times, GAP * usual, float(np.clip(usual, *STEPS)), log.gap)
    readings = np.zeros((len(times), len(log.quantities)))
    valid = np.zeros(readings.shape, dtype=bool)
    readings[places], valid[places] = log.poses, True
    none = np.zeros(len(log.quantities), dtype=bool)
    return Grid(times, places, readings, valid, np.ones(readings.shape), none)


def _merged(times: Array) -> Array:
    rising = np.sort(times)
    return np.asarray(rising[np.concatenate([[True], np.diff(rising) > TOGETHER])])


def _finer(times: Array, long: float, step: float, gap: float | None) -> tuple[Array, Places]:
    # With further times in long steps through which motion is carried on, and the places of those given.
    steps, longest = np.diff(times), BRIDGED if gap is None else gap
    carried = (steps > long) & (steps <= longest)
    parts = np.where(carried, np.ceil(steps / step - TOGETHER), 1).astype(int).clip(1)
    first = np.concatenate([[0], np.cumsum(parts)])
    return np.interp(np.arange(first[-1] + 1), first, times), first


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
