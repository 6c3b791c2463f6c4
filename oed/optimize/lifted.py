"""Readings and durations chosen together with inputs: as further inputs, in the search alone.

Roots v = sqrt(w) of the readings' weights, for with these sum v^2 J' R^-1 J is smooth and budgets are sums of
v^2; and the share of the longest duration that an experiment takes.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.rollout import Drive
from oed.kernel.dynamics.signals import Constant, PiecewiseConstant, Signal
from oed.kernel.dynamics.space import SignalSpace, Spline
from oed.kernel.dynamics.system import Input, Parameter, System
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.limit import Limit, Rows
from oed.kernel.measurement.blocks import Nuisance
from oed.kernel.measurement.measurement import Sensor, Start, When, joined
from oed.kernel.measurement.moment import Moment
from oed.kernel.measurement.process_noise import Period, ProcessNoise
from oed.kernel.pace import PACE, pace_of
from oed.kernel.problem import Problem
from oed.kernel.repetitions import EFFORT
from oed.kernel.scorer import score
from oed.kernel.solution import Solution


@dataclass(frozen=True)
class Lifted(System):
    """A system with further inputs: some that it does not feel, and the pace at which it goes through time.

    Attributes:
        inner: the system.
        efforts: how many inputs follow its own.
        paced: whether the last input, after these, is the share of the longest duration that it takes.
    """

    inner: System
    efforts: int
    paced: bool

    inputs = property(
        lambda self: (
            *self.inner.inputs,
            *(Input(f"{EFFORT}{place}", f"{EFFORT}{place}", "") for place in range(self.efforts)),
            *([Input(PACE, PACE, "")] if self.paced else []),
        )
    )
    states = property(lambda self: self.inner.states)
    state_units = property(lambda self: self.inner.state_units)
    start_name = property(lambda self: self.inner.start_name)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Those of the system."""
        return self.inner.parameters

    def step(
        self, state: Expression, inputs: Expression, parameters: Expression, period: Expression
    ) -> Expression:
        """As the system steps."""
        own = inputs[: len(self.inner.inputs), :]
        return self.inner.step(state, own, parameters, self.taken(inputs, period))

    def signals(
        self, state: Expression, inputs: Expression, parameters: Expression, period: Expression
    ) -> Mapping[str, Expression]:
        """Those of the system."""
        own = inputs[: len(self.inner.inputs), :]
        return self.inner.signals(state, own, parameters, self.taken(inputs, period))

    def taken(self, inputs: Expression, period: Expression) -> Expression:
        """How long the period is at this pace [s].

        Args:
            inputs: held in it, these further ones too.
            period: its duration at full length [s].
        """
        return period * inputs[len(self.inputs) - 1] if self.paced else period

    def estimating(self, names: Collection[str]) -> System:
        """The system that has the parameters, with the same inputs."""
        return replace(self, inner=self.inner.estimating(names))

    @property
    def exact(self) -> System:
        """That of the system: what is predicted has inputs of its own."""
        return self.inner.exact

    @property
    def estimable(self) -> Mapping[str, tuple[str, ...]]:
        """As the system says."""
        return self.inner.estimable

    @property
    def chosen_states(self) -> int:
        """As the system says."""
        return self.inner.chosen_states


@dataclass(frozen=True)
class LiftedNoise(ProcessNoise):
    """Process noise of a system with further inputs: for as long as a period takes.

    Attributes:
        inner: of the system.
    """

    inner: ProcessNoise
    signal = property(lambda self: self.inner.signal)

    @property
    def size(self) -> int:
        """As the system's."""
        return self.inner.size

    @property
    def text(self) -> str:
        """As the system's."""
        return self.inner.text

    def covariance(self, period: Period) -> Expression:
        """As the system's."""
        return self.inner.covariance(_unlifted(period))

    def step(self, period: Period, errors: Expression) -> Expression:
        """As the system's."""
        return self.inner.step(_unlifted(period), errors)


