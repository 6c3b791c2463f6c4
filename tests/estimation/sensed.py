"""Logs of simulated drives whose robot had more sensors than wheels and poses: gyros, beacons, landmarks.

What they read is written out here, in complex numbers; nothing is predicted by the package.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from simulated import Course, log_of, readings

from oed.logs.log import Log, SensorReadings

PLACES = ((3.0, 2.5), (-2.5, 2.0), (0.5, -3.0), (2.5, -2.0))


def gyro(
    drive: Course, *, noise: float = 0.0, bias: float = 0.0, scale: float = 1.0, every: int = 1, seed: int = 0
) -> SensorReadings:
    """Yaw rates between some knots, with errors."""
    rates = np.diff(drive.states[:, 2]) / np.diff(drive.times)
    middle = (drive.times[1:] + drive.times[:-1]) / 2
    errors = noise * np.random.default_rng([seed, 3]).normal(size=len(rates))
    values = (scale * rates + bias + errors)[::every, None]
    return SensorReadings("yaw_rate", middle[::every], values, "inputs")


def sighted(
    drive: Course,
    name: str,
    quantities: str,
    places: Sequence[Sequence[float]],
    *,
    noise: Sequence[float],
    rows: np.ndarray,
    camera: Sequence[float] = (0.0, 0.0, 0.0),
    missing: float = 0.0,
    late: float = 0.0,
    bias: float = 0.0,
    seed: int = 0,
) -> SensorReadings:
    """Some of range, bearing and orientation ("rbo") of places at some knots, in turn; with errors, some of
    the places not seen, on a clock that is late.
    """
    rng = np.random.default_rng([seed, 4])
    x, y = readings(drive.states, (*camera[:2], 0.0), ("x", "y"))[rows].T
    looks = drive.states[rows, 2] + camera[2]
    columns = []
    for place in places:
        seen = (complex(*place[:2]) - x - 1j * y) * np.exp(-1j * looks)
        turned = np.angle(np.exp(1j * (place[-1] - looks)))
        every = {"r": np.abs(seen) + bias, "b": np.angle(seen), "o": turned}
        columns.append(np.column_stack([every[one] for one in quantities]))
    values = np.concatenate(columns, axis=1)
    values = values + np.tile(noise, len(places)) * rng.normal(size=values.shape)
    unseen = rng.random((len(rows), len(places))) < missing
    values[np.repeat(unseen, len(quantities), axis=1)] = np.nan
    kept = np.isfinite(values).any(axis=1)
    return SensorReadings(name, drive.times[rows][kept] + late, values[kept], "poses")


def with_sensors(drive: Course, *sensors: SensorReadings, poses: bool = True, **keys: Any) -> Log:
    """The log of a drive, with sensors, and with or without poses; keys as of `log_of`."""
    log = log_of(drive, **keys)
    if not poses:
        times = np.unique(np.concatenate([one.times for one in sensors if one.clock == "poses"]))
        log = replace(log, pose_times=times, poses=np.zeros((len(times), 0)), quantities=())
    return replace(log, sensors=sensors)
