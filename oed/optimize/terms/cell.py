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
from oed.kernel.measurement.filter_rows import memories_of, reads_of
from oed.kernel.measurement.innovations import Filter, filter_of
from oed.kernel.measurement.joint import cuts_of as measurement_cuts
from oed.kernel.measurement.measurement import Cuts, process_noise_of
from oed.kernel.measurement.readings import joint_readings
from oed.kernel.measurement.update import Update
from oed.kernel.problem import Problem
from oed.optimize.terms.blocks import Packed
from oed.optimize.terms.carry import Carry
from oed.optimize.terms.instants import InstantRows
from oed.optimize.terms.matrices import upper_half
from oed.optimize.terms.small_drives import small_drive

FEW = 8
"""Numbers read in a period up to which derivatives are shorter by what each of them changes."""


class Cell:
    """A sample as a function of the state x handed on to it and of its inputs, in units of their scale.

    x is the robot's state, followed by the entries that change of its derivatives by (parameters, start of
    the piece). A sample gathers what is read at its first instant; the last instant belongs to the next one.

    Attributes:
        states: of the robot.
        width: of x.
        carry: how the sensitivities are handed on.
        scale: what an input of 1 stands for, (inputs,).
    """

    def __init__(self, problem: Problem, scale: Sequence[float]) -> None:
        """Write the sample."""
        robot, self.states = problem.system, len(problem.system.states)
        self._state, self._inputs = ca.SX.sym("state", self.states), ca.SX.sym("inputs", len(robot.inputs))
        sensors = problem.measurement.joint_sensors
        self.scale = tuple(scale)
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
        if process_noise_of(problem.measurement.joint_sensors) is None or _many(_filtering(problem)):
            self.carry = carry_of(problem, ca.densify(_gathered(problem, drive, self._reads)))
            return self.carry.following, self.carry.added
        step = _Step(problem, drive, self._reads)
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
            times: since the sample's begin [s].
        """
        given = ca.vertcat(self._state, self._inputs, *([self._inputs] if instants.asking else []))
        found = [instants.exceeded(instants.all_rows(given, time)) for time in times]
        table = ca.horzcat(*found)
        own = [np.flatnonzero(instants.owner == place).tolist() for place in instants.limits]
        each = [ca.mmax(table[rows, :]) for rows in own]
        results = [*self._parts, ca.vertcat(ca.SX(0, 1), *each)]
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
        return list(ca.cse(update.written_out([*parts, bent[self.bent, :], bent[self.beside, :]])))

    @cached_property
    def slopes(self) -> list[Packed]:
        """Derivatives of the same two by (x, inputs)."""
        return [Packed(part) for part in self._slopes[:2]]

    @cached_property
    def bent_slopes(self) -> list[Packed]:
        """Derivatives of what is `bent` and `beside` by (x, inputs); [] where it is some of these."""
        return [Packed(part) for part in self._slopes[2:]]

    @cached_property
    def jacobian(self) -> ca.Function:
        """(x, inputs, which sensors read) -> entries of the slopes."""
        return ca.Function("cell_slopes", self._arguments, [one.entries for one in self.slopes])

    @cached_property
    def bent_jacobian(self) -> ca.Function:
        """(x, inputs, which sensors read) -> entries of `bent_slopes`."""
        return ca.Function("bent_slopes", self._arguments, [one.entries for one in self.bent_slopes])

    @cached_property
    def _bending(self) -> tuple[list[Expression], Expression]:
        weights = [ca.SX.sym("weights", part.shape[0]) for part in self._parts]
        weighted = sum(ca.dot(weight, part) for weight, part in zip(weights, self._lifted, strict=True))
        update, unknowns = self._update, self._unknowns
        if update is None:
            whole, _ = ca.hessian(weighted, unknowns)
            return weights, ca.cse(whole)
        whole, slope = ca.hessian(weighted, ca.vertcat(unknowns, update.symbols))
        more, own = update.curvature(slope[unknowns.shape[0] :], unknowns)
        whole += ca.diagcat(more, ca.SX(*[update.symbols.shape[0]] * 2))
        return weights, ca.cse(*update.written_out([ca.diagcat(whole, own)]))

    @cached_property
    def bent(self) -> list[int]:
        """Which of (x, inputs, what the update changes, its changes) enter anything but linearly, but for
        those `beside`.
        """
        found = set(self._bending[1].sparsity().row())
        return sorted(found - set(self.beside))

    @cached_property
    def beside(self) -> list[int]:
        """Those of what the update changes that are bent with others alone, not with each other."""
        if self._update is None:
            return []
        first, whole = self._unknowns.shape[0], self._bending[1]
        among = range(first, first + self._update.symbols.shape[0])
        found = [place for place in among if whole[place, :].nnz()]
        return [] if whole[found, among.start :].nnz() else found

    @cached_property
    def inner(self) -> list[Packed]:
        """Second derivatives of the weighted sum by what is bent; with an update matrices (bent, bent) and
        (beside, bent) that with their transposes make up those.
        """
        whole = self._bending[1]
        if self._update is None:
            return [Packed(whole[self.bent, self.bent])]
        own = ca.tril(whole[self.bent, self.bent])
        return [Packed(own - ca.diag(ca.diag(own)) / 2), Packed(whole[self.beside, self.bent])]

    @cached_property
    def curvature(self) -> ca.Function:
        """(x, inputs, which sensors read, weights of both parts) -> entries of `inner`."""
        return ca.Function(
            "cell_curvature", [*self._arguments, *self._bending[0]], [one.entries for one in self.inner]
        )


class _Step:
    # How a filter goes through a sample.

    def __init__(self, problem: Problem, drive: Drive, reads: Expression) -> None:
        self._filter, self._reads = _filtering(problem), reads
        self._columns = _columns(problem, self._filter)
        self._state, *self._held = _given(drive)
        self.remembered = self._filter.states - self._state.shape[0]

    def __call__(self, table: Expression, spread: Expression) -> tuple[Expression, Expression, Expression]:
        # From S and P to both at the end, and information.
        update = self.updated(table, spread)
        return self.moved(update, update.after, table)

    def updated(self, table: Expression, spread: Expression) -> Update:
        # What readings make of them.
        slopes = table[:, : len(self._columns)]
        return self._filter.update((slopes, spread), self._given(table), self._reads, self._columns)

    def moved(
        self, update: Update, after: Expression, table: Expression
    ) -> tuple[Expression, Expression, Expression]:
        # What is left, at the end; what is remembered lasts.
        given = self._given(table)
        *left, information = update.parts(after)
        slopes, spread = self._filter.moved(left, given, self._columns)
        if self.remembered:
            own = self._state.shape[0]
            values = ca.vertcat(ca.SX(own, 1), given[0][own:])
            slopes = ca.horzcat(slopes, values)
        return slopes, spread, information

    def _given(self, table: Expression) -> list[Expression]:
        # States, with those remembered from now on, inputs, parameters, period.
        if not self.remembered:
            return [self._state, *self._held]
        values = table[self._state.shape[0] :, len(self._columns)]
        return [self._filter.begun(ca.vertcat(self._state, values), self._reads), *self._held]


def carry_of(problem: Problem, gathered: Expression | None = None, **options: Any) -> Carry:
    """How sensitivities go through a part of a problem's drives.

    Args:
        problem: whose drives.
        gathered: by the part, where it says how.
        options: `remembered` and `step` of `Carry`.
    """
    sensors = problem.measurement.joint_sensors
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
    """Information of the readings at a run's last instant, in a state, `held` (inputs,) until then.

    Args:
        problem: that measures.
        held: inputs until then, (inputs,).
        state: at that instant, (states,).
    """
    sensors = problem.measurement.joint_sensors
    reads: list[float] = reads_of(sensors, problem.design.samples)[: len(sensors), -1].tolist()
    if process_noise_of(sensors) is not None:
        drive = small_drive(problem, held.T, state)
        used = _filtering(problem)
        state, *rest = _given(drive)
        known = _known(used), used.remembering(state)
        # Where nothing follows no memory begins.
        now = ca.DM([*reads, *[0.0] * len(used.memories)])
        rows = used.last(*known[0], known[1], *rest, now)[:, _columns(problem, used)]
        return upper_half(rows.T @ rows)
    return upper_half(_read(problem, small_drive(problem, held.T, state), ca.DM(reads)))


def cuts_of(problem: Problem) -> Cuts:
    """How the information of a problem's drives adds up, of one where it does."""
    cuts = measurement_cuts(problem.measurement, problem.design.samples)
    assert cuts is not None
    return cuts


