"""Bounds on tr(Z F) of fused sensors from the largest sensitivity of the pose to the parameters.

Relative to the pose at one moment, a change of parameters changes the heading by the integral of the change
of the yaw rate. It changes the position by the integral of the change of the speed, and of the change of the
yaw rate times an arm: the distance between the positions now and at the turn. An arm is at most the
workspace's diagonal, and the path in between. All of it is convex in the inputs, so it is largest at corners
of their bounds, period by period. F after elimination of the start pose is at most F relative to the pose at
any moment, and relative to a known start.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import casadi as ca
import numpy as np

from oed.bounds.certificate import Bound
from oed.bounds.closed_form import SPEEDS, prior_matrix
from oed.bounds.reach import input_reach, largest_input_gain, top_speeds, workspace_bounds
from oed.foundation.arrays import Array, Places
from oed.kernel.measurement.information import Estimation
from oed.kernel.measurement.readings import moment_reading
from oed.kernel.measurement.sensor import Sensor
from oed.kernel.problem import Problem
from oed.robots.models.model import robot_of
from oed.robots.sensors.biased import YawRate
from oed.robots.sensors.mapped import Ranges
from oed.robots.sensors.poses import Poses

METHOD = "how far parameters can move the pose within the room and the speeds"
"""Method of these bounds, in words."""
CHUNK = 256
"""Number of samples whose arms are computed together."""
DRAWS = 8
"""Number of random points at which motions are compared."""
MOST_INPUTS = 4
"""Largest number of inputs whose corners are enumerated."""


@dataclass(frozen=True)
class SensorPrecision:
    """Upper bounds on the information of one reading.

    Attributes:
        sensor: sensor of the reading.
        position: information per squared displacement of the sensor [1/m^2].
        heading: information per squared turn [1/rad^2].
        rate: information per squared change of the yaw rate [s^2/rad^2].
        arm: distance of the sensor from the robot's origin [m].
    """

    sensor: Sensor
    position: float
    heading: float = 0.0
    rate: float = 0.0
    arm: float = 0.0


def _precision(sensor: Sensor) -> SensorPrecision | None:
    if isinstance(sensor, YawRate):
        return SensorPrecision(sensor, 0.0, 0.0, sensor.noise**-2)
    if not isinstance(sensor, Poses | Ranges) or sensor.joint_whitening is not None:
        return None
    arm = float(np.hypot(sensor.lever_arm.x, sensor.lever_arm.y))
    if isinstance(sensor, Ranges):
        return SensorPrecision(sensor, len(sensor.beacons) / sensor.noise**2, arm=arm)
    if sensor.noise.covariance is not None:
        most = float(1 / np.linalg.eigvalsh(np.array(sensor.noise.covariance))[0])
        return SensorPrecision(sensor, most, most, arm=arm)
    precisions = {name: float(sensor.noise.deviation(name) or np.inf) ** -2 for name in sensor.quantities}
    places = [value for name, value in precisions.items() if name != "heading"]
    return SensorPrecision(sensor, max(places, default=0.0), precisions.get("heading", 0.0), arm=arm)


def precisions_of(sensors: Sequence[Sensor]) -> list[SensorPrecision]:
    """Return upper bounds on the information of the sensors' readings; [] if one of them is unknown."""
    precisions = [entry for entry in map(_precision, sensors) if entry is not None]
    return precisions if len(precisions) == len(sensors) else []


def unknown_start(sensors: Sequence[Sensor]) -> bool:
    """Return True if no sensor knows the start pose, so that readings determine paths up to rigid motions."""
    start_knowledge = [sensor.start_known for sensor in sensors if sensor.start_known is not None]
    return bool(start_knowledge) and all(entry == "unknown" for entry in start_knowledge)


