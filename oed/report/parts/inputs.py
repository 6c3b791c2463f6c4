"""The inputs of a record's drives over time: what they are called, their limits, and series to draw."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from oed.foundation.arrays import Array
from oed.foundation.text import in_degrees, words
from oed.kernel.dynamics.system import Input
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.limit import InputLimit
from oed.records.record import Record
from oed.records.stored.result import Result
from oed.report.parts.reading import heading, problem_of
from oed.robots.models.rates import rate_of
from oed.robots.models.wheels import TWO_WHEEL_SPEEDS

Bounds = tuple[float, float]

PER_SAMPLE = 4
"""Points drawn per sample of a smooth input."""
MOST_POINTS = 1500
"""Points drawn per input at most."""
JUST_BEFORE = 1 - 1e-12
"""Where a run ends, as a share of the time at which the next one begins."""


@dataclass(frozen=True)
class Group:
    """Inputs of one quantity, or their rates.

    Attributes:
        limit: the quantity, which is also the name of its limit.
        columns: of the drives' inputs.
        names: of those inputs, in files.
        unit: in which they are shown.
        factor: from SI to that unit.
        rates: whether it is of their rates.
    """

    limit: str
    columns: tuple[int, ...]
    names: tuple[str, ...]
    unit: str
    factor: float = 1.0
    rates: bool = False

    @property
    def title(self) -> str:
        """What they are, in words."""
        return words(self.limit)

    @property
    def short_names(self) -> list[str]:
        """What distinguishes the inputs: `right` and `left`."""
        return [words(one).removeprefix("wheel speed ").removeprefix("steering angle ") for one in self.names]

    def own_bounds(self, record: Record) -> dict[str, Bounds]:
        """Bounds (min, max) of every input that has some, as shown."""
        limit = next((one for one in record.study.every_limit if one.name == self.limit), None)
        if limit is None:
            return {}
        if isinstance(limit, InputLimit):
            own = [name for name in self.names if not limit.each or name in limit.each]
            bounds = {name: limit.bounds_of(name) for name in own}
        else:
            problem = problem_of(record)
            if problem is None:
                return {}
            bounds = (limit.rate_bounds if self.rates else limit.input_bounds)(problem.model)
        return {name: (self.factor * low, self.factor * high) for name, (low, high) in bounds.items()}

    def bounds(self, record: Record) -> Bounds | None:
        """Bounds (min, max) that all inputs share, as shown; None where they do not, or have none."""
        own = self.own_bounds(record)
        shared = len(own) == len(self.names) and len(set(own.values())) == 1
        return own[self.names[0]] if shared else None


def groups_of(record: Record, count: int) -> list[tuple[Group, Group]]:
    """Inputs by quantity, in their order, each with its rates; `count` inputs where none are named."""
    found = groups_among(inputs_of(record, count), count)
    return found if record.study.domain == "robots" else [_as_given(record, *pair) for pair in found]


def _as_given(record: Record, values: Group, rates: Group) -> tuple[Group, Group]:
    # In the units in which the study gives them, each input being a quantity of its own.
    unit, factor = record.shown_unit(values.names[0], values.unit)
    per_second = f"{unit or '1'}/s", factor
    own = record.study.limit_units.get(rates.limit, per_second)
    return replace(values, unit=unit, factor=factor), replace(rates, unit=own[0], factor=own[1])


def groups_among(inputs: Sequence[Input], count: int) -> list[tuple[Group, Group]]:
    """As `groups_of`, of inputs themselves."""
    table = list(enumerate(inputs or _unnamed(count)))
    quantities = dict.fromkeys(one.quantity for _, one in table)
    return [_pair([(at, one) for at, one in table if one.quantity == quantity]) for quantity in quantities]


def inputs_of(record: Record, count: int) -> list[Input]:
    """The robot's inputs; `count` without names where the record names none."""
    named = [Input(one.name, one.quantity, one.unit) for one in record.inputs]
    return named or _unnamed(count)


