"""One sample of a drive: where it leads, what it gathers, and the derivatives of both.

The formulas are those of every drive, applied to a drive of a single sample.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.rollout import Drive
from oed.kernel.measurement.filter import Filter, filter_of, memories_of, reads_of
from oed.kernel.measurement.measurement import Cuts
from oed.kernel.measurement.readings import joint_readings
from oed.kernel.measurement.sensor import process_noise_of
from oed.kernel.measurement.update import Update
from oed.kernel.problem import Problem
from oed.optimize.terms.blocks import Packed
from oed.optimize.terms.carry import Carry
from oed.optimize.terms.instants import InstantRows
from oed.optimize.terms.matrices import upper_half
from oed.optimize.terms.small_drives import small_drive

FEW = 8
"""Numbers read in a period up to which derivatives are shorter by what each of them changes."""


class SampleCell:
    """A sample as a function of the state x handed on to it and of its inputs, in units of their scale.

    x is the robot's state, followed by the entries that change of its derivatives by (parameters, start of
    the piece). A sample gathers what is read at its first instant; the last instant belongs to the next one.

    Attributes:
        states: number of the robot's states.
        width: length of x.
        carry: rule by which sensitivities are handed on.
    """

    def __init__(self, problem: Problem, scale: Sequence[float]) -> None:
        """Write the sample."""
        robot, self.states = problem.system, len(problem.system.states)
        self._state, self._inputs = ca.SX.sym("state", self.states), ca.SX.sym("inputs", len(robot.inputs))
        sensors = problem.sensors
        self._reads = ca.SX.sym("reads", len(sensors) + len(memories_of(sensors)))
        drive = small_drive(problem, (ca.DM(list(scale)) * self._inputs).T, self._state)
        following, added = self._carried_on(problem, drive)
        self.width = self.states + len(self.carry.moving)
        self._lifted = ca.cse([ca.vertcat(drive.states[-1, :].T, following), added])
        self._parts: list[Expression] = ca.cse(self._written_out(self._lifted))
        self._begin = ca.vertcat(self._state, self.carry.carried)
        self._arguments = [self._begin, self._inputs, self._reads]
        self._unknowns = ca.vertcat(self._begin, self._inputs)

    def _carried_on(self, problem: Problem, drive: Drive) -> tuple[Expression, Expression]:
        # What sensitivities become, and the information added; of a filter by its update's symbols, unless it
        # takes in many readings: what they gather is of one size, however many they are.
        self._update: Update | None = None
        if problem.process_noise is None or _many(_filtering(problem)):
            self.carry = carry_of(problem, ca.densify(_gathered(problem, drive, self._reads)))
            return self.carry.following, self.carry.added
        step = _FilterStep(problem, drive, self._reads)
        self.carry = carry_of(problem, remembered=step.remembered, step=step)
        self._update = step.updated(*self.carry.belief)
        return self.carry.entries(*step.moved(self._update, self._update.named, self.carry.belief[0]))

    def _written_out(self, expressions: list[Expression]) -> list[Expression]:
        # Without symbols of the update.
        return expressions if self._update is None else self._update.written_out(expressions)

    @property
    def gathered(self) -> Expression:
        """Entries of the information (SX)."""
        return self._parts[1]

    @cached_property
    def values(self) -> ca.Function:
        """(x, inputs, which sensors read) -> x at the end, what is gathered."""
        return ca.Function("cell", self._arguments, [ca.densify(part) for part in self._parts])

    def scored(self, instants: InstantRows, times: Sequence[float]) -> ca.Function:
        """(x, inputs, which sensors read) -> x at the end, what is gathered, the most by which limits on
        instants are exceeded at those times, each in shares of its size.

        Args:
            instants: rows of the limits.
            times: times since the sample's begin [s].
        """
        variables = ca.vertcat(self._state, self._inputs, *([self._inputs] if instants.asking else []))
        excess = [instants.exceeded(instants.all_rows(variables, time)) for time in times]
        table = ca.horzcat(*excess)
        rows_by_limit = [np.flatnonzero(instants.owner == place).tolist() for place in instants.limits]
        worst = [ca.mmax(table[rows, :]) for rows in rows_by_limit]
        results = [*self._parts, ca.vertcat(ca.SX(0, 1), *worst)]
        return ca.Function("cell", self._arguments, ca.cse([ca.densify(part) for part in results]))

    @cached_property
    def _slopes(self) -> list[Expression]:
        # Of both parts; with an update, then of all that is bent where that is not some of the unknowns.
        update, unknowns = self._update, self._unknowns
        if update is None:
            return list(ca.cse([ca.jacobian(part, unknowns) for part in self._lifted]))
        entries, changes = update.slopes(unknowns)
        parts = [
            ca.jacobian(part, unknowns) + ca.jacobian(part, update.symbols) @ entries for part in self._lifted
        ]
        bent = ca.vertcat(ca.SX.eye(unknowns.shape[0]), entries, changes)
        return list(ca.cse(update.written_out([*parts, bent[self.bent, :], bent[self.half_bent, :]])))

    @cached_property
    def slopes(self) -> list[Packed]:
        """Derivatives of x at the end and of what is gathered by (x, inputs)."""
        return [Packed(part) for part in self._slopes[:2]]

    @cached_property
    def bent_slopes(self) -> list[Packed]:
        """Derivatives of `bent` and `half_bent` by (x, inputs); [] where these are x and inputs alone."""
        return [Packed(part) for part in self._slopes[2:]]

    @cached_property
    def jacobian(self) -> ca.Function:
        """(x, inputs, which sensors read) -> entries of the slopes."""
        return ca.Function("cell_slopes", self._arguments, [packed.entries for packed in self.slopes])

    @cached_property
    def bent_jacobian(self) -> ca.Function:
        """(x, inputs, which sensors read) -> entries of `bent_slopes`."""
        return ca.Function("bent_slopes", self._arguments, [packed.entries for packed in self.bent_slopes])

    @cached_property
    def _bending(self) -> tuple[list[Expression], Expression]:
        weights = [ca.SX.sym("weights", part.shape[0]) for part in self._parts]
        weighted = sum(ca.dot(weight, part) for weight, part in zip(weights, self._lifted, strict=True))
        update, unknowns = self._update, self._unknowns
        if update is None:
            matrix, _ = ca.hessian(weighted, unknowns)
            return weights, ca.cse(matrix)
        matrix, slope = ca.hessian(weighted, ca.vertcat(unknowns, update.symbols))
        more, further = update.curvature(slope[unknowns.shape[0] :], unknowns)
        matrix += ca.diagcat(more, ca.SX(*[update.symbols.shape[0]] * 2))
        return weights, ca.cse(*update.written_out([ca.diagcat(matrix, further)]))

    @cached_property
    def bent(self) -> list[int]:
        """Places in (x, inputs, changed by the update, its changes) that enter not only linearly, without
        `half_bent`.
        """
        places = set(self._bending[1].sparsity().row())
        return sorted(places - set(self.half_bent))

    @cached_property
    def half_bent(self) -> list[int]:
        """Places changed by the update that are bent with others alone, not with each other."""
        if self._update is None:
            return []
        first, matrix = self._unknowns.shape[0], self._bending[1]
        among = range(first, first + self._update.symbols.shape[0])
        places = [place for place in among if matrix[place, :].nnz()]
        return [] if matrix[places, among.start :].nnz() else places

    @cached_property
    def inner(self) -> list[Packed]:
        """Second derivatives of the weighted sum by what is bent; with an update matrices (bent, bent) and
        (half_bent, bent) that with their transposes make up those.
        """
        matrix = self._bending[1]
        if self._update is None:
            return [Packed(matrix[self.bent, self.bent])]
        lower = ca.tril(matrix[self.bent, self.bent])
        return [Packed(lower - ca.diag(ca.diag(lower)) / 2), Packed(matrix[self.half_bent, self.bent])]

    @cached_property
    def curvature(self) -> ca.Function:
        """(x, inputs, which sensors read, weights of both parts) -> entries of `inner`."""
        return ca.Function(
            "cell_curvature", [*self._arguments, *self._bending[0]], [packed.entries for packed in self.inner]
        )


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


def read_end(problem: Problem, held: Expression, state: Expression) -> Expression:
    """Return the information of the readings at a run's last instant, (entries,).

    Args:
        problem: problem with the measurement.
        held: inputs until then, (inputs,).
        state: state at that instant, (states,).
    """
    sensors = problem.sensors
    reads: list[float] = reads_of(sensors, problem.design.samples)[: len(sensors), -1].tolist()
    if process_noise_of(sensors) is not None:
        drive = small_drive(problem, held.T, state)
        used = _filtering(problem)
        state, *rest = _sample_arguments(drive)
        belief = _known_begin(used), used.remembering(state)
        # Where nothing follows no memory begins.
        now = ca.DM([*reads, *[0.0] * len(used.memories)])
        rows = used.period(*belief[0], belief[1], *rest, now)[2][:, _columns(problem, used)]
        return upper_half(rows.T @ rows)
    return upper_half(_read(problem, small_drive(problem, held.T, state), ca.DM(reads)))


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