def _unlifted(period: Period) -> Period:
    # What the system itself knows.
    system, state, inputs, parameters, duration = period
    assert isinstance(system, Lifted)
    own = inputs[: len(system.inner.inputs), :]
    return Period(system.inner, state, own, parameters, system.taken(inputs, duration))


class LiftedSensor(Sensor):
    """A sensor whose readings count as much as the square of an input says, and as long as another says.

    Attributes:
        inner: the sensor.
        own: how many inputs the sensor knows.
        effort: place of the root of its weight among the inputs; None where all readings count alike.
        pace: place of the share of the longest duration; None where the duration is given.
    """

    kind: str = "lifted"
    inner: Sensor
    own: int
    effort: int | None = None
    pace: int | None = None

    continuous = property(lambda self: self.inner.continuous)

    @property
    def when(self) -> When:  # type: ignore[override]
        """As the sensor."""
        return self.inner.when

    @property
    def nuisances(self) -> tuple[Nuisance, ...]:
        """Those of the sensor."""
        return self.inner.nuisances

    @property
    def start_known(self) -> Start | None:
        """What its owner knows of the start states."""
        return self.inner.start_known

    @property
    def process_noise(self) -> ProcessNoise | None:
        """What its owner says, of the system with further inputs."""
        noise = self.inner.process_noise
        return None if noise is None else LiftedNoise(noise)

    def reading(self, moment: Moment) -> Expression:
        """That of the sensor."""
        return self.inner.reading(replace(moment, inputs=moment.inputs[: self.own, :]))

    def whitening(self, moment: Moment) -> Expression:
        """That of the sensor, times the root of the weight, and of how long a period is."""
        found = self.inner.whitening(replace(moment, inputs=moment.inputs[: self.own, :]))
        if self.pace is not None and self.inner.continuous:
            found = ca.sqrt(moment.inputs[self.pace]) * found
        return found if self.effort is None else moment.inputs[self.effort] * found


class FurtherRange(Limit):
    """A further input between two values.

    Attributes:
        input: its name.
        low, high: the values.
    """

    looks_at: ClassVar[Any] = "inputs"
    input: str
    low: float
    high: float

    @property
    def name(self) -> str:  # type: ignore[override]
        """That of the input."""
        return self.input

    def rows(self, drive: Drive) -> Rows:
        """The input in every period."""
        column = drive.input_values[:, drive.system.input_names.index(self.input)]
        count = column.shape[0]
        return Rows(column, np.full(count, self.low), np.full(count, self.high), self.high, "")

    def input_bounds(self, system: System) -> dict[str, tuple[float, float]]:
        """Of this input alone."""
        return {self.input: (self.low, self.high)}


class EffortTotal(Limit):
    """A budget: the sum of squares of some inputs, each period's times its size.

    Attributes:
        label: name of the budget.
        sizes: size of every period's reading at the longest duration, by the inputs' names; 0 where nothing
            is read.
        timed: names of those inputs whose readings are as large as they are long.
        total: sum that may be spent.
    """

    looks_at: ClassVar[Any] = "run"
    label: str
    sizes: tuple[tuple[str, tuple[float, ...]], ...]
    timed: tuple[str, ...] = ()
    total: float

    @property
    def name(self) -> str:  # type: ignore[override]
        """That of the budget."""
        return self.label

    def rows(self, drive: Drive) -> Rows:
        """One row: what is spent of the total."""
        names = drive.system.input_names
        spent: Expression = 0.0
        for name, sizes in self.sizes:
            pace = pace_of(drive) if name in self.timed else 1.0
            spent += ca.dot(ca.DM(sizes), pace * drive.inputs[:, names.index(name)] ** 2)
        return Rows(spent / self.total, np.array([-np.inf]), np.array([1.0]), 1.0, "")


