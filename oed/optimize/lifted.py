"""Readings and durations chosen together with inputs, as further inputs of a search.

The further inputs are the roots v = sqrt(w) of the readings' weights, with which sum v^2 J' R^-1 J is smooth
and budgets are sums of v^2, and the pace: the share of the longest duration that an experiment takes.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.rollout import Drive
from oed.kernel.dynamics.signals import Constant, PiecewiseConstant, Signal
from oed.kernel.dynamics.space import SignalSpace, Spline
from oed.kernel.dynamics.system import Input, System
from oed.kernel.limit import Limit, Rows
from oed.kernel.measurement.blocks import Nuisance
from oed.kernel.measurement.measurement import measurement_of
from oed.kernel.measurement.process_noise import Period, ProcessNoise
from oed.kernel.measurement.sensor import Moment, Sensor, Start
from oed.kernel.pace import PACE, pace_of
from oed.kernel.problem import Problem
from oed.kernel.repetitions import EFFORT
from oed.kernel.scorer import score
from oed.kernel.solution import Solution


@dataclass(frozen=True)
class Lifted(System):
    """System with further inputs: roots of weights, which do not move it, and the pace of its time.

    Attributes:
        inner: system without further inputs.
        efforts: number of roots of weights, after the inputs of the inner system.
        paced: True where the last input is the share of the longest duration that an experiment takes.
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
    parameters = property(lambda self: self.inner.parameters)
    exact = property(lambda self: self.inner.exact)
    estimable = property(lambda self: self.inner.estimable)
    chosen_states = property(lambda self: self.inner.chosen_states)

    def step(
        self, state: Expression, inputs: Expression, parameters: Expression, period: Expression
    ) -> Expression:
        """Return the next state of the inner system.

        Args:
            state: state at the begin of the period.
            inputs: inputs held in it, the further ones too.
            parameters: parameters of the system, (p,).
            period: duration of the period at full length [s].
        """
        return self.inner.step(state, self.inner_inputs(inputs), parameters, self.duration(inputs, period))

    def signals(
        self, state: Expression, inputs: Expression, parameters: Expression, period: Expression
    ) -> Mapping[str, Expression]:
        """Return the signals of the inner system.

        Args:
            state: state at the begin of the period.
            inputs: inputs held in it, the further ones too.
            parameters: parameters of the system, (p,).
            period: duration of the period at full length [s].
        """
        return self.inner.signals(state, self.inner_inputs(inputs), parameters, self.duration(inputs, period))

    def inner_inputs(self, inputs: Expression) -> Expression:
        """Return the inputs of the inner system, without the further ones."""
        return inputs[: len(self.inner.inputs), :]

    def duration(self, inputs: Expression, period: Expression) -> Expression:
        """Return the duration [s] at the pace among the inputs of a period of this full length [s]."""
        return period * inputs[len(self.inputs) - 1] if self.paced else period

    def estimating(self, names: Collection[str]) -> System:
        """Return the system that estimates the named parameters, with the same further inputs."""
        return replace(self, inner=self.inner.estimating(names))


@dataclass(frozen=True)
class LiftedNoise(ProcessNoise):
    """Process noise of a system with further inputs, over the duration of a period at its pace.

    Attributes:
        inner: process noise of the inner system.
    """

    inner: ProcessNoise
    signal = property(lambda self: self.inner.signal)
    size = property(lambda self: self.inner.size)
    text = property(lambda self: self.inner.text)

    def covariance(self, period: Period) -> Expression:
        """Return the covariance matrix of the inner noise over a period."""
        return self.inner.covariance(_unlifted(period))

    def step(self, period: Period, errors: Expression) -> Expression:
        """Return the change of the state by the errors of the inner noise in a period."""
        return self.inner.step(_unlifted(period), errors)


def _unlifted(period: Period) -> Period:
    system, state, inputs, parameters, duration = period
    assert isinstance(system, Lifted)
    duration = system.duration(inputs, duration)
    return Period(system.inner, state, system.inner_inputs(inputs), parameters, duration)


