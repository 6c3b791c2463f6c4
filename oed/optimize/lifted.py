"""Inputs and readings chosen together: roots of the readings' weights as further inputs.

With v = sqrt(w) the readings' whitening is smooth, sum v^2 J' R^-1 J, and budgets are sums of v^2.
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
from oed.kernel.dynamics.signals import PiecewiseConstant
from oed.kernel.dynamics.space import SignalSpace
from oed.kernel.dynamics.system import Input, Parameter, System
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.limit import Limit, Rows
from oed.kernel.measurement.measurement import Nuisance
from oed.kernel.measurement.sensor import Moment, Sensor, Start, When, joined
from oed.kernel.problem import Problem
from oed.kernel.solution import Solution

EFFORT = "effort_"
"""What names of roots of weights begin with; the number of their sensor follows."""


@dataclass(frozen=True)
class WithEfforts(System):
    """A system with inputs that it does not feel.

    Attributes:
        inner: the system.
        count: how many inputs follow its own.
    """

    inner: System
    count: int

    inputs = property(
        lambda self: (
            *self.inner.inputs,
            *(Input(f"{EFFORT}{place}", f"{EFFORT}{place}", "") for place in range(self.count)),
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
        return self.inner.step(state, inputs[: len(self.inner.inputs)], parameters, period)

    def signals(
        self, state: Expression, inputs: Expression, parameters: Expression, period: Expression
    ) -> Mapping[str, Expression]:
        """Those of the system."""
        return self.inner.signals(state, inputs[: len(self.inner.inputs)], parameters, period)

    def estimating(self, names: Collection[str]) -> System:
        """The system that has the parameters, with the same inputs."""
        return replace(self, inner=self.inner.estimating(names))

    @property
    def estimable(self) -> Mapping[str, tuple[str, ...]]:
        """As the system says."""
        return self.inner.estimable

    @property
    def chosen_states(self) -> int:
        """As the system says."""
        return self.inner.chosen_states


class WeighedSensor(Sensor):
    """A sensor whose readings count as much as the square of an input says.

    Attributes:
        inner: the sensor.
        place: of the input among all.
        own: how many inputs the sensor knows.
    """

    kind: str = "weighed"
    inner: Sensor
    place: int
    own: int

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

    def reading(self, moment: Moment) -> Expression:
        """That of the sensor."""
        return self.inner.reading(replace(moment, inputs=moment.inputs[: self.own]))

    def whitening(self, moment: Moment) -> Expression:
        """That of the sensor, times the root of the weight."""
        inner = self.inner.whitening(replace(moment, inputs=moment.inputs[: self.own]))
        return moment.inputs[self.place] * inner


class EffortRange(Limit):
    """A root of weights between 0 and that of the most.

    Attributes:
        input: its name.
        most: largest weight.
    """

    looks_at: ClassVar[Any] = "inputs"
    input: str
    most: float

    @property
    def name(self) -> str:  # type: ignore[override]
        """That of the input."""
        return self.input

    def rows(self, drive: Drive) -> Rows:
        """The input in every period."""
        column = drive.input_values[:, drive.system.input_names.index(self.input)]
        count, most = column.shape[0], float(np.sqrt(self.most))
        return Rows(column, np.zeros(count), np.full(count, most), most, "")

    def input_bounds(self, system: System) -> dict[str, tuple[float, float]]:
        """Of this input alone."""
        return {self.input: (0.0, float(np.sqrt(self.most)))}


class EffortTotal(Limit):
    """A budget: the sum of squares of some inputs, each period's times its size.

    Attributes:
        label: of the budget.
        sizes: of every period's reading, by the inputs' names; 0 where nothing is read.
        total: that may be spent.
    """

    looks_at: ClassVar[Any] = "run"
    label: str
    sizes: tuple[tuple[str, tuple[float, ...]], ...]
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
            spent += ca.dot(ca.DM(sizes), drive.inputs[:, names.index(name)] ** 2)
        return Rows(spent / self.total, np.array([-np.inf]), np.array([1.0]), 1.0, "")


def lifted(problem: Problem) -> Problem | None:
    """The problem whose inputs are the inputs and the roots of the weights; None where weights are chosen for
    trajectories that are found without them.

    That is so for trials that are chosen as a whole, for spaces without signals, and where limits are widened
    or tightened.
    """
    selection, space = problem.selection, problem.design
    sensors = problem.measurement.joint_sensors
    if selection is None or selection.of != "readings" or not isinstance(space, SignalSpace):
        return None
    if (
        not space.signals
        or problem.robust is not None
        or any(one.when == "between samples" for one in sensors)
    ):
        return None
    count, own = len(sensors), len(problem.model.inputs)
    pieces = selection.pieces or space.samples
    names = [f"{EFFORT}{place}" for place in range(count)]
    ranges = [EffortRange(input=name, most=selection.most) for name in names]
    signals = (*space.signals, *(PiecewiseConstant(pieces=pieces) for _ in sensors))
    weighed = [
        WeighedSensor(inner=one, place=own + place, own=own, every=one.every)
        for place, one in enumerate(sensors)
    ]
    return replace(
        problem,
        model=WithEfforts(problem.model, count),
        design=space.model_copy(update={"signals": signals}),
        measurement=weighed[0] if count == 1 else joined(weighed),
        limits=(*problem.limits, *ranges, *_totals(problem)),
        selection=None,
    )


def _totals(problem: Problem) -> list[EffortTotal]:
    selection = problem.selection
    assert selection is not None
    parts = selection.parts(selection.laid_out(problem))
    labels = list(dict.fromkeys(one.sensor for one in parts.readings))
    found = []
    for number, budget in enumerate(selection.budgets(parts)):
        here = {parts.readings[place].sensor for place in budget.places}
        sizes = [
            (f"{EFFORT}{place}", _sizes(problem, place))
            for place, label in enumerate(labels)
            if label in here
        ]
        found.append(EffortTotal(label=f"budget_{number}", sizes=tuple(sizes), total=budget.total))
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
    return replace(solution, trajectory=_own(problem, solution.trajectory))


def _own(problem: Problem, trajectory: Trajectory) -> Trajectory:
    table: Array = trajectory.coefficients[:, : len(problem.model.inputs)]
    return replace(trajectory, coefficients=table)
