"""How noisy readings are: as a measurement specifies, or judged by what the fit leaves."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import scipy

from oed.foundation.arrays import Array, Bools
from oed.kernel.measurement.measurement import Measurement, sensors_of
from oed.kernel.measurement.readings import sensor_labels
from oed.kernel.measurement.sensor import Sensor
from oed.robots.sensors.logged import LoggedSensor
from oed.robots.sensors.logged import Noise as Noise
from oed.robots.sensors.relative_poses import logged_sensors

GROUPS = {"x": "position", "y": "position"}
"""Quantities that share their noise; any other has its own."""
SURE = 0.99
"""Confidence with which noise has to grow with speed, or with the yaw rate, to be modelled so."""
FROM_READING_TO_READING = 0.5
"""Share of the variance that grows with the yaw rate which has to show from one reading to the next: what
lasts longer is no noise but the model's error, for wheels slip in turns."""
LEAST = 1e-6
"""Smallest noise that is believed [m, rad]: exact logs leave residuals of rounding, or of exactly 0."""

AT_ZERO = 1e-4
"""Residuals at the 0 of a grid at most [m, rad]."""
EQUAL = 0.1
"""Difference of residuals at the same point of a grid at most, relative to its step."""
BETWEEN = (0.25, 0.75)
"""Where a grid has no residuals, relative to its step: what is normal has more there than beyond."""
HARDLY = 0.1
"""Number of residuals there, relative to those off 0, that outliers may be at most."""
FEWEST_AWAY = 5
"""Number of equal residuals off 0 that show a grid at least."""


def group_of(quantity: str) -> str:
    """The name of the noise that a quantity has: `ranges` of `ranges[2]`."""
    return GROUPS.get(quantity, quantity.partition("[")[0])


def places_of(group: str, quantities: Sequence[str]) -> list[int]:
    """Which of the quantities have that noise."""
    return [place for place, name in enumerate(quantities) if group_of(name) == group]


def groups(quantities: Sequence[str]) -> tuple[str, ...]:
    """The noises of those quantities."""
    return tuple(dict.fromkeys(map(group_of, quantities)))


def specified_noise(
    measurement: Measurement, averaged: int = 1, *, relative: bool = False
) -> dict[str, Noise]:
    """The noise that a measurement specifies of what logs hold, by kind of reading; of x and y the larger.

    Args:
        measurement: of the study.
        averaged: readings that each is the mean of: their noise is independent, means have that much less.
        relative: whether logs hold motions instead of poses.
    """
    found: dict[str, Noise] = {}
    for sensor in logged_sensors(measurement, relative):
        for quantity, noise in sensor.noises.items():
            group = group_of(quantity)
            if group not in found or found[group].at_rest < noise.at_rest:
                found[group] = noise
    found = {group: noise.divided(math.sqrt(averaged)) for group, noise in found.items()}
    sensors = sensors_of(measurement)
    return found | sensor_noise(tuple(zip(sensor_labels(sensors), sensors, strict=True)))


def sensor_noise(sensors: Sequence[tuple[str, Sensor]]) -> dict[str, Noise]:
    """The noise that sensors specify of their readings, by kind of reading.

    Args:
        sensors: by their names.
    """
    return {
        group_of(f"{label}{entry}"): Noise(size)
        for label, sensor in sensors
        if not isinstance(sensor, LoggedSensor)
        for entry, size in zip(sensor.entries, sensor.deviations, strict=False)
    }


def of_readings(rates: Array, valid: Bools) -> Array:
    """Speeds and yaw rates (2, m) of the readings that there are, `valid` (S, n, k), from those at all times,
    (2, S, n).
    """
    return np.asarray(np.broadcast_to(rates[..., None], (len(rates), *valid.shape))[:, valid])


def in_turn(valid: Bools, *values: Array) -> tuple[Bools, list[Array]]:
    """Which readings there are (S, n, k) and values (S, n, k) of them, moved to the front of each segment."""
    if np.all(valid[:, :-1] >= valid[:, 1:]):
        return valid, list(values)
    order = np.argsort(~valid, axis=1, kind="stable")
    there = np.arange(valid.shape[1])[:, None] < valid.sum(axis=1, keepdims=True)
    return np.asarray(there), [np.take_along_axis(one, order, axis=1) for one in values]


def jumps(residuals: Array, rates: Array, valid: Bools) -> Array:
    """Differences of successive residuals over sqrt(2), and the speeds and yaw rates (RMS) there, (3, m).

    Args:
        residuals: (S, n, k), SI.
        rates: speeds [m/s] and yaw rates [rad/s] at their times, (2, S, n).
        valid: which of them there are, (S, n, k).
    """
    wide = (np.broadcast_to(one[..., None], residuals.shape) for one in rates)
    there, (values, *each) = in_turn(valid, residuals, *wide)
    squares, both = np.square(each), there[:, 1:]
    around = np.sqrt((squares[:, :, 1:] + squares[:, :, :-1]) / 2)[:, both]
    return np.vstack([np.diff(values, axis=1)[both] / np.sqrt(2), around])