def _unnamed(count: int) -> list[Input]:
    if count == len(TWO_WHEEL_SPEEDS):
        return list(TWO_WHEEL_SPEEDS)
    return [Input(f"input_{index + 1}", "input", "") for index in range(count)]


def _pair(inputs: list[tuple[int, Input]]) -> tuple[Group, Group]:
    columns, names = tuple(column for column, _ in inputs), tuple(one.name for _, one in inputs)
    first = inputs[0][1]
    # Angles that someone sets are in degrees, speeds of wheels in rad/s, as data sheets have them.
    shown, factor = in_degrees(first.unit) if first.unit == "rad" else (first.unit, 1.0)
    values = Group(first.quantity, columns, names, shown, factor)
    per_second = f"{shown}^2" if shown.endswith("/s") else f"{shown or '1'}/s"
    return values, replace(values, limit=rate_of(first), unit=per_second, rates=True)


@dataclass(frozen=True)
class Series:
    """A drive's inputs, or their rates, over time.

    Attributes:
        title: the result's name.
        times: (k,) [s].
        values: (k, inputs); not a number between runs, where lines break.
        steps: whether each value holds until the next time.
        breaks: times at which a run ends and the next begins [s].
    """

    title: str
    times: Array
    values: Array
    steps: bool = False
    breaks: tuple[float, ...] = ()


def series_of(result: Result, group: Group) -> Series:
    """A group's inputs, or their rates, of a result that has a drive.

    Rates of a piecewise constant drive are its jumps over a period: from rest, from each period to the next,
    and to rest.
    """
    assert result.drive is not None
    return series_among(result.drive.trajectory, group, heading(result))


def series_among(drive: Trajectory, group: Group, title: str) -> Series:
    """As `series_of`, of a drive itself.

    Args:
        drive: whose inputs are drawn.
        group: of its inputs.
        title: of the series.
    """
    steps = drive.degree == 0
    periods = drive.samples // drive.runs
    each = drive.duration / drive.runs
    drawn = periods if steps else min(PER_SAMPLE * periods, MOST_POINTS // drive.runs)
    # Even times of every run, to just before the next one, where the splines jump.
    ends = [(run + 1) * each * JUST_BEFORE for run in range(drive.runs - 1)] + [drive.duration]
    times = [np.linspace(run * each, end, drawn + 1) for run, end in enumerate(ends)]
    if group.rates:
        values = np.split(drive.inputs_at(np.concatenate(times), 1), drive.runs)
    elif steps:
        values = [np.vstack([run, run[-1:]]) for run in np.split(drive.inputs, drive.runs)]
    else:
        values = [drive.inputs_at(one) for one in times]
    breaks = tuple(run * each for run in range(1, drive.runs))
    rows = [group.factor * one[:, list(group.columns)] for one in values]
    for index, end in enumerate(breaks):
        times[index] = np.append(times[index], end)
        rows[index] = np.vstack([rows[index], np.full(len(group.columns), np.nan)])
    return Series(title, np.concatenate(times), np.vstack(rows), steps, breaks)


def sampled(result: Result, group: Group, run: int) -> Array:
    """A group's inputs in a run of a result that has a drive, at the samples, (N + 1, inputs), as shown.

    Args:
        result: that has a drive.
        group: of inputs.
        run: its number, from 0.
    """
    assert result.drive is not None
    drive = result.drive.trajectory
    periods, each = drive.samples // drive.runs, drive.duration / drive.runs
    if drive.degree == 0:
        held = np.split(drive.inputs, drive.runs)[run]
        values = np.vstack([held, held[-1:]])
    else:
        last = each * (JUST_BEFORE if run + 1 < drive.runs else 1.0)
        values = drive.inputs_at(run * each + np.linspace(0.0, last, periods + 1))
    return np.asarray(group.factor * values[:, list(group.columns)])
