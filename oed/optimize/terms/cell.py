"""One sample of a drive: where it leads, what it gathers, its limit rows, and their derivatives.

The formulas are those of every drive, applied to a drive of a single sample.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import casadi as ca

from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.rollout import Drive
from oed.kernel.limit import Limit, Rows
from oed.kernel.measurement.innovations import Filter, filter_of
from oed.kernel.measurement.measurement import Cuts
from oed.kernel.measurement.process_noise import process_noise_of
from oed.kernel.measurement.sensor import joint_readings
from oed.kernel.problem import Problem
from oed.optimize.terms.base import small_drive, upper_half
from oed.optimize.terms.blocks import Packed, pull
from oed.optimize.terms.carry import Carry
from oed.optimize.terms.needs import Asked


class Cell:
    """A sample as a function of the state x handed on to it and of its inputs, in units of their scale.

    x is the robot's state, followed by the entries that change of its derivatives by (parameters, start of
    the piece). A sample gathers what is read at its first instant; the last instant belongs to the next one.

    Attributes:
        states: of the robot.
        width: of x.
        carry: how the sensitivities are handed on.
        limits: those on instants.
        asked: how each of them is asked.
        rows: of each of them.
        scale: what an input of 1 stands for, (inputs,).
    """

    def __init__(
        self,
        problem: Problem,
        limits: Sequence[tuple[Limit, Asked]],
        scale: Sequence[float],
        refine: int = 1,
    ) -> None:
        """Write the sample; its path is limited at `refine` points."""
        robot, self.states = problem.system, len(problem.system.states)
        self.limits, self.asked = [limit for limit, _ in limits], [asked for _, asked in limits]
        self._state, self._inputs = ca.SX.sym("state", self.states), ca.SX.sym("inputs", len(robot.inputs))
        sensors = problem.measurement.joint_sensors
        self.scale = tuple(scale)
        self._reads = ca.SX.sym("reads", len(sensors))
        drive = small_drive(problem, (ca.DM(list(scale)) * self._inputs).T, self._state, refine)
        self.carry = carry_of(problem, ca.densify(_gathered(problem, drive, self._reads)))
        self.width = self.states + len(self.carry.moving)
        self.rows = [limit.rows(replace(drive, path=drive.path[1:, :])) for limit in self.limits]
        following = ca.vertcat(drive.states[-1, :].T, self.carry.following)
        rows = ca.vertcat(ca.SX(0, 1), *(ca.densify(one.expression) for one in self.rows))
        self._parts: list[Expression] = ca.cse([following, self.carry.added, rows])
        self._begin = ca.vertcat(self._state, self.carry.carried)
        self._arguments = [self._begin, self._inputs, self._reads]

    @property
    def gathered(self) -> Expression:
        """Entries of the information (SX)."""
        return self._parts[1]

    @property
    def row_count(self) -> int:
        """Limit rows."""
        return int(self._parts[2].shape[0])

    @cached_property
    def step(self) -> ca.Function:
        """(state, inputs) -> next state."""
        return ca.Function("step", [self._state, self._inputs], [self._parts[0][: self.states]])

    @cached_property
    def values(self) -> ca.Function:
        """(x, inputs, which sensors read) -> x at the end, what is gathered, limit rows."""
        return ca.Function("cell", self._arguments, self._parts)

    @cached_property
    def slopes(self) -> list[Packed]:
        """Derivatives of the same three by (x, inputs)."""
        unknowns = ca.vertcat(self._begin, self._inputs)
        return [Packed(part) for part in ca.cse([ca.jacobian(part, unknowns) for part in self._parts])]

    @cached_property
    def jacobian(self) -> ca.Function:
        """(x, inputs, which sensors read) -> entries of the slopes."""
        return ca.Function("cell_slopes", self._arguments, [one.entries for one in self.slopes])

    @cached_property
    def pull(self) -> ca.Function:
        """(entries of the slopes of what is gathered and of the rows, weights of both) -> weights of x."""
        return pull(self.slopes[1], self.slopes[2], self.width)

    @cached_property
    def _bending(self) -> tuple[list[Expression], Expression]:
        weights = [ca.SX.sym("weights", part.shape[0]) for part in self._parts]
        weighted = sum(ca.dot(weight, part) for weight, part in zip(weights, self._parts, strict=True))
        whole, _ = ca.hessian(weighted, ca.vertcat(self._begin, self._inputs))
        return weights, ca.cse(whole)

    @cached_property
    def bent(self) -> list[int]:
        """Which of (x, inputs) enter anything but linearly."""
        return sorted(set(self._bending[1].sparsity().row()))

    @cached_property
    def inner(self) -> Packed:
        """Second derivatives of the weighted sum by those."""
        return Packed(self._bending[1][self.bent, self.bent])

    @cached_property
    def curvature(self) -> ca.Function:
        """(x, inputs, which sensors read, weights of the three) -> entries of `inner`."""
        return ca.Function("cell_curvature", [*self._arguments, *self._bending[0]], [self.inner.entries])

    @cached_property
    def depends(self) -> tuple[ca.Sparsity, ca.Sparsity]:
        """Which of (end state, rows) depend on the state, and on the inputs."""
        both = ca.vertcat(self._parts[0][: self.states], self._parts[2])
        return ca.jacobian_sparsity(both, self._state), ca.jacobian_sparsity(both, self._inputs)

    @cached_property
    def linear(self) -> list[bool]:
        """Whether each limit's rows are linear in the inputs, and moved by nothing else."""
        return [self._linear(asked, rows) for asked, rows in zip(self.asked, self.rows, strict=True)]

    def _linear(self, asked: Asked, rows: Rows) -> bool:
        expression = ca.densify(rows.expression)
        if asked.first or ca.depends_on(expression, self._state):
            return False
        return not any(ca.which_depends(expression, self._inputs, 2, True))