def estimated(
    residuals: Array,
    redundancy: Array,
    rates: Array,
    *,
    robust: bool,
    grows: bool,
    jumps: Array | None = None,
    least: float = LEAST,
) -> Noise:
    """The noise of residuals that a fit left.

    Args:
        residuals: (n,), SI.
        redundancy: share of each residual's variance that the fit left, (n,).
        rates: speeds [m/s] and yaw rates [rad/s] at their times, (2, n).
        robust: judge by the median, so that outliers do not matter; the noise is then constant.
        grows: whether parts that grow with speed and with the yaw rate are looked for.
        jumps: of the same residuals: growth with the yaw rate has to show there as well.
        least: smallest noise that the median may give, SI.
    """
    if robust:
        spread = np.median(np.abs(residuals)) / scipy.stats.norm.ppf(0.75)
        return Noise(max(float(spread / np.sqrt(max(redundancy.mean(), 1e-3))), least))
    squares = residuals**2 / np.maximum(redundancy, 1e-3)
    # Less than one degree of freedom says nothing of noise.
    constant = float(np.sqrt((residuals**2).sum() / max(redundancy.sum(), 1.0)))
    if not grows or constant <= LEAST:
        return Noise(max(constant, LEAST))
    found = _growing(squares, redundancy, rates, constant)
    if jumps is None or not found.per_yaw_rate or _jumps_alike(found, jumps):
        return found
    return _growing(squares, redundancy, rates * [[1.0], [0.0]], constant)


def step_of_grid(residuals: Array) -> float:
    """Return the step of the grid that residuals lie on, most of them at 0.

    A scan matcher that corrects odometry on a grid leaves such residuals of the parameters that odometry has.
    Their median is 0, but a correction by one step is no outlier: the step is a robust loss's least scale.

    Args:
        residuals: real or complex, (n,), SI.

    Returns:
        The step, SI; 0 where the residuals are not on a grid, or most of them are not at 0.
    """
    sizes = np.abs(residuals)
    away = sizes[sizes > AT_ZERO]
    if not FEWEST_AWAY <= len(away) < len(sizes) / 2:
        return 0.0
    step = float(np.median(away))
    first, last = BETWEEN
    between = np.count_nonzero((sizes > first * step) & (sizes < last * step))
    is_grid = between <= HARDLY * len(away) and np.mean(np.abs(away - step) < EQUAL * step) >= 0.5
    return step if is_grid else 0.0


def _jumps_alike(found: Noise, jumps: Array) -> bool:
    # Whether as much growth with the yaw rate shows from reading to reading.
    squares, constant = jumps[0] ** 2, float(np.sqrt(np.mean(jumps[0] ** 2)))
    if constant <= LEAST:
        return False
    parts = [1] if not found.per_speed else [0, 1]
    _, noise = greatest(squares, np.ones_like(squares), jumps[1:], constant, parts)
    return noise.per_yaw_rate**2 >= FROM_READING_TO_READING * found.per_yaw_rate**2


def _growing(squares: Array, redundancy: Array, rates: Array, constant: float) -> Noise:
    # The greatest likelihood less the price of every part that grows: none, by either rate, or by both.
    moving = [place for place in range(len(rates)) if np.any(rates[place] != 0)]
    price = float(scipy.stats.chi2.ppf(SURE, 1))
    best, least = Noise(constant), float((redundancy * squares).sum()) / constant**2
    alone = [(place,) for place in moving] if len(moving) > 1 else []
    for chosen in filter(None, (tuple(moving), *alone)):
        surprise, noise = greatest(squares, redundancy, rates, constant, chosen)
        if chosen == tuple(moving) and surprise + price > least:
            # Both together are not worth the price of one.
            return best
        if surprise + price * len(chosen) < least:
            best, least = noise, surprise + price * len(chosen)
    return best


def greatest(
    squares: Array, redundancy: Array, rates: Array, constant: float, parts: Sequence[int]
) -> tuple[float, Noise]:
    """The noise of greatest likelihood, and twice the negative logarithm of that.

    The likelihood is that of normal residuals, but for a constant: sum of f (ln v + s / v) with v the
    variance in units of `constant`^2, at rest and by the rates together.

    Args:
        squares: of the residuals, each divided by its redundancy, (n,).
        redundancy: weights f, (n,).
        rates: speeds [m/s] and yaw rates [rad/s], (2, n).
        constant: the noise if it were constant, SI.
        parts: which of the rates it may grow with.
    """
    # All parts in units of the constant noise, so that their logarithms are of order 1.
    units = np.array([np.sqrt(np.mean(rates[part] ** 2)) or 1.0 for part in parts])
    ratios = squares / constant**2
    columns = np.vstack(
        [np.ones_like(ratios), *((rates[part] / unit) ** 2 for part, unit in zip(parts, units, strict=True))]
    )

    def surprise(logs: Array) -> tuple[float, Array]:
        sizes = np.exp(logs)
        variance = sizes @ columns
        left = ratios / variance
        value = float((redundancy * (np.log(variance) + left)).sum())
        return value, sizes * (columns @ (redundancy * (1 - left) / variance))

    count = len(columns)
    found = scipy.optimize.minimize(
        surprise, np.full(count, -np.log(count)), jac=True, method="L-BFGS-B", bounds=[(-12, 6)] * count
    )
    sizes = np.sqrt(np.exp(found.x)) * constant
    growth = dict(zip(parts, map(float, sizes[1:] / units), strict=True))
    return float(found.fun), Noise(float(sizes[0]), growth.get(0, 0.0), growth.get(1, 0.0))