def lifted(problem: Problem) -> Problem | None:
    """The problem whose inputs are the inputs, roots of the weights, and the pace; None where nothing is
    chosen together with inputs.

    Weights are chosen for trajectories that are found without them where trials are weighted as a whole, and
    in spaces of splines.
    """
    space, sensors = problem.design, problem.measurement.joint_sensors
    # A system without inputs has no signals, and start states to be chosen with the readings.
    if not isinstance(space, SignalSpace) or (problem.model.inputs and not space.signals):
        return None
    if problem.robust is not None:
        return None
    weighted, paced = _weighted(problem), space.shortest is not None
    if not weighted and not paced:
        return None
    own, efforts = len(problem.model.inputs), len(sensors) if weighted else 0
    inner = [
        LiftedSensor(
            inner=one,
            own=own,
            effort=own + place if weighted else None,
            pace=own + efforts if paced else None,
            every=one.every,
        )
        for place, one in enumerate(sensors)
    ]
    limits, signals = _further(problem, efforts)
    return replace(
        problem,
        model=Lifted(problem.model, efforts, paced),
        design=space.model_copy(
            update={"signals": (*space.signals, *signals), "spline": Spline(), "shortest": None}
        ),
        measurement=inner[0] if len(inner) == 1 else joined(inner),
        limits=(*problem.limits, *limits),
        selection=None,
    )


def _weighted(problem: Problem) -> bool:
    selection = problem.selection
    between = any(one.when == "between samples" for one in problem.measurement.joint_sensors)
    return selection is not None and selection.of == "readings" and not between


def _further(problem: Problem, efforts: int) -> tuple[list[Limit], list[Signal]]:
    # Limits on the further inputs, and what they may be over a run.
    limits, signals = list[Limit](), list[Signal]()
    selection, space = problem.selection, problem.design
    if efforts and selection is not None:
        most = float(np.sqrt(selection.most))
        names = [f"{EFFORT}{place}" for place in range(efforts)]
        limits += [FurtherRange(input=name, low=0.0, high=most) for name in names]
        limits += _totals(problem)
        signals += [PiecewiseConstant(pieces=selection.pieces or space.samples) for _ in names]
    if isinstance(space, SignalSpace) and space.shortest is not None:
        limits.append(FurtherRange(input=PACE, low=space.shortest / space.duration, high=1.0))
        signals.append(Constant(shared=True))
    return limits, signals


def _totals(problem: Problem) -> list[EffortTotal]:
    selection = problem.selection
    assert selection is not None
    parts = selection.parts_of(problem.measurement.joint_sensors, problem.system, problem.design)
    labels = list(dict.fromkeys(one.sensor for one in parts.readings))
    sensors = problem.measurement.joint_sensors
    timed = tuple(f"{EFFORT}{place}" for place, sensor in enumerate(sensors) if sensor.continuous)
    found = []
    for number, budget in enumerate(selection.budgets(parts)):
        here = {parts.readings[place].sensor for place in budget.places}
        sizes = [
            (f"{EFFORT}{place}", _sizes(problem, place))
            for place, label in enumerate(labels)
            if label in here
        ]
        label = f"budget_{number}"
        found.append(EffortTotal(label=label, sizes=tuple(sizes), timed=timed, total=budget.total))
    return found


def _sizes(problem: Problem, place: int) -> tuple[float, ...]:
    # How much of a budget the readings of a sensor are, period by period of all runs.
    sensor, space = problem.measurement.joint_sensors[place], problem.design
    held = np.minimum(sensor.columns(space.samples), space.samples - 1)
    each = np.bincount(held, minlength=space.samples) * (space.period if sensor.continuous else 1.0)
    return tuple(np.tile(each, space.runs).tolist())


def lowered(problem: Problem, solution: Solution) -> Solution:
    """A solution of the lifted problem as one of the problem itself, its weights left to be chosen."""
    if solution.trajectory is None:
        return replace(solution, problem=problem)
    trajectory = _own(problem, solution.trajectory)
    return replace(solution, trajectory=trajectory, evaluation=score(problem, trajectory), problem=problem)


def _own(problem: Problem, trajectory: Trajectory) -> Trajectory:
    own, space = len(problem.model.inputs), problem.design
    table: Array = trajectory.coefficients[:, :own]
    paced = isinstance(space, SignalSpace) and space.shortest is not None
    share = float(trajectory.coefficients[0, -1]) if paced else 1.0
    return replace(trajectory, knots=share * trajectory.knots, coefficients=table)