class LiftedSensor(Sensor):
    """Sensor whose readings are weighted by the square of one further input and timed by another.

    Attributes:
        inner: sensor without weights.
        inner_count: number of inputs of the inner system.
        effort: place of the root of its weight among the inputs; None where all weights are equal.
        pace: place of the pace among the inputs; None where the duration is fixed.
    """

    kind: str = "lifted"
    inner: Sensor
    inner_count: int
    effort: int | None = None
    pace: int | None = None

    continuous = property(lambda self: self.inner.continuous)
    when = property(lambda self: self.inner.when)

    @property
    def nuisances(self) -> tuple[Nuisance, ...]:
        """Nuisance parameters of the inner sensor."""
        return self.inner.nuisances

    @property
    def start_known(self) -> Start | None:
        """Knowledge of the start states, as the inner sensor has it."""
        return self.inner.start_known

    @property
    def process_noise(self) -> ProcessNoise | None:
        """Process noise of the inner sensor, for the system with further inputs."""
        noise = self.inner.process_noise
        return None if noise is None else LiftedNoise(noise)

    def reading(self, moment: Moment) -> Expression:
        """Return the noise-free reading of the inner sensor."""
        return self.inner.reading(self._inner_moment(moment))

    def whitening(self, moment: Moment) -> Expression:
        """Return the whitening of the inner sensor, times the roots of the weight and of the pace."""
        whitening = self.inner.whitening(self._inner_moment(moment))
        if self.pace is not None and self.inner.continuous:
            whitening = ca.sqrt(moment.inputs[self.pace]) * whitening
        return whitening if self.effort is None else moment.inputs[self.effort] * whitening

    def _inner_moment(self, moment: Moment) -> Moment:
        return replace(moment, inputs=moment.inputs[: self.inner_count, :])


class FurtherRange(Limit):
    """Range of a further input.

    Attributes:
        input: name of the input.
        low: smallest value.
        high: largest value.
    """

    looks_at: ClassVar[Any] = "inputs"
    input: str
    low: float
    high: float
    name = property(lambda self: self.input)

    def rows(self, drive: Drive) -> Rows:
        """Return the value of the input in every period as rows."""
        column = drive.input_values[:, drive.system.input_names.index(self.input)]
        count = column.shape[0]
        return Rows(column, np.full(count, self.low), np.full(count, self.high), self.high, "")

    def input_bounds(self, system: System) -> dict[str, tuple[float, float]]:
        """Return the range of this input by its name."""
        return {self.input: (self.low, self.high)}


class EffortTotal(Limit):
    """Budget on the weighted sum of squares of some further inputs over all periods.

    Attributes:
        label: name of the budget.
        sizes: size of the reading in every period at the longest duration, by the names of the inputs; 0 in
            periods without a reading.
        timed: names of the inputs whose readings grow in proportion to their duration.
        total: largest sum.
    """

    looks_at: ClassVar[Any] = "run"
    label: str
    sizes: tuple[tuple[str, tuple[float, ...]], ...]
    timed: tuple[str, ...] = ()
    total: float
    name = property(lambda self: self.label)

    def rows(self, drive: Drive) -> Rows:
        """Return the share of the total that is spent, as a single row."""
        names = drive.system.input_names
        spent: Expression = 0.0
        for name, sizes in self.sizes:
            pace = pace_of(drive) if name in self.timed else 1.0
            spent += ca.dot(ca.DM(sizes), pace * drive.inputs[:, names.index(name)] ** 2)
        return Rows(spent / self.total, np.array([-np.inf]), np.array([1.0]), 1.0, "")


