"""Sensors: readings that depend on the drive as it truly was, and are estimated from together.

A sensor says what it reads at one moment, and how noisy that is. Its dependence on the parameters, the
initial pose and its own nuisances follows by the chain rule along the drive, for every robot alike.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from math import lcm
from typing import Annotated, ClassVar, Literal, Self

import casadi as ca
import numpy as np
import numpy.typing as npt
from pydantic import Field, model_validator

from oed.foundation.component import Component
from oed.foundation.errors import UserMistake
from oed.foundation.quantities import Angle, Length
from oed.foundation.text import count, given_text, listing, words
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.rollout import Drive
from oed.kernel.measurement.description import noise_text, when_text
from oed.kernel.measurement.measurement import Block, Cuts, Measurement, Nuisance
from oed.robots.models.model import Model

Array = npt.NDArray[np.float64]


class PosePrior(Component):
    """How well the initial pose is known beforehand: standard deviations [m, rad].

    `heading` is that of a trailer's angle as well; of a yaw rate that lags nothing is taken to be known.
    """

    position: Annotated[Length, Field(gt=0)]
    heading: Annotated[Angle, Field(gt=0)]


InitialPose = Literal["unknown", "known"] | PosePrior


class LeverArm(Component):
    """Where on the robot a sensor sits: ahead of its origin, and to the left [m].

    With `known: false` the place is estimated along; `deviation` is what is known of it beforehand.
    """

    x: Length = 0.0
    y: Length = 0.0
    known: bool = True
    deviation: Annotated[Length, Field(gt=0)] | None = None

    @model_validator(mode="after")
    def _deviation_of_what_is_unknown(self) -> LeverArm:
        if self.known and self.deviation is not None:
            raise ValueError("a deviation belongs to a lever arm that is estimated: add known: false")
        return self


@dataclass(frozen=True)
class Moment:
    """What a sensor may read at one time; expressions.

    Attributes:
        pose: (states,).
        inputs: held at that time, (inputs,).
        twist: forward and lateral speed [m/s], yaw rate [rad/s], (3,): of the motion at that instant, or the
            mean of the period.
        nuisances: the sensor's own, by the names it gave them.
    """

    pose: Expression
    inputs: Expression
    twist: Expression
    nuisances: Mapping[str, Expression]


MOST = 32
"""States and inputs of a moment at which nothing is known: at least as many as any robot has."""


class Sensor(Measurement):
    """One sensor of the drive as it is driven.

    Attributes:
        every: one reading every so many samples, from the first on.
    """

    when: ClassVar[Literal["at samples", "in periods"]] = "at samples"
    """Whether it reads at the N + 1 samples' instants, or something of each of the N periods between."""

    every: Annotated[int, Field(ge=1)] = 1

    @abstractmethod
    def reading(self, moment: Moment) -> Expression:
        """The noise-free reading (q,) at a moment."""

    @abstractmethod
    def whitening(self, moment: Moment) -> Expression:
        """A (q, q) with A R A' = 1, for the covariance R of one reading's noise."""

    @property
    def nuisances(self) -> tuple[Nuisance, ...]:
        """Constants of the sensor's own that are estimated along."""
        return ()

    @property
    def angles(self) -> tuple[int, ...]:
        """Which entries of a reading are angles, known up to full turns."""
        return ()

    @property
    def initial_pose_known(self) -> InitialPose | None:
        """What the sensor's owner knows of the initial pose; None for a sensor it does not concern."""
        return None

    @property
    def joint_whitening(self) -> Array | None:
        """The same as `whitening` for all readings together, where they are correlated over time."""
        return None

    def blocks(self, drive: Drive) -> tuple[Block, ...]:
        """One block: the robot's parameters, with the initial pose and the sensor's nuisances."""
        return (joint_block((self,), drive),)

    @property
    def joint_sensors(self) -> tuple[Sensor, ...]:
        """This one."""
        return (self,)

    def cuts(self, samples: int) -> Cuts | None:
        """Between any two readings."""
        return joint_cuts((self,))

    def coarser(self, times: float) -> Self | None:
        """One that reads at about the same times, or less often; None with one covariance of all readings."""
        if self.joint_whitening is not None:
            return None
        return self.model_copy(update={"every": max(1, round(self.every / times))})

    def columns(self, samples: int) -> list[int]:
        """Indices of the samples or periods that are read."""
        last = samples + 1 if self.when == "at samples" else samples
        return list(range(0, last, self.every))

    @property
    def subject(self) -> str:
        """What is read, in words."""
        return f"the {words(self.kind)}"

    @property
    def units(self) -> tuple[str, ...]:
        """SI units of a reading's entries; () where the sensor does not say."""
        return ()

    @property
    def noise_text(self) -> str:
        """The noise of one reading, in words."""
        whole = self.joint_whitening
        if whole is not None:
            return noise_text(ca.DM(whole), self.units * (len(whole) // max(1, len(self.units))))
        own = {nuisance.name: ca.SX.sym(nuisance.name) for nuisance in self.nuisances}
        pose, inputs, twist = (ca.SX.sym(name, MOST) for name in ("pose", "inputs", "twist"))
        return noise_text(self.whitening(Moment(pose, inputs, twist, own)), self.units)

    @property
    def remark(self) -> str:
        """What else there is to say of the readings, to follow their noise; "" for nothing."""
        return ""

    def brief(self, samples: int) -> str:
        """What is read on a drive of so many samples, and how often."""
        return f"{count(len(self.columns(samples)), 'reading')} of the {words(self.kind)}"

    def sentence(self, samples: int) -> str:
        """What is read on a drive of so many samples, when, how noisily and from where."""
        when = when_text("sample" if self.when == "at samples" else "period", self.every)
        times = count(len(self.columns(samples)), "time")
        return f"{self.subject} {when} ({times}) with {self.noise_text}{self.remark}"


class PlacedSensor(Sensor):
    """A sensor that follows a point of the robot.

    Attributes:
        initial_pose: "unknown" (eliminated), "known", or standard deviations known beforehand.
        lever_arm: where on the robot that point is.
    """

    initial_pose: InitialPose = "unknown"
    lever_arm: LeverArm = LeverArm()

    @property
    def initial_pose_known(self) -> InitialPose | None:
        """What is known of the initial pose."""
        return self.initial_pose

    @property
    def nuisances(self) -> tuple[Nuisance, ...]:
        """The lever arm's coordinates, where they are not known."""
        arm = self.lever_arm
        if arm.known:
            return ()
        return (
            Nuisance("lever_arm.x", arm.x, "m", arm.deviation),
            Nuisance("lever_arm.y", arm.y, "m", arm.deviation),
        )

    @property
    def remark(self) -> str:
        """Where the point is, unless it is the robot's origin."""
        sides = (
            (self.lever_arm.x, "ahead of", "behind"),
            (self.lever_arm.y, "to the left of", "to the right of"),
        )
        parts = [
            f"{given_text(abs(offset), 'm')} {plus if offset > 0 else minus}"
            for offset, plus, minus in sides
            if offset
        ]
        return f", taken {listing(parts)} the robot's origin" if parts else ""

    def position(self, moment: Moment) -> tuple[Expression, Expression]:
        """Where the point is: x, y [m]."""
        ahead = moment.nuisances.get("lever_arm.x", self.lever_arm.x)
        left = moment.nuisances.get("lever_arm.y", self.lever_arm.y)
        x, y, heading = moment.pose[0], moment.pose[1], moment.pose[2]
        cosine, sine = ca.cos(heading), ca.sin(heading)
        return x + ahead * cosine - left * sine, y + ahead * sine + left * cosine


@dataclass(frozen=True)
class Readings:
    """One sensor's readings of a drive, as expressions.

    Attributes:
        response: noise-free, (rows,), SI.
        jacobian: by (parameters, start state, the sensor's nuisances), (rows, columns).
        whitening: A of each reading, side by side, (q, K * q).
        white_response, white_jacobian: the same in units of the noise.
    """

    response: Expression
    jacobian: Expression
    whitening: Expression
    white_response: Expression
    white_jacobian: Expression


def readings(sensor: Sensor, drive: Drive) -> Readings:
    """What `sensor` reads of `drive`, its nuisances at their nominal values."""
    samples, runs = drive.samples, range(drive.runs)
    own = sensor.columns(samples)
    columns = [run * (samples + 1) + column for run in runs for column in own]
    # At the last sample's instant the inputs are those held until then.
    held = [run * samples + min(column, samples - 1) for run in runs for column in own]
    width = len(drive.model.parameters) + len(drive.model.states)
    stacked = [width * column + offset for column in columns for offset in range(width)]
    values = ca.DM([nuisance.nominal for nuisance in sensor.nuisances])
    count = len(columns)
    period = drive.period if sensor.when == "in periods" else 0.0
    each = moment_reading(sensor, drive.model).map(count)
    response, transposed, whitening, white_response, white_transposed = each(
        drive.poses.T[:, columns],
        drive.sensitivities[:, stacked],
        drive.inputs.T[:, held],
        ca.repmat(drive.parameters, 1, count),
        ca.repmat(ca.reshape(values, -1, 1), 1, count),
        ca.repmat(period, 1, count),
    )
    whole = whole_whitening(sensor, response.numel() // drive.runs)
    if whole is not None:
        weights = ca.diagcat(*[ca.DM(whole)] * drive.runs)
        white_response, white_transposed = weights @ ca.vec(response), transposed @ weights.T
    return Readings(
        ca.vec(response),
        _by_run(transposed, drive).T,
        whitening,
        ca.vec(white_response),
        _by_run(white_transposed, drive).T,
    )


def whole_whitening(sensor: Sensor, rows: int) -> Array | None:
    """`joint_whitening` of a run that gives so many numbers, (rows, rows).

    Raises:
        UserMistake: it is for another number.
    """
    whole = sensor.joint_whitening
    if whole is not None and len(whole) != rows:
        raise UserMistake(
            f"the covariance of all readings is for {len(whole)} of them; this drive gives {rows}"
        )
    return whole


def _by_run(transposed: Expression, drive: Drive) -> Expression:
    # Every run has a start state of its own: rows of derivatives by it, for the run's own readings.
    if drive.runs == 1:
        return transposed
    size, states = len(drive.model.parameters), len(drive.model.states)
    starts = ca.horzsplit(transposed[size : size + states, :], transposed.shape[1] // drive.runs)
    return ca.vertcat(transposed[:size, :], ca.diagcat(*starts), transposed[size + states :, :])


def row_times(
    sensors: Sequence[Sensor], model: Model, samples: int, runs: int
) -> list[tuple[str, int, float]]:
    """For every row of all sensors' readings its sensor's label, its run from 0, and its time in periods."""
    return [
        (label, run, column + (0.5 if sensor.when == "in periods" else 0.0))
        for sensor, label in zip(sensors, sensor_labels(sensors), strict=True)
        for run in range(runs)
        for column in sensor.columns(samples)
        for _ in range(moment_reading(sensor, model).size1_out(0))
    ]


@lru_cache(maxsize=64)
def moment_reading(sensor: Sensor, model: Model) -> ca.Function:
    """What a sensor reads at one moment, as a function of (pose, S, inputs, parameters, nuisances, period).

    S (states, p + states) are the pose's derivatives by parameters and start. The results are the reading
    (q,), its derivatives by these and the nuisances (columns, q), its whitening (q, q), and the first two in
    units of the noise.
    """
    states, size = len(model.states), len(model.parameters)
    pose, inputs = ca.SX.sym("pose", states), ca.SX.sym("inputs", len(model.inputs))
    parameters, own = ca.SX.sym("p", size), ca.SX.sym("nuisances", len(sensor.nuisances))
    period = ca.SX.sym("period")
    carried = ca.SX.sym("S", states, size + states)
    names = [nuisance.name for nuisance in sensor.nuisances]
    twist = model.mean_twist(pose, model.twist(inputs, parameters), parameters, period)
    moment = Moment(pose, inputs, twist, dict(zip(names, ca.vertsplit(own), strict=True)))
    reading, whitening = sensor.reading(moment), sensor.whitening(moment)
    direct = ca.horzcat(ca.jacobian(reading, parameters), ca.SX(reading.shape[0], states))
    through = ca.jacobian(reading, pose) @ carried + direct
    jacobian = ca.densify(ca.horzcat(through, ca.jacobian(reading, own)))
    return ca.Function(
        "reading",
        [pose, carried, inputs, parameters, own, period],
        [reading, jacobian.T, ca.densify(whitening), whitening @ reading, (whitening @ jacobian).T],
    )


@dataclass(frozen=True)
class JointReadings:
    """The readings of all sensors of a drive, one below the other.

    Attributes:
        each: sensor by sensor.
        nuisances: of all sensors, their names made unique.
    """

    each: tuple[Readings, ...]
    nuisances: tuple[Nuisance, ...]
    leading: int

    @property
    def white_jacobian(self) -> Expression:
        """By (parameters, start state, nuisances), in units of the noise, (M, columns)."""
        # Parameters and start are common to all sensors, the other columns are each sensor's own.
        matrices = [one.white_jacobian for one in self.each]
        widths = [matrix.shape[1] - self.leading for matrix in matrices]
        rows = []
        for index, matrix in enumerate(matrices):
            before, after = sum(widths[:index]), sum(widths[index + 1 :])
            count = matrix.shape[0]
            own = [ca.DM(count, before), matrix[:, self.leading :], ca.DM(count, after)]
            rows.append(ca.horzcat(matrix[:, : self.leading], *own))
        return ca.vertcat(*rows)


def joint_readings(sensors: Sequence[Sensor], drive: Drive) -> JointReadings:
    """What all sensors read of `drive`, their nuisances at nominal values."""
    each = tuple(readings(sensor, drive) for sensor in sensors)
    leading = len(drive.model.parameters) + drive.runs * len(drive.model.states)
    return JointReadings(each, labelled_nuisances(sensors), leading)


def labelled_nuisances(sensors: Sequence[Sensor]) -> tuple[Nuisance, ...]:
    """The sensors' own nuisances, their names made unique."""
    return tuple(
        replace(nuisance, name=f"{label}.{nuisance.name}")
        for sensor, label in zip(sensors, sensor_labels(sensors), strict=True)
        for nuisance in sensor.nuisances
    )


def joint_block(sensors: Sequence[Sensor], drive: Drive) -> Block:
    """The readings of all sensors as one estimation of the robot's parameters."""
    model = drive.model
    size = len(model.parameters)
    joint, start = joint_readings(sensors, drive), start_nuisances(sensors, model, drive.runs)
    nuisances = (*start, *joint.nuisances)
    # A start pose that is known is no unknown.
    own = list(range(joint.leading, joint.leading + len(joint.nuisances)))
    design = joint.white_jacobian[:, [*range(size + len(start)), *own]]
    known = [0.0] * size + [(nuisance.deviation or np.inf) ** -2 for nuisance in nuisances]
    matrix = design.T @ design + ca.diag(ca.DM(known))
    return Block(
        name="joint",
        parameters=tuple(parameter.name for parameter in model.parameters),
        nominal=np.array(model.nominal, dtype=float),
        units=tuple(parameter.unit for parameter in model.parameters),
        response=ca.vertcat(*(one.white_response for one in joint.each)),
        design_matrix=design[:, :size],
        jacobian=design,
        information=lambda chosen: matrix[list(chosen), list(chosen)],
        noise=1.0,
        nuisances=nuisances,
        sizes=np.array([parameter.scale for parameter in model.parameters]),
    )


def joint_cuts(sensors: Sequence[Sensor]) -> Cuts | None:
    """How drives can be cut where all sensors read; None where the noise of one is correlated over time."""
    if any(sensor.joint_whitening is not None for sensor in sensors):
        return None
    return Cuts(multiple=lcm(*(sensor.every for sensor in sensors)))


def start_nuisances(sensors: Sequence[Sensor], model: Model, runs: int = 1) -> tuple[Nuisance, ...]:
    """The initial poses' coordinates, run by run, that are estimated along; () where they are known or do
    not matter.
    """
    known = [sensor.initial_pose_known for sensor in sensors if sensor.initial_pose_known is not None]
    if not known or known[0] == "known":
        return ()
    prior = known[0] if isinstance(known[0], PosePrior) else None
    deviations = {} if prior is None else {"m": prior.position, "rad": prior.heading}
    return tuple(
        Nuisance(f"initial_pose{f'_{run + 1}' if runs > 1 else ''}.{state}", 0.0, unit, deviations.get(unit))
        for run in range(runs)
        for state, unit in zip(model.states, model.state_units, strict=True)
    )


def sensor_labels(sensors: Sequence[Sensor]) -> list[str]:
    """A name for each sensor: its kind, numbered from the second of a kind on."""
    labels: list[str] = []
    for index, sensor in enumerate(sensors):
        before = sum(other.kind == sensor.kind for other in sensors[:index])
        labels.append(f"{sensor.kind}_{before + 1}" if before else sensor.kind)
    return labels