@dataclass(frozen=True)
class MotionSensitivity:
    """Largest sensitivity of the motion to the parameters.

    Attributes:
        turn_slopes: derivatives of the turn in a period by the scaled parameters, at corners of the inputs'
            bounds, (N, corners, p).
        length_slopes: derivatives of the length of a period's path, (N, corners, p).
        lengths: length of the longest path up to every sample, (N + 1,).
        across: longest arm.
        period: sample period [s].
    """

    turn_slopes: Array
    length_slopes: Array
    lengths: Array
    across: float
    period: float

    def trace_bound(self, factor: Array, precisions: Sequence[SensorPrecision], reference: int) -> float:
        """Return an upper bound on tr(Z F) for Z = U'U.

        Args:
            factor: root U, (r, p).
            precisions: precisions of the sensors.
            reference: sample whose pose counts as known.
        """
        samples = len(self.turn_slopes)
        turn_slopes, length_slopes = (
            np.abs(self.turn_slopes @ factor.T),
            np.abs(self.length_slopes @ factor.T),
        )
        turns = np.linalg.norm(turn_slopes, axis=2).max(axis=1)
        so_far, indices = np.concatenate([[0.0], np.cumsum(turns)]), np.arange(samples + 1)
        heading = np.abs(so_far - so_far[reference])
        chunks: list[Places] = np.array_split(indices, samples // CHUNK + 1)
        place = np.concatenate(
            [self._displaced(turn_slopes, length_slopes, chunk, reference) for chunk in chunks]
        )
        total = 0.0
        for precision in precisions:
            read = precision.sensor.columns(samples)
            if precision.rate:
                total += precision.rate * float(((turns[read] / self.period) ** 2).sum())
            else:
                total += precision.position * float(((place + precision.arm * heading)[read] ** 2).sum())
                total += precision.heading * float((heading[read] ** 2).sum())
        return total

    def _displaced(self, turn_slopes: Array, length_slopes: Array, samples: Places, reference: int) -> Array:
        # Upper bounds on the displacements of the positions at some samples.
        periods = np.arange(len(turn_slopes))
        later = samples[:, None] > reference
        ends = np.where(later, self.lengths[:-1], self.lengths[1:])
        arms = np.minimum(np.abs(self.lengths[samples][:, None] - ends), self.across)
        between = np.where(
            later,
            (periods >= reference) & (periods < samples[:, None]),
            (periods < reference) & (periods >= samples[:, None]),
        )
        squares = [
            (length_slopes[:, corner] ** 2).sum(axis=1)
            + 2 * arms * (length_slopes[:, corner] * turn_slopes[:, corner]).sum(axis=1)
            + arms**2 * (turn_slopes[:, corner] ** 2).sum(axis=1)
            for corner in range(turn_slopes.shape[1])
        ]
        return np.asarray(np.where(between, np.sqrt(np.max(squares, axis=0)), 0.0).sum(axis=1))


def sensitivity_bounds(problem: Problem) -> Iterator[Bound]:
    """Yield bounds on tr(Z F) for every parameter, all together, and all but the size of the robot."""
    sensors = problem.sensors
    precisions = precisions_of(sensors)
    if not precisions or len(problem.any_estimations) > 1:
        return
    (estimation,) = problem.any_estimations
    # Constants of sensors change readings without moving the pose, so no bound here covers them.
    if not set(estimation.judged) <= {parameter.name for parameter in problem.system.parameters}:
        return
    motion = _motion(problem, estimation)
    if motion is None or any(_reads_parameters(problem, sensor) for sensor in sensors):
        return
    assumptions = (SPEEDS, *(("every position within the room",) if np.isfinite(motion.across) else ()))
    reference = problem.design.samples // 2 if unknown_start(sensors) else 0
    prior, count = prior_matrix(estimation), len(estimation.judged)

    def bound(factor: Array) -> Bound:
        multiplier = factor.T @ factor
        value = motion.trace_bound(factor, precisions, reference) + float(np.sum(multiplier * prior))
        size = float(np.trace(multiplier))
        return Bound(value / size, METHOD, assumptions, multiplier / size, estimation.block.name)

    separate = [bound(row[None]) for row in np.eye(count)]
    yield from separate
    sizes = np.array([single.value for single in separate])
    if count < 2 or not (sizes > 0).all():
        return
    balanced = np.diag(sizes**-0.5)
    yield bound(balanced)
    nominal = dict(zip(estimation.parameters, estimation.nominal, strict=True))
    grown = balanced @ (np.array([nominal[name] for name in estimation.judged]) / estimation.scales)
    yield bound((np.eye(count) - np.outer(grown, grown) / float(grown @ grown)) @ balanced)


def _motion(problem: Problem, estimation: Estimation) -> MotionSensitivity | None:
    slopes, factor, speeds = _slopes(problem, estimation), largest_input_gain(problem), top_speeds(problem)
    if slopes is None or factor is None or speeds is None:
        return None
    period, reach = problem.design.period, factor * input_reach(problem)
    # Corners with all signs reversed have the same sensitivity.
    signs = np.array([(1.0, *rest) for rest in product((1.0, -1.0), repeat=reach.shape[1] - 1)])
    corners = period * reach[:, None, :] * signs
    lengths = np.concatenate([[0.0], np.cumsum(period * speeds)])
    bounds = workspace_bounds(problem)
    across = np.inf
    if bounds is not None:
        # Between samples an arc may bulge out of the workspace.
        across = float(np.hypot(bounds[1] - bounds[0], bounds[3] - bounds[2]) + period * speeds.max())
    return MotionSensitivity(corners @ slopes[0], corners @ slopes[1], lengths, across, period)


def _slopes(problem: Problem, estimation: Estimation) -> tuple[Array, Array] | None:
    # Derivatives of yaw rate and forward speed by effective inputs and scaled parameters, (inputs, p) each;
    # None if the parameters act on the motion in another way as well.
    robot = robot_of(problem.system)
    if len(robot.coefficient_names) != 2 or len(robot.inputs) > MOST_INPUTS:
        return None
    inputs, parameters = ca.SX.sym("u", len(robot.inputs)), ca.SX.sym("p", len(robot.parameters))
    effective = robot.effective_inputs(inputs, parameters)
    matrix, twist = robot.coefficients(parameters), robot.twist(inputs, parameters)
    rates = matrix @ effective
    apart = twist - ca.vertcat(rates[1], 0, rates[0])
    rows = [ca.jacobian(matrix[row, :].T, parameters) for row in range(2)]
    slips = ca.densify(ca.jacobian(effective, parameters))
    function = ca.Function("motion", [inputs, parameters], [apart, slips, *rows])
    rng, nominal = np.random.default_rng(0), np.array(robot.nominal)
    low, high = problem.input_bounds.T
    for _ in range(DRAWS):
        point = rng.uniform(low, high), nominal * rng.uniform(0.9, 1.1, len(nominal))
        deviation, slip, *_ = (np.array(part) for part in function(*point))
        if np.abs(deviation).max() > 1e-9 * np.abs(high).max() or slip.any():
            return None
    turn, forward = (np.array(part) for part in function(high, nominal)[2:])
    names = [entry.name for entry in robot.parameters]
    columns = [names.index(name) for name in estimation.judged]
    return turn[:, columns] * estimation.scales, forward[:, columns] * estimation.scales


def _reads_parameters(problem: Problem, sensor: Sensor) -> bool:
    # True if the reading of a fixed pose depends on parameters.
    if isinstance(sensor, YawRate):
        return False
    system = robot_of(problem.system)
    function, rng = moment_reading(sensor, system), np.random.default_rng(0)
    arguments = [rng.uniform(0.5, 1.5, function.size_in(place)) for place in range(6)]
    arguments[1] = np.zeros(function.size_in(1))
    arguments[3] = np.array(system.nominal)
    rows = np.array(function(*arguments)[1])[: len(system.parameters)]
    return bool(rows.any())