def lift(problem: Problem) -> Problem | None:
    """Return the problem with roots of the weights and the pace as further inputs.

    It is None where nothing is chosen together with inputs. In spaces of splines, and where whole trials are
    weighted, weights are instead chosen after the search, for the trajectory that it found.
    """
    space, sensors = problem.design, problem.sensors
    # A system without inputs has no signals, but its start states may be chosen with the readings.
    if not isinstance(space, SignalSpace) or (problem.model.inputs and not space.signals):
        return None
    if problem.robust is not None:
        return None
    weighted, paced = _weighted(problem), space.shortest is not None
    if not weighted and not paced:
        return None
    count, efforts = len(problem.model.inputs), len(sensors) if weighted else 0
    lifted_sensors = [
        LiftedSensor(
            inner=sensor,
            inner_count=count,
            effort=count + place if weighted else None,
            pace=count + efforts if paced else None,
            every=sensor.every,
        )
        for place, sensor in enumerate(sensors)
    ]
    limits, signals = _further(problem, efforts)
    all_signals = (*space.signals, *signals)
    kept = {"signals": all_signals, "spline": Spline(), "rest_to_rest": False, "shortest": None}
    return replace(
        problem,
        model=Lifted(problem.model, efforts, paced),
        design=space.model_copy(update=kept),
        measurement=measurement_of(lifted_sensors),
        limits=(*problem.limits, *limits),
        selection=None,
    )


def _weighted(problem: Problem) -> bool:
    selection = problem.selection
    between = any(sensor.when == "between samples" for sensor in problem.sensors)
    return selection is not None and selection.of == "readings" and not between


def _further(problem: Problem, efforts: int) -> tuple[list[Limit], list[Signal]]:
    # Limits on the further inputs, and their signals over a run.
    limits, signals = list[Limit](), list[Signal]()
    selection, space = problem.selection, problem.design
    if efforts and selection is not None:
        most = float(np.sqrt(selection.most))
        names = [f"{EFFORT}{place}" for place in range(efforts)]
        limits += [FurtherRange(input=name, low=0.0, high=most) for name in names]
        limits += _totals(problem)
        # A reading at the end shares its weight with the last period's.
        pieces = min(selection.pieces or space.samples, space.samples)
        signals += [PiecewiseConstant(pieces=pieces) for _ in names]
    if isinstance(space, SignalSpace) and space.shortest is not None:
        limits.append(FurtherRange(input=PACE, low=space.shortest / space.duration, high=1.0))
        signals.append(Constant(shared=True))
    return limits, signals


def _totals(problem: Problem) -> list[EffortTotal]:
    selection = problem.selection
    assert selection is not None
    parts = selection.parts_of(problem.sensors, problem.system, problem.design)
    labels = list(dict.fromkeys(reading.sensor for reading in parts.readings))
    sensors = problem.sensors
    timed = tuple(f"{EFFORT}{place}" for place, sensor in enumerate(sensors) if sensor.continuous)
    totals = []
    for number, budget in enumerate(selection.budgets(parts)):
        budgeted = {parts.readings[place].sensor for place in budget.places}
        sizes = [
            (f"{EFFORT}{place}", _sizes(problem, place))
            for place, label in enumerate(labels)
            if label in budgeted
        ]
        label = f"budget_{number}"
        totals.append(EffortTotal(label=label, sizes=tuple(sizes), timed=timed, total=budget.total))
    return totals


def _sizes(problem: Problem, place: int) -> tuple[float, ...]:
    # Size of the readings of a sensor in every period of all runs.
    sensor, space = problem.sensors[place], problem.design
    held = np.minimum(sensor.columns(space.samples), space.samples - 1)
    sizes = np.bincount(held, minlength=space.samples) * (space.period if sensor.continuous else 1.0)
    return tuple(np.tile(sizes, space.runs).tolist())


def lower(problem: Problem, solution: Solution) -> Solution:
    """Return a solution of the lifted problem as a solution of the problem, without weights."""
    if solution.trajectory is None:
        return replace(solution, problem=problem)
    space, coefficients = problem.design, solution.trajectory.coefficients
    paced = isinstance(space, SignalSpace) and space.shortest is not None
    share = float(coefficients[0, -1]) if paced else 1.0
    trajectory = replace(
        solution.trajectory,
        knots=share * solution.trajectory.knots,
        coefficients=coefficients[:, : len(problem.model.inputs)],
    )
    return replace(solution, trajectory=trajectory, evaluation=score(problem, trajectory), problem=problem)