def carry_of(problem: Problem, gathered: Expression, *, started: bool = True) -> Carry:
    """How sensitivities go through a part of a problem's drives.

    Args:
        problem: whose drives.
        gathered: by the part.
        started: whether the runs' starts are estimated as well.
    """
    sensors = problem.measurement.joint_sensors
    return Carry(
        gathered,
        states=len(problem.system.states),
        parameters=len(estimated(problem)) if sensors else 0,
        nuisances=sum(len(sensor.nuisances) for sensor in sensors),
        started=started,
        drifting=process_noise_of(sensors) is not None,
    )


def estimated(problem: Problem) -> list[int]:
    """Places of the estimated parameters among the robot's, of a problem with sensors."""
    (estimation,) = problem.any_estimations
    return sorted(estimation.block.parameters.index(name) for name in estimation.parameters)


def read_end(problem: Problem, held: Expression, state: Expression) -> Expression:
    """Information of the readings at a run's last instant, in a state, `held` (inputs,) until then.

    Args:
        problem: that measures.
        held: inputs until then, (inputs,).
        state: at that instant, (states,).
    """
    sensors = problem.measurement.joint_sensors
    reads = ca.DM([1.0 if sensor.when == "at samples" else 0.0 for sensor in sensors])
    if process_noise_of(sensors) is not None:
        drive = small_drive(problem, held.T, state)
        used = _filtering(problem)
        rows = used.last(*_known(used), *_given(drive), reads)[:, _columns(problem, used)]
        return upper_half(rows.T @ rows)
    return upper_half(_read(problem, small_drive(problem, held.T, state), reads))


def cuts_of(problem: Problem) -> Cuts:
    """How drives of a problem are cut into pieces, of one whose drives can be."""
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


def _filtering(problem: Problem) -> Filter:
    # Of sensors that read whenever they are asked to.
    sensors = [sensor.model_copy(update={"every": 1}) for sensor in problem.measurement.joint_sensors]
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
