"""Sensors: readings that depend on the drive as it truly was, and are estimated from together.

A sensor says what it reads at one moment, and how noisy that is. Its dependence on the parameters, the
start state and its own nuisances follows by the chain rule along the drive, for every system alike.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from math import inf, isfinite, lcm
from typing import Annotated, Any, ClassVar, Literal, Self, TypeVar, cast

import casadi as ca
import numpy as np
from pydantic import Field

from oed.foundation.arrays import Array, block_columns
from oed.foundation.errors import UserMistake
from oed.foundation.text import count, words
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.rollout import Drive
from oed.kernel.dynamics.system import System
from oed.kernel.measurement.description import deviations_of, noise_text, when_text
from oed.kernel.measurement.filter_rows import memories_of
from oed.kernel.measurement.innovations import innovations
from oed.kernel.measurement.measurement import Block, Cuts, Measurement, Nuisance
from oed.kernel.measurement.moment import AnyMoment, moment_reading
from oed.kernel.measurement.moment import Moment as Moment
from oed.kernel.measurement.process_noise import ProcessNoise, process_noise_of

Start = Literal["unknown", "known"] | Mapping[str, float]
"""What is known of the start states: nothing, all, or standard deviations by their names or units, infinite
where nothing is known.
"""
FRAME = 1e-3
"""Standard deviation of start states that define the frame, SI. Its size is of no matter: readings that do
not depend on the frame say the same of all else."""


When = Literal["at samples", "in periods", "between samples"]
"""Whether a sensor reads at the N + 1 samples' instants, something of each of the N periods between, or of
two of the instants together."""


class Sensor(Measurement):
    """One sensor of the drive as it is driven.

    Attributes:
        every: one reading every so many samples, from the first on; between samples, from each of these to
            the next.
    """

    when: ClassVar[When] = "at samples"
    continuous: ClassVar[bool] = False
    """Whether it reads all the time, and the reading of a period is that of all its time."""

    every: Annotated[int, Field(ge=1)] = 1

    @abstractmethod
    def reading(self, moment: Moment) -> Expression:
        """The noise-free reading (q,) at a moment."""

    @abstractmethod
    def whitening(self, moment: Moment) -> Expression:
        """A (q, q) with A R A' = 1, for the covariance R of one reading's noise."""

    @property
    def nuisances(self) -> tuple[Nuisance, ...]:
        """Constants of the sensor's own that are nuisance parameters."""
        return ()

    @property
    def angles(self) -> tuple[int, ...]:
        """Which entries of a reading are angles, known up to full turns."""
        return ()

    @property
    def wrapping(self) -> tuple[int, ...]:
        """Which of the angles jump by full turns as they are predicted: directions from the robot do."""
        return ()

    @property
    def gauge(self) -> tuple[str, ...]:
        """Start states of the first run that define the frame, for nothing that is seen has a place known
        beforehand; () where something has.
        """
        return ()

    @property
    def start_known(self) -> Start | None:
        """What its owner knows of the start states; None for a sensor they do not concern."""
        return None

    @property
    def joint_whitening(self) -> Array | None:
        """A with A R A' = 1 for the covariance R of all readings together; None where none are correlated."""
        return None

    @property
    def process_noise(self) -> ProcessNoise | None:
        """What its owner says of the system's own noise, which readings do not average away; or None."""
        return None

    def steady(self) -> Sensor:
        """This sensor of a system without noise of its own."""
        return self

    def blocks(self, drive: Drive) -> tuple[Block, ...]:
        """One block: the system's parameters, with the start states and the sensor's nuisances."""
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
        """Indices of the samples or periods that are read; between samples, of those that readings end at."""
        last = samples if self.when == "in periods" else samples + 1
        return list(range(self.every if self.when == "between samples" else 0, last, self.every))

    def instants(self, samples: int) -> list[list[int]]:
        """For each moment of a reading these indices; that at which it ends comes first."""
        columns = self.columns(samples)
        earlier = [column - self.every for column in columns]
        return [columns, earlier] if self.when == "between samples" else [columns]

    @property
    def subject(self) -> str:
        """What is read, in words."""
        return f"the {words(self.kind)}"

    @property
    def units(self) -> tuple[str, ...]:
        """SI units of a reading's entries; () where the sensor does not say."""
        return ()

    def units_of(self, system: System) -> tuple[str, ...]:
        """SI units of a reading's entries where it is of that system; `units` by default."""
        return self.units

    @property
    def entries(self) -> tuple[str, ...]:
        """What tells the entries of a reading apart: `.quantity`, `[which]` or both; () where nobody says."""
        return ("",) if len(self.units) == 1 else tuple(f".{place + 1}" for place in range(len(self.units)))

    @property
    def deviations(self) -> tuple[float, ...]:
        """Standard deviations of a reading's entries, SI, where they depend on nothing; else ()."""
        own = {nuisance.name: ca.SX.sym(nuisance.name) for nuisance in self.nuisances}
        return deviations_of(self.whitening(cast(Moment, AnyMoment(own))))

    @property
    def noise_text(self) -> str:
        """The noise of one reading, in words."""
        whole = self.joint_whitening
        if whole is not None:
            return noise_text(ca.DM(whole), self.units * (len(whole) // max(1, len(self.units))))
        own = {nuisance.name: ca.SX.sym(nuisance.name) for nuisance in self.nuisances}
        return noise_text(self.whitening(cast(Moment, AnyMoment(own))), self.units)

    @property
    def remark(self) -> str:
        """What else there is to say of the readings, to follow their noise; "" for nothing."""
        return ""

    def brief(self, samples: int) -> str:
        """What is read on a drive of so many samples, and how often."""
        return f"{count(len(self.columns(samples)), 'reading')} of the {words(self.kind)}"

    def sentence(self, samples: int) -> str:
        """What is read on a drive of so many samples, when, how noisily and from where."""
        when = when_text("period" if self.when == "in periods" else "sample", self.every)
        times = count(len(self.columns(samples)), "time")
        return f"{self.subject} {when} ({times}) with {self.noise_text}{self.remark}"


def readings(sensor: Sensor, drive: Drive) -> tuple[Expression, Expression]:
    """What `sensor` reads of `drive`, its nuisances at their nominal values, in units of the noise: (rows,),
    and the derivatives by (parameters, start states, its nuisances), (rows, columns).
    """
    samples, runs = drive.samples, range(drive.runs)
    states, sensitivities, inputs = list[Expression](), list[Expression](), list[Expression]()
    for own in sensor.instants(samples):
        columns = [run * (samples + 1) + column for run in runs for column in own]
        # At the last sample's instant the inputs are those held until then.
        held = [run * samples + min(column, samples - 1) for run in runs for column in own]
        states.append(drive.states.T[:, columns])
        sensitivities.append(drive.sensitivities[:, block_columns(np.array(columns), drive.columns)])
        inputs.append(drive.inputs.T[:, held])
    each = moment_reading(sensor, drive.system).map(states[0].shape[1])
    response, transposed, _, white_response, white_transposed = each(
        ca.vertcat(*states),
        ca.vertcat(*sensitivities),
        ca.vertcat(*inputs),
        drive.parameters,
        ca.DM([nuisance.nominal for nuisance in sensor.nuisances]),
        {"at samples": 0.0, "in periods": 1.0, "between samples": sensor.every}[sensor.when] * drive.period,
    )
    whole = whole_whitening(sensor, response.numel() // drive.runs)
    if whole is not None:
        weights = ca.diagcat(*[ca.DM(whole)] * drive.runs)
        white_response, white_transposed = weights @ ca.vec(response), transposed @ weights.T
    return ca.vec(white_response), _by_run(white_transposed, drive).T


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
    size, states = len(drive.system.parameters), len(drive.system.states)
    starts = ca.horzsplit(transposed[size : size + states, :], transposed.shape[1] // drive.runs)
    return ca.vertcat(transposed[:size, :], ca.diagcat(*starts), transposed[size + states :, :])


def row_times(
    sensors: Sequence[Sensor], system: System, samples: int, runs: int
) -> list[tuple[str, int, float]]:
    """For every row of all sensors' readings its sensor's label, its run from 0, and its time in periods.

    Args:
        sensors: that read.
        system: that is driven.
        samples: of each run.
        runs: how many.
    """
    return [
        (label, run, column + (0.5 if sensor.when == "in periods" else 0.0))
        for sensor, label in zip(sensors, sensor_labels(sensors), strict=True)
        for rows in [moment_reading(sensor, system).size1_out(0)]
        for run in range(runs)
        for column in sensor.columns(samples)
        for _ in range(rows)
    ]


def joint_readings(sensors: Sequence[Sensor], drive: Drive) -> tuple[Sequence[Expression], Expression]:
    """What all sensors read of `drive`, their nuisances at nominal values, in units of the noise: of each
    (rows,), and the derivatives of all by (parameters, start states, nuisances), (M, columns).
    """
    found, jacobians = zip(*(readings(sensor, drive) for sensor in sensors), strict=True)
    # Parameters and start are common to all sensors, the other columns are each sensor's own.
    common = len(drive.system.parameters) + drive.runs * len(drive.system.states)
    shared, own = zip(*(ca.horzsplit(one, [0, common, one.shape[1]]) for one in jacobians), strict=True)
    return found, ca.horzcat(ca.vertcat(*shared), ca.diagcat(*own))


def labelled_nuisances(sensors: Sequence[Sensor]) -> tuple[Nuisance, ...]:
    """The sensors' own nuisances, their names made unique."""
    return tuple(
        replace(nuisance, name=f"{label}.{nuisance.name}")
        for sensor, label in zip(sensors, sensor_labels(sensors), strict=True)
        for nuisance in sensor.nuisances
    )


def constants_of(sensors: Sequence[Sensor]) -> dict[str, Nuisance]:
    """The sensors' own nuisances by the names that `estimate` may ask for them by: with the sensor's label,
    and without it where that is clear.
    """
    found = labelled_nuisances(sensors)
    short = [one.name.partition(".")[2] for one in found]
    clear = {name: one for name, one in zip(short, found, strict=True) if short.count(name) == 1}
    return {**{one.name: one for one in found}, **clear}


def joint_block(sensors: Sequence[Sensor], drive: Drive) -> Block:
    """The readings of all sensors as one estimation of the system's parameters."""
    system = drive.system
    size = len(system.parameters)
    each, jacobian = joint_readings(sensors, drive)
    noise = process_noise_of(sensors)
    if noise is not None:
        # Readings share what the process did before them: their innovations do not.
        jacobian = innovations(sensors, drive, noise)
    start, own = start_nuisances(sensors, system, drive.runs), labelled_nuisances(sensors)
    nuisances, columns = (*start, *own), jacobian.shape[1]
    # A start that is known is no unknown.
    design = jacobian[:, [*range(size + len(start)), *range(columns - len(own), columns)]]
    known = [0.0] * size + [(nuisance.deviation or np.inf) ** -2 for nuisance in nuisances]
    matrix = design.T @ design + ca.diag(ca.DM(known))
    return Block(
        name="joint",
        parameters=tuple(parameter.name for parameter in system.parameters),
        nominal=np.array(system.nominal, dtype=float),
        units=tuple(parameter.unit for parameter in system.parameters),
        response=ca.vertcat(*each),
        design_matrix=design[:, :size],
        jacobian=design,
        information=lambda chosen: matrix[list(chosen), list(chosen)],
        noise=1.0,
        nuisances=nuisances,
        sizes=np.array([parameter.scale for parameter in system.parameters]),
    )


def joint_cuts(sensors: Sequence[Sensor]) -> Cuts | None:
    """How drives can be cut where all sensors read; None where the noise of one is correlated over time, or
    one reads across several samples that no filter goes through.
    """
    if any(sensor.joint_whitening is not None for sensor in sensors):
        return None
    if process_noise_of(sensors) is None and memories_of(sensors):
        return None
    return Cuts(multiple=lcm(*(sensor.every for sensor in sensors)))


def start_nuisances(sensors: Sequence[Sensor], system: System, runs: int = 1) -> tuple[Nuisance, ...]:
    """The start states, run by run, that are nuisances; () where they are known or do not matter.

    Args:
        sensors: which say what is known of the start.
        system: whose states they are.
        runs: each with a start of its own.
    """
    placed = [sensor for sensor in sensors if sensor.start_known is not None]
    if not placed or placed[0].start_known == "known":
        return ()
    deviations = placed[0].start_known if isinstance(placed[0].start_known, Mapping) else {}
    frame = set.intersection(*(set(sensor.gauge) for sensor in placed))
    return tuple(
        Nuisance(
            f"{system.start_name}{f'_{run + 1}' if runs > 1 else ''}.{state}",
            0.0,
            unit,
            FRAME if state in frame and not run else _deviation(deviations, state, unit),
        )
        for run in range(runs)
        for state, unit in zip(system.states, system.state_units, strict=True)
    )


def _deviation(deviations: Mapping[str, float], state: str, unit: str) -> float | None:
    found = deviations.get(state, deviations.get(unit, inf))
    return found if isfinite(found) else None


def sensor_labels(sensors: Sequence[Sensor]) -> list[str]:
    """A name for each sensor: its kind, numbered from the second of a kind on."""
    labels: list[str] = []
    for index, sensor in enumerate(sensors):
        before = sum(other.kind == sensor.kind for other in sensors[:index])
        labels.append(f"{sensor.kind}_{before + 1}" if before else sensor.kind)
    return labels


Kind = TypeVar("Kind", bound=Measurement)
_joining: dict[type[Any], Callable[..., Measurement]] = {}
# What joins sensors knows every one of its domain: it stands on a higher floor, and enters here.


def joins(sort: type[Any]) -> Callable[[type[Kind]], type[Kind]]:
    """Marks the measurement of several sensors of a sort, whose field `sensors` they are."""

    def entered(kind: type[Kind]) -> type[Kind]:
        _joining[sort] = kind
        return kind

    return entered


def joined(sensors: Sequence[Sensor]) -> Measurement:
    """The measurement of several sensors, by the narrowest sort that all are of.

    Raises:
        TypeError: no domain with such a measurement has been loaded.
    """
    fitting = [sort for sort in _joining if all(isinstance(one, sort) for one in sensors)]
    if not fitting:
        raise TypeError("no measurement of several sensors like these has been loaded")
    return _joining[max(fitting, key=lambda sort: len(sort.__mro__))](sensors=tuple(sensors))
