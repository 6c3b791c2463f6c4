"""One sample of a drive with sensors or a regression: what it adds to the information.

The formulas are those of every drive, applied to a drive of a single sample. A sample adds what is read at
its first instant; the last instant belongs to the next one.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.rollout import Drive
from oed.kernel.measurement.filter import Filter, filter_of, memories_of, reads_of
from oed.kernel.measurement.measurement import Cuts
from oed.kernel.measurement.readings import joint_readings
from oed.kernel.measurement.sensor import process_noise_of
from oed.kernel.measurement.update import Update
from oed.kernel.problem import Problem
from oed.optimize.terms.carry import Carry
from oed.optimize.terms.cell import Cell
from oed.optimize.terms.matrices import symmetric, upper_half
from oed.optimize.terms.small_drives import small_drive

FEW = 8
"""Numbers read in a period up to which derivatives are shorter by what each of them changes."""


class SampleCell(Cell):
    """A sample that adds to the information; the constants say which sensors read in it.

    x is the system's state, followed by the entries that change of its derivatives by (parameters, start of
    the run), and of a filter's covariance.

    Attributes:
        carry: rule by which sensitivities are handed on.
    """

    def __init__(self, problem: Problem, scale: Array, *, varied: bool = False) -> None:
        """Write the sample.

        Args:
            problem: problem with the measurement.
            scale: what an input of 1 stands for, (inputs,).
            varied: parameters are further constants, behind what says which sensors read; else they are
                nominal.
        """
        system, sensors = problem.system, problem.sensors
        state, inputs = ca.SX.sym("state", len(system.states)), ca.SX.sym("inputs", len(system.inputs))
        reads = ca.SX.sym("reads", len(sensors) + len(memories_of(sensors)))
        parameters = ca.SX.sym("p", len(system.parameters) if varied else 0)
        drive = small_drive(problem, (ca.DM(scale) * inputs).T, state, parameters if varied else None)
        # Of a filter by its update's symbols, unless it takes in many readings: what they gather is of one
        # size, however many they are.
        update: Update | None = None
        if process_noise_of(sensors) is None or _many(_filtering(problem)):
            self.carry = carry_of(problem, ca.densify(_gathered(problem, drive, reads)))
            following, added = self.carry.following, self.carry.added
        else:
            step = _FilterStep(problem, drive, reads)
            self.carry = carry_of(problem, remembered=step.remembered, step=step)
            update = step.updated(*self.carry.belief)
            following, added = self.carry.entries(*step.moved(update, update.named, self.carry.belief[0]))
        super().__init__(
            [ca.vertcat(state, self.carry.carried), inputs, ca.vertcat(reads, parameters)],
            [ca.vertcat(drive.states[-1, :].T, following), added],
            states=len(system.states),
            begin=np.array(self.carry.begin, dtype=float).ravel(),
            update=update,
        )


def read_at_end(
    problem: Problem, cell: SampleCell, scale: Array, *, varied: bool = False
) -> list[Expression]:
    """Return what is read at a run's last instant: (x there, inputs held until then), constants, and the
    entries added to the information (SX).

    Args:
        problem: problem with sensors.
        cell: sample whose x it is.
        scale: what an input of 1 stands for, (inputs,).
        varied: parameters are constants; else they are nominal.
    """
    system = problem.system
    x, held = ca.SX.sym("x", cell.width), ca.SX.sym("held", len(system.inputs))
    parameters = ca.SX.sym("p", len(system.parameters) if varied else 0)
    drive = small_drive(problem, (ca.DM(scale) * held).T, x[: cell.states], parameters if varied else None)
    matrix = symmetric(_read_last(problem, drive), cell.carry.gathered_size)
    added = cell.carry.at_end(matrix, x[cell.states :])
    return [ca.vertcat(x, held), parameters, ca.cse(added)]


class _FilterStep:
    # How a filter goes through a sample.

    def __init__(self, problem: Problem, drive: Drive, reads: Expression) -> None:
        self._filter, self._reads = _filtering(problem), reads
        self._columns = _columns(problem, self._filter)
        self._state, *self._held = _sample_arguments(drive)
        self.remembered = self._filter.states - self._state.shape[0]

    def __call__(self, table: Expression, spread: Expression) -> tuple[Expression, Expression, Expression]:
        # From S and P to both at the end, and information.
        update = self.updated(table, spread)
        return self.moved(update, update.after, table)

    def updated(self, table: Expression, spread: Expression) -> Update:
        # What readings make of them.
        slopes = table[:, : len(self._columns)]
        return self._filter.update(
            (slopes, spread), self._sample_arguments(table), self._reads, self._columns
        )

    def moved(
        self, update: Update, after: Expression, table: Expression
    ) -> tuple[Expression, Expression, Expression]:
        # What is left, at the end; what is remembered lasts.
        arguments = self._sample_arguments(table)
        *belief, information = update.parts(after)
        slopes, spread = self._filter.moved(belief, arguments, self._columns)
        if self.remembered:
            states = self._state.shape[0]
            values = ca.vertcat(ca.SX(states, 1), arguments[0][states:])
            slopes = ca.horzcat(slopes, values)
        return slopes, spread, information

    def _sample_arguments(self, table: Expression) -> list[Expression]:
        # States, with those remembered from now on, inputs, parameters, period.
        if not self.remembered:
            return [self._state, *self._held]
        values = table[self._state.shape[0] :, len(self._columns)]
        return [self._filter.begun(ca.vertcat(self._state, values), self._reads), *self._held]


def carry_of(problem: Problem, gathered: Expression | None = None, **options: Any) -> Carry:
    """Return the rule by which sensitivities go through a part of a problem's drives.

    Args:
        problem: problem with the drives.
        gathered: expression of what the part gathers, if it says how.
        options: `remembered` and `step` of `Carry`.
    """
    sensors = problem.sensors
    return Carry(
        ca.SX(0, 1) if gathered is None else gathered,
        states=len(problem.system.states),
        parameters=len(estimated(problem)) if sensors else 0,
        nuisances=sum(len(sensor.nuisances) for sensor in sensors),
        drifting=process_noise_of(sensors) is not None,
        **options,
    )


def estimated(problem: Problem) -> list[int]:
    """Places of the estimated parameters among the robot's, of a problem with sensors."""
    (estimation,) = problem.any_estimations
    names = [parameter.name for parameter in problem.system.parameters]
    return sorted(names.index(name) for name in estimation.parameters if name not in problem.constants)


