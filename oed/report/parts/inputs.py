"""The inputs of a record's drives over time: what they are called, their limits, and series to draw."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from oed.foundation.text import in_degrees, words
from oed.kernel.dynamics.system import Input
from oed.kernel.limit import InputLimit
from oed.records.record import Record, drive_of
from oed.report.parts.reading import Entry, heading
from oed.robots.models.model import rate_of
from oed.robots.models.wheels import TWO_WHEEL_SPEEDS

Array = npt.NDArray[np.float64]
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
    """

    limit: str
    columns: tuple[int, ...]
    names: tuple[str, ...]
    unit: str
    factor: float = 1.0


def groups_of(record: Record, count: int) -> list[tuple[Group, Group]]:
    """Inputs by quantity, in their order, each with its rates; `count` inputs where none are named."""
    table = _inputs(record, count)
    return [
        _pair([(column, one) for column, one in enumerate(table) if one.quantity == quantity])
        for quantity in dict.fromkeys(one.quantity for one in table)
    ]


def _inputs(record: Record, count: int) -> list[Input]:
    named = record.data.get("inputs")
    if named:
        return [Input(str(one["name"]), str(one["quantity"]), str(one["unit"])) for one in named]
    if count == len(TWO_WHEEL_SPEEDS):
        return list(TWO_WHEEL_SPEEDS)
    return [Input(f"input_{index + 1}", "input", "") for index in range(count)]


def _pair(inputs: list[tuple[int, Input]]) -> tuple[Group, Group]:
    columns, names = tuple(column for column, _ in inputs), tuple(one.name for _, one in inputs)
    first = inputs[0][1]
    # Angles that someone sets are in degrees, speeds of wheels in rad/s, as data sheets have them.
    shown, factor = in_degrees(first.unit) if first.unit == "rad" else (first.unit, 1.0)
    values = Group(first.quantity, columns, names, shown, factor)
    return values, replace(values, limit=rate_of(first), unit=_per_second(shown))


def _per_second(unit: str) -> str:
    return f"{unit}^2" if unit.endswith("/s") else f"{unit or '1'}/s"


def limit_bounds(record: Record, group: Group) -> Bounds | None:
    """Bounds (min, max) that all inputs of a group share, as shown; None where they do not, or have none."""
    own = own_bounds(record, group)
    return own[group.names[0]] if len(own) == len(group.names) and len(set(own.values())) == 1 else None


def own_bounds(record: Record, group: Group) -> dict[str, Bounds]:
    """Bounds (min, max) of every input of a group that has some, as shown."""
    limit = getattr(record.study.limits, group.limit, None)
    if not isinstance(limit, InputLimit):
        return {}
    own = [name for name in group.names if not limit.each or name in limit.each]
    bounds = {name: limit.bounds_of(name) for name in own}
    return {name: (group.factor * low, group.factor * high) for name, (low, high) in bounds.items()}


def short_names(group: Group) -> list[str]:
    """What tells the inputs of a group apart: `right` and `left`."""
    return [words(name).removeprefix("wheel speed ").removeprefix("steering angle ") for name in group.names]


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


@dataclass(frozen=True)
class _Clock:
    # Runs of equal length on one clock [s].
    duration: float
    runs: int

    def times(self, periods: int) -> list[Array]:
        # Even times of every run, to just before the next one, where the splines jump.
        each = self.duration / self.runs
        ends = [(run + 1) * each * JUST_BEFORE for run in range(self.runs - 1)] + [self.duration]
        return [np.linspace(run * each, end, periods + 1) for run, end in enumerate(ends)]

    @property
    def breaks(self) -> tuple[float, ...]:
        each = self.duration / self.runs
        return tuple(run * each for run in range(1, self.runs))


def inputs_of(entry: Entry, group: Group) -> Series:
    """A group's inputs of a result that has a drive."""
    drive = drive_of(entry)
    assert drive is not None
    clock, periods = _Clock(drive.duration, drive.runs), drive.samples // drive.runs
    if drive.degree == 0:
        held = [np.vstack([run, run[-1:]]) for run in np.split(drive.inputs, drive.runs)]
        return _series(entry, group, clock, clock.times(periods), held, steps=True)
    times = clock.times(_drawn(periods, drive.runs))
    return _series(entry, group, clock, times, [drive.inputs_at(one) for one in times])


def rates_of(entry: Entry, group: Group) -> Series:
    """A group's rates of a result that has a drive; of a piecewise constant one, jumps over a period."""
    drive = drive_of(entry)
    assert drive is not None
    clock, periods = _Clock(drive.duration, drive.runs), drive.samples // drive.runs
    if drive.degree == 0:
        # From rest, from each period to the next, and to rest.
        times = clock.times(periods)
        jumps = np.split(drive.rates_at(np.concatenate(times)), drive.runs)
        return _series(entry, group, clock, times, jumps, steps=True)
    times = clock.times(_drawn(periods, drive.runs))
    return _series(entry, group, clock, times, [drive.rates_at(one) for one in times])


def _drawn(periods: int, runs: int) -> int:
    return min(PER_SAMPLE * periods, MOST_POINTS // runs)


def _series(
    entry: Entry, group: Group, clock: _Clock, times: list[Array], values: list[Array], steps: bool = False
) -> Series:
    rows = [group.factor * one[:, list(group.columns)] for one in values]
    for index, end in enumerate(clock.breaks):
        times[index] = np.append(times[index], end)
        rows[index] = np.vstack([rows[index], np.full(len(group.columns), np.nan)])
    return Series(heading(entry), np.concatenate(times), np.vstack(rows), steps, clock.breaks)
