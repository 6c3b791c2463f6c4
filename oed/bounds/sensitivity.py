"""How much the pose can depend on parameters: bounds on tr(Z F) of sensors that are estimated from together.

Relative to the pose at one moment, a change of parameters changes the heading by the integral of the change
of the yaw rate, and the position by the integral of the change of the speed and of that of the yaw rate times
an arm: how far the position now is from that when the robot turned. Arms are no longer than the room is
across, and than the path in between. All of it is largest at corners of what the inputs may be, period by
period. What is left of F when the start pose is eliminated is at most what there is relative to the pose at
any moment, and to a start that is known.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import casadi as ca
import numpy as np

from oed.bounds.certificate import Bound
from oed.bounds.closed_form import SPEEDS, prior_matrix
from oed.bounds.reach import grip, input_reach, room, top_speeds
from oed.foundation.arrays import Array, Places
from oed.kernel.criteria import E
from oed.kernel.measurement.measurement import Sensor
from oed.kernel.measurement.readings import moment_reading
from oed.kernel.problem import Problem
from oed.kernel.statement import Estimation
from oed.robots.models.model import robot_of
from oed.robots.sensors.biased import YawRate
from oed.robots.sensors.mapped import Ranges
from oed.robots.sensors.poses import Poses

METHOD = "how far parameters can move the pose within the room and the speeds"
"""How these bounds are found."""
CHUNK = 256
"""Samples whose arms are looked at together."""
DRAWS = 8
"""Random points at which what a robot does is compared."""
MOST_INPUTS = 4
"""Inputs whose corners are few enough."""


@dataclass(frozen=True)
class Precision:
    """Information of one reading, at most.

    Attributes:
        sensor: that reads.
        position: per squared displacement of the sensor [1/m^2].
        heading: per squared turn [1/rad^2].
        rate: per squared change of the yaw rate [s^2/rad^2].
        arm: distance of the sensor from the robot's origin [m].
    """

    sensor: Sensor
    position: float
    heading: float = 0.0
    rate: float = 0.0
    arm: float = 0.0


def precision(sensor: Sensor) -> Precision | None:
    """What a reading says at most; None where that is not known."""
    if isinstance(sensor, YawRate):
        return Precision(sensor, 0.0, 0.0, sensor.noise**-2)
    if not isinstance(sensor, Poses | Ranges) or sensor.joint_whitening is not None:
        return None
    arm = float(np.hypot(sensor.lever_arm.x, sensor.lever_arm.y))
    if isinstance(sensor, Ranges):
        return Precision(sensor, len(sensor.beacons) / sensor.noise**2, arm=arm)
    if sensor.noise.covariance is not None:
        most = float(1 / np.linalg.eigvalsh(np.array(sensor.noise.covariance))[0])
        return Precision(sensor, most, most, arm=arm)
    own = {name: float(sensor.noise.deviation(name) or np.inf) ** -2 for name in sensor.quantities}
    places = [value for name, value in own.items() if name != "heading"]
    return Precision(sensor, max(places, default=0.0), own.get("heading", 0.0), arm=arm)


def unknown_start(sensors: Sequence[Sensor]) -> bool:
    """Whether shifting and turning the whole path costs nothing: no sensor knows where the drive began."""
    known = [sensor.start_known for sensor in sensors if sensor.start_known is not None]
    return bool(known) and all(entry == "unknown" for entry in known)


@dataclass(frozen=True)
class Motion:
    """How the motion can depend on parameters.

    Attributes:
        turned: change of the turn in a period per scaled parameter, where inputs are at corners of what they
            may be, (N, corners, p).
        moved: the same of the length.
        lengths: of the longest path at every sample, (N + 1,).
        across: the longest arm.
        period: [s].
    """

    turned: Array
    moved: Array
    lengths: Array
    across: float
    period: float

    def largest(self, factor: Array, precisions: Sequence[Precision], reference: int) -> float:
        """At least tr(Z F) for Z = U'U.

        Args:
            factor: U, (r, p).
            precisions: of the sensors.
            reference: sample whose pose counts as known.
        """
        samples = len(self.turned)
        turned, moved = np.abs(self.turned @ factor.T), np.abs(self.moved @ factor.T)
        turns = np.linalg.norm(turned, axis=2).max(axis=1)
        so_far, every = np.concatenate([[0.0], np.cumsum(turns)]), np.arange(samples + 1)
        heading = np.abs(so_far - so_far[reference])
        chunks: list[Places] = np.array_split(every, samples // CHUNK + 1)
        place = np.concatenate([self._displaced(turned, moved, chunk, reference) for chunk in chunks])
        total = 0.0
        for one in precisions:
            read = one.sensor.columns(samples)
            if one.rate:
                total += one.rate * float(((turns[read] / self.period) ** 2).sum())
            else:
                total += one.position * float(((place + one.arm * heading)[read] ** 2).sum())
                total += one.heading * float((heading[read] ** 2).sum())
        return total

    def _displaced(self, turned: Array, moved: Array, samples: Places, reference: int) -> Array:
        # How far the positions at some samples can be displaced at most.
        periods = np.arange(len(turned))
        later = samples[:, None] > reference
        ends = np.where(later, self.lengths[:-1], self.lengths[1:])
        arms = np.minimum(np.abs(self.lengths[samples][:, None] - ends), self.across)
        between = np.where(
            later,
            (periods >= reference) & (periods < samples[:, None]),
            (periods < reference) & (periods >= samples[:, None]),
        )
        squares = [
            (moved[:, corner] ** 2).sum(axis=1)
            + 2 * arms * (moved[:, corner] * turned[:, corner]).sum(axis=1)
            + arms**2 * (turned[:, corner] ** 2).sum(axis=1)
            for corner in range(turned.shape[1])
        ]
        return np.asarray(np.where(between, np.sqrt(np.max(squares, axis=0)), 0.0).sum(axis=1))


def sensitivity_bounds(problem: Problem) -> Iterator[Bound]:
    """Bounds on tr(Z F) for every parameter alone, all together, and all but the size of the robot."""
    sensors = problem.measurement.joint_sensors if type(problem.criterion) is E else ()
    found = [precision(sensor) for sensor in sensors]
    precisions = [one for one in found if one is not None]
    if not precisions or len(precisions) < len(found) or len(problem.any_estimations) > 1:
        return
    (one,) = problem.any_estimations
    # Constants of sensors change readings without moving the pose, which nothing here bounds.
    if not set(one.judged) <= {parameter.name for parameter in problem.system.parameters}:
        return
    motion = _motion(problem, one)
    if motion is None or any(_reads_parameters(problem, sensor) for sensor in sensors):
        return
    reference = problem.design.samples // 2 if unknown_start(sensors) else 0
    known, count = prior_matrix(problem, one), len(one.judged)

    def bound(factor: Array) -> Bound:
        multiplier = factor.T @ factor
        value = motion.largest(factor, precisions, reference) + float(np.sum(multiplier * known))
        size = float(np.trace(multiplier))
        return Bound(value / size, METHOD, (SPEEDS, *_room(motion)), multiplier / size, one.block.name)

    each = [bound(row[None]) for row in np.eye(count)]
    yield from each
    sizes = np.array([single.value for single in each])
    if count < 2 or not (sizes > 0).all():
        return
    balanced = np.diag(sizes**-0.5)
    yield bound(balanced)
    grown = balanced @ (np.array([_nominal(one, name) for name in one.judged]) / one.scales)
    yield bound((np.eye(count) - np.outer(grown, grown) / float(grown @ grown)) @ balanced)


def _room(motion: Motion) -> tuple[str, ...]:
    return ("every position within the room",) if np.isfinite(motion.across) else ()


def _nominal(one: Estimation, name: str) -> float:
    return float(dict(zip(one.parameters, one.nominal, strict=True))[name])


def _motion(problem: Problem, one: Estimation) -> Motion | None:
    slopes, factor, speeds = _slopes(problem, one), grip(problem), top_speeds(problem)
    if slopes is None or factor is None or speeds is None:
        return None
    period, reach = problem.design.period, factor * input_reach(problem)
    # The other way round is as far.
    signs = np.array([(1.0, *rest) for rest in product((1.0, -1.0), repeat=reach.shape[1] - 1)])
    corners = period * reach[:, None, :] * signs
    lengths = np.concatenate([[0.0], np.cumsum(period * speeds)])
    bounds = room(problem)
    across = np.inf
    if bounds is not None:
        # Between samples an arc may bulge out of the room.
        across = float(np.hypot(bounds[1] - bounds[0], bounds[3] - bounds[2]) + period * speeds.max())
    return Motion(corners @ slopes[0], corners @ slopes[1], lengths, across, period)


def _slopes(problem: Problem, one: Estimation) -> tuple[Array, Array] | None:
    # Derivatives of yaw rate and forward speed by effective inputs and scaled parameters, (inputs, p) each;
    # None where these are not all that the parameters do.
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
        given = rng.uniform(low, high), nominal * rng.uniform(0.9, 1.1, len(nominal))
        off, slip, *_ = (np.array(part) for part in function(*given))
        if np.abs(off).max() > 1e-9 * np.abs(high).max() or slip.any():
            return None
    turn, forward = (np.array(part) for part in function(high, nominal)[2:])
    names = [entry.name for entry in robot.parameters]
    columns = [names.index(name) for name in one.judged]
    return turn[:, columns] * one.scales, forward[:, columns] * one.scales


def _reads_parameters(problem: Problem, sensor: Sensor) -> bool:
    # Whether what is read of a pose depends on parameters, with the pose itself as it is.
    if isinstance(sensor, YawRate):
        return False
    system = robot_of(problem.system)
    function, rng = moment_reading(sensor, system), np.random.default_rng(0)
    drawn = [rng.uniform(0.5, 1.5, function.size_in(place)) for place in range(6)]
    drawn[1] = np.zeros(function.size_in(1))
    drawn[3] = np.array(system.nominal)
    rows = np.array(function(*drawn)[1])[: len(system.parameters)]
    return bool(rows.any())
