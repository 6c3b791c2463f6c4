"""Predicted states of a system that is driven, and their derivatives by its parameters."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated

import numpy as np
from pydantic import Field, FiniteFloat

from oed.foundation.arrays import ROUNDING, Array
from oed.foundation.component import Component
from oed.foundation.errors import Issue
from oed.foundation.quantities import Duration
from oed.foundation.text import count
from oed.kernel.criteria.criterion import Subject
from oed.kernel.dynamics.simulate import simulate

MOST_STEPS = 100_000
"""Largest number of steps that are predicted: some seconds of computing."""


class Leg(Component):
    """A part of a test drive: inputs held [SI], and for how long [s]."""

    inputs: Annotated[tuple[FiniteFloat, ...], Field(min_length=1)]
    duration: Annotated[Duration, Field(gt=0)]


class TaskDrive(Component):
    """A drive that the estimates are for: inputs held in equal periods, from a start state.

    Attributes:
        inputs: inputs of every period, (N, inputs), SI.
        period: time for which each is held [s].
        start: start state, (states,), SI; if None that of the experiments.
    """

    inputs: Annotated[tuple[tuple[FiniteFloat, ...], ...], Field(min_length=1)]
    period: Annotated[Duration, Field(gt=0)]
    start: tuple[FiniteFloat, ...] | None = None


def task_issues(subject: Subject, task: Sequence[str | TaskDrive]) -> Iterator[Issue]:
    """Drives of a task that are not read, or not of a system.

    Args:
        subject: subject with the system that predicts.
        task: drives, or names of files.
    """
    inputs, states = len(subject.system.exact.inputs), len(subject.system.exact.states)
    for index, drive in enumerate(task):
        key = ("criterion", "task", index)
        if isinstance(drive, str):
            yield Issue(
                key, f"the file {drive} is read where a study is loaded from a file; here give drives"
            )
        elif any(len(row) != inputs for row in drive.inputs):
            yield Issue((*key, "inputs"), f"expected {count(inputs, 'input')} in every period")
        elif drive.start is not None and len(drive.start) != states:
            yield Issue((*key, "start"), f"expected {count(states, 'state')}, got {len(drive.start)}")


def states_of(subject: Subject, quantity: str) -> list[int]:
    """Places of the states that are predicted together.

    Args:
        subject: subject with the system that predicts.
        quantity: one of its `predictions`.
    """
    system = subject.system.exact
    return [system.states.index(name) for name in system.predictions[quantity]]


def sensitivities(
    subject: Subject,
    inputs: Sequence[Sequence[float]],
    durations: Sequence[float],
    start: Sequence[float] | None = None,
) -> Array:
    """Derivatives (legs, states, parameters) of the states at the ends of legs by the system's parameters.

    Each leg is stepped in equal parts of at most the experiment's period: as far as its system steps at once.

    Args:
        subject: subject with the system, driven at its nominal parameters.
        inputs: held in every leg, (legs, inputs), SI.
        durations: durations of the legs [s].
        start: start state of the first leg, (states,), SI; by default that of the experiments.
    """
    system = subject.system.exact
    times = np.array(durations, dtype=float)
    steps = np.maximum(np.ceil(times / subject.period - ROUNDING), 1.0).astype(int)
    begin = subject.start if start is None else start
    first = np.zeros(len(system.states)) if begin is None else begin
    held = np.repeat(np.array(inputs, dtype=float).reshape(len(steps), -1), steps, axis=0)
    run = simulate(system, held, first, np.repeat(times / steps, steps))
    return np.asarray(run.sensitivities[np.cumsum(steps)])