def _gathered(problem: Problem, drive: Drive, reads: Expression) -> Expression:
    # Sensitivities and information on (parameters, start, nuisances), or of a regression its rows. A segment
    # of one sample is added as its square at once.
    cuts = cuts_of(problem)
    if cuts.regression is not None:
        blocks = cuts.regression.blocks(drive)
        if cuts.segment > 1:
            return ca.vertcat(*(ca.vec(ca.densify(one.design_matrix)) for one in blocks))
        return ca.vertcat(*(upper_half(one.design_matrix.T @ one.design_matrix) for one in blocks))
    if process_noise_of(problem.measurement.joint_sensors) is not None:
        used = _filtering(problem)
        columns = _columns(problem, used)
        slopes, covariance, rows = used.period(*_known(used), *_given(drive), reads)
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
        for sensor in problem.measurement.joint_sensors
    ]
    noise = process_noise_of(sensors)
    assert noise is not None
    return filter_of(tuple(sensors), problem.system, noise)


def _given(drive: Drive) -> tuple[Expression, ...]:
    # State, inputs, parameters and period of a sample.
    return drive.states[0, :].T, drive.inputs[0, :].T, drive.parameters, drive.period


def _known(used: Filter) -> tuple[Expression, ...]:
    # What a filter begins with where the state is known.
    return tuple(map(ca.SX, used.begin))


def _columns(problem: Problem, used: Filter) -> list[int]:
    # Estimated parameters, start, nuisances.
    return [*estimated(problem), *range(used.size, used.width)]


def _read(problem: Problem, drive: Drive, reads: Expression) -> Expression:
    # Information of what those sensors read at the first instant of a drive of one sample.
    sensors = [sensor.model_copy(update={"every": 1}) for sensor in problem.measurement.joint_sensors]
    each, jacobian = joint_readings(sensors, drive)
    chosen = [*estimated(problem), *range(len(problem.system.parameters), jacobian.shape[1])]
    total, first = ca.SX(len(chosen), len(chosen)), 0
    for place, (sensor, one) in enumerate(zip(sensors, each, strict=True)):
        rows = range(first, first + one.shape[0] // len(sensor.columns(1)))
        own = ca.sparsify(jacobian[list(rows), chosen])
        total += reads[place] * (own.T @ own)
        first += one.shape[0]
    return ca.densify(total)