def _read_last(problem: Problem, drive: Drive) -> Expression:
    # Information of the readings at the first instant of a drive of one sample, if that is a run's last one.
    sensors = problem.sensors
    reads: list[float] = reads_of(sensors, problem.design.samples)[: len(sensors), -1].tolist()
    if process_noise_of(sensors) is not None:
        used = _filtering(problem)
        state, *rest = _sample_arguments(drive)
        belief = _known_begin(used), used.remembering(state)
        # Where nothing follows no memory begins.
        now = ca.DM([*reads, *[0.0] * len(used.memories)])
        rows = used.period(*belief[0], belief[1], *rest, now)[2][:, _columns(problem, used)]
        return upper_half(rows.T @ rows)
    return upper_half(_read(problem, drive, ca.DM(reads)))


def cuts_of(problem: Problem) -> Cuts:
    """Return the rule by which the information of a problem's drives adds up, if it does."""
    cuts = problem.measurement.cuts(problem.design.samples)
    assert cuts is not None
    return cuts


def _gathered(problem: Problem, drive: Drive, reads: Expression) -> Expression:
    # Sensitivities and information on (parameters, start, nuisances), or of a regression its rows. A segment
    # of one sample is added as its square at once.
    cuts = cuts_of(problem)
    if cuts.regression is not None:
        blocks = cuts.regression.blocks(drive)
        if cuts.segment > 1:
            return ca.vertcat(*(ca.vec(ca.densify(block.jacobian)) for block in blocks))
        return ca.vertcat(*(upper_half(block.jacobian.T @ block.jacobian) for block in blocks))
    if problem.process_noise is not None:
        used = _filtering(problem)
        columns = _columns(problem, used)
        slopes, covariance, rows = used.period(*_known_begin(used), *_sample_arguments(drive), reads)
        slopes, rows = slopes[:, columns], rows[:, columns]
        return ca.vertcat(ca.vec(slopes), upper_half(covariance), upper_half(rows.T @ rows))
    count, states = len(problem.system.parameters), len(problem.system.states)
    columns = [*estimated(problem), *range(count, count + states)]
    last = ca.densify(drive.sensitivities[:, -(count + states) :])
    return ca.vertcat(ca.vec(last[:, columns]), upper_half(_read(problem, drive, reads)))


def _many(used: Filter) -> bool:
    # Whether a period has so many readings; not of what lasts for several, which is gathered in no period.
    return not used.memories and sum(used.rows) > FEW


def _filtering(problem: Problem) -> Filter:
    # Of sensors that read whenever they are asked to; those between samples read of as many as they do.
    sensors = [
        sensor if sensor.when == "between samples" else sensor.model_copy(update={"every": 1})
        for sensor in problem.sensors
    ]
    noise = process_noise_of(sensors)
    assert noise is not None
    return filter_of(tuple(sensors), problem.system, noise)


def _sample_arguments(drive: Drive) -> tuple[Expression, ...]:
    # State, inputs, parameters and period of a sample.
    return drive.states[0, :].T, drive.inputs[0, :].T, drive.parameters, drive.period


def _known_begin(used: Filter) -> tuple[Expression, ...]:
    # What a filter begins with where the state is known.
    return tuple(map(ca.SX, used.begin))


def _columns(problem: Problem, used: Filter) -> list[int]:
    # Estimated parameters, start, nuisances.
    return [*estimated(problem), *range(used.size, used.width)]


def _read(problem: Problem, drive: Drive, reads: Expression) -> Expression:
    # Information of what those sensors read at the first instant of a drive of one sample.
    sensors = [sensor.model_copy(update={"every": 1}) for sensor in problem.sensors]
    readings, jacobian = joint_readings(sensors, drive)
    chosen = [*estimated(problem), *range(len(problem.system.parameters), jacobian.shape[1])]
    total, first = ca.SX(len(chosen), len(chosen)), 0
    for place, (sensor, reading) in enumerate(zip(sensors, readings, strict=True)):
        rows = range(first, first + reading.shape[0] // len(sensor.columns(1)))
        slopes = ca.sparsify(jacobian[list(rows), chosen])
        total += reads[place] * (slopes.T @ slopes)
        first += reading.shape[0]
    return ca.densify(total)
