"""Upper bounds for sensors that are estimated from together, from two directions nobody can do much about.

Growing all lengths of the robot alike moves every position away from the start in proportion: that is as
informative as the positions lie apart. Changing the forward speed in proportion to the yaw rate moves every
position along a circle of the track's size.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from oed.bounds.certificate import Bound
from oed.bounds.closed_form import SPEEDS, along
from oed.bounds.reach import coefficient_rows, room, scales_lengths, top_speeds
from oed.bounds.spread import largest_spread, too_fine
from oed.foundation.arrays import Array
from oed.kernel.criteria import E
from oed.kernel.measurement.sensor import Sensor
from oed.kernel.problem import Estimation, Problem
from oed.robots.models.model import robot_of
from oed.robots.sensors.biased import YawRate
from oed.robots.sensors.mapped import Ranges
from oed.robots.sensors.poses import Poses


def joint_bounds(problem: Problem) -> Iterator[Bound]:
    """Bounds on E for sensors that are estimated from together; none where the noise of one is not known."""
    sensors = problem.measurement.joint_sensors if type(problem.criterion) is E else ()
    precisions = [_position_precision(sensor) for sensor in sensors]
    if any(precision is None for precision in precisions) or not sensors:
        return
    weights = [float(precision or 0.0) for precision in precisions]
    # Of all readings together, per squared displacement.
    readings = [len(sensor.columns(problem.design.samples)) for sensor in sensors]
    total = sum(weight * count for weight, count in zip(weights, readings, strict=True))
    (one,) = problem.any_estimations
    if robot_of(problem.system).physical is not problem.system:
        yield from _circle_bound(problem, one, sensors, total)
    else:
        yield from _size_bounds(problem, one, sensors, weights, total)


def _position_precision(sensor: Sensor) -> float | None:
    # At most so much information per reading and squared displacement of the sensor [1/m^2]; None if unknown.
    if isinstance(sensor, YawRate):
        return 0.0
    if isinstance(sensor, Ranges):
        return len(sensor.beacons) / sensor.noise**2
    if not isinstance(sensor, Poses) or sensor.joint_whitening is not None:
        return None
    if sensor.noise.covariance is not None:
        return float(1 / np.linalg.eigvalsh(np.array(sensor.noise.covariance))[0])
    deviations = [sensor.noise.deviation(name) for name in sensor.quantities if name != "heading"]
    return max((float(deviation or np.inf) ** -2 for deviation in deviations), default=0.0)


def _unknown_start(sensors: Sequence[Sensor]) -> bool:
    # Whether shifting the whole path costs nothing: no sensor knows where the drive began.
    known = [sensor.start_known for sensor in sensors if sensor.start_known is not None]
    return bool(known) and all(entry == "unknown" for entry in known)


def _circle_bound(
    problem: Problem, one: Estimation, sensors: Sequence[Sensor], total: float
) -> Iterator[Bound]:
    rows = coefficient_rows(problem)
    names = robot_of(problem.model).coefficient_names[1]
    if rows is None or robot_of(problem.system).integration != "arc" or not set(names) <= set(one.judged):
        return
    # One parameter change along c21, c22 like the yaw rate's row: displacement on a unit circle.
    change = np.zeros(len(one.judged))
    change[[one.judged.index(name) for name in names]] = rows[0]
    centred = _unknown_start(sensors) and all(isinstance(sensor, Poses | YawRate) for sensor in sensors)
    value = total if centred else 4.0 * total
    yield along(
        problem,
        one,
        change,
        value,
        "forward speed wrong in proportion to the yaw rate: a circle of the track's size",
        ("exact arcs", "neither speeds nor the room matter"),
    )


def _size_bounds(
    problem: Problem, one: Estimation, sensors: Sequence[Sensor], weights: list[float], total: float
) -> Iterator[Bound]:
    # In m, or in m per something else.
    lengths = [entry.name for entry in problem.system.parameters if entry.unit.startswith("m")]
    bounds = room(problem)
    if bounds is None or not set(lengths) <= set(one.judged) or not scales_lengths(problem, tuple(lengths)):
        return
    values = dict(zip(one.parameters, one.nominal, strict=True))
    change = np.array([values[name] if name in lengths else 0.0 for name in one.judged])
    x_min, x_max, y_min, y_max = bounds
    if not _unknown_start(sensors):
        return
    half_squares = ((x_max - x_min) ** 2 + (y_max - y_min) ** 2) / 4
    yield along(
        problem,
        one,
        change,
        total * half_squares,
        "all lengths wrong alike: every position in a corner of the room",
        ("every position within the room", "initial pose unknown", "speeds are left out"),
    )
    speeds = top_speeds(problem)
    step = problem.design.period * (np.zeros(1) if speeds is None else speeds)
    # Sensors share one shift of the path, so their spreads are one where one sensor alone reads positions.
    reading = [(weight, sensor) for weight, sensor in zip(weights, sensors, strict=True) if weight]
    if speeds is None or len(reading) != 1 or too_fine(x_min, x_max, step) or too_fine(y_min, y_max, step):
        return
    ((weight, sensor),) = reading
    yield along(
        problem,
        one,
        change,
        weight * _spread(problem, sensor, bounds, speeds),
        "all lengths wrong alike: dynamic programming over positions within top speed, axis by axis",
        ("every position within the room", "initial pose unknown", SPEEDS),
    )


def _spread(
    problem: Problem, sensor: Sensor, bounds: tuple[float, float, float, float], speeds: Array
) -> float:
    samples = problem.design.samples
    read = np.zeros(samples + 1, dtype=bool)
    read[sensor.columns(samples)] = True
    steps = problem.design.period * speeds
    starts = problem.fixed_starts
    first = (None, None) if starts is None else (float(starts[0, 0]), float(starts[0, 1]))
    # Moved to where it should begin, a path that does not begin there needs so much more room.
    more = problem.start_spare
    x_min, x_max, y_min, y_max = (one + sign * more for one, sign in zip(bounds, (-1, 1, -1, 1), strict=True))
    return largest_spread(x_min, x_max, first[0], steps, read) + largest_spread(
        y_min, y_max, first[1], steps, read
    )
