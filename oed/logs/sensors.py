"""What sensors beside the poses read, whatever the file: checked, and given to the drives they read in."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, Protocol

import numpy as np
from pydantic import BeforeValidator

from oed.foundation.arrays import Array, Bools
from oed.foundation.component import Component
from oed.foundation.errors import FileIssue, Issue, LogError
from oed.foundation.text import did_you_mean, listing
from oed.kernel.measurement.measurement import Measurement, sensors_of
from oed.kernel.measurement.readings import sensor_labels
from oed.kernel.measurement.sensor import Sensor
from oed.logs.drive import MARGIN
from oed.logs.input_forms import unit_factor, unit_reason
from oed.logs.log import Log, SensorReadings
from oed.logs.points import quantity_of
from oed.logs.series import Series, shortened, time_text

Clock = Literal["inputs", "poses"]
AS_LIST = BeforeValidator(lambda value: value if isinstance(value, list | tuple) else [value])
"""One for a list of one."""
MOST = {"rad": (2 * np.pi + 1e-3, "deg"), "rad/s": (30.0, "deg/s")}
"""What directions are at most, a full turn and its rounding, and yaw rates of robots; else they are rather in
other units."""


@dataclass(frozen=True)
class Sensed:
    """All that one sensor read in a file.

    Attributes:
        name: of the sensor.
        series: times and values (m, q), SI, not-a-number where an entry was not read.
        clock: whose clock the times are on.
        runs: which run a row belongs to; None where nobody says.
    """

    name: str
    series: Series
    clock: Clock
    runs: tuple[str, ...] | None = None


def labelled(measurement: Measurement | None) -> dict[str, Sensor]:
    """A measurement's sensors by the names that `log: sensors:` has for them: their kinds, numbered from the
    second of a kind on.
    """
    sensors = sensors_of(measurement)
    return dict(zip(sensor_labels(sensors), sensors, strict=True))


class HasUnit(Protocol):
    """A column or field."""

    @property
    def unit(self) -> str | None:
        """Its own unit, if it has one."""


class SensorSource(Component, ABC):
    """Where a sensor's readings are.

    Attributes:
        unit: of them, e.g. "deg/s"; SI by default.
        clock: "inputs" or "poses", whose clock the times are on; by default a gyroscope's are on the inputs',
            those of what sees places on the poses'.
    """

    unit: str | None = None
    clock: Clock | None = None

    @abstractmethod
    def issues(self, name: str, sensor: Sensor) -> list[Issue]:
        """What of this does not fit the sensor of that name."""

    def unit_issues(self, name: str, places: Iterable[HasUnit], units: Iterable[str]) -> list[Issue]:
        """Units of another kind than those of the sensor.

        Args:
            name: of the sensor.
            places: columns or fields, in the order of its quantities.
            units: SI, of these.
        """
        each = zip(places, units, strict=False)
        reasons = dict.fromkeys(unit_reason(one.unit or self.unit, unit) for one, unit in each)
        return [Issue(("log", "sensors", name, "unit"), reason) for reason in reasons if reason]

    def factors(self, places: Iterable[HasUnit], units: Iterable[str]) -> list[float]:
        """SI units in one of those at `places`, whose own come before that of all of them."""
        each = zip(places, units, strict=True)
        return [unit_factor(one.unit or self.unit, unit) for one, unit in each]

    def clock_of(self, sensor: Sensor) -> Clock:
        """Whose clock the times are on."""
        return self.clock or ("inputs" if sensor.when == "in periods" else "poses")


def source_issues(sources: Mapping[str, SensorSource], measurement: Measurement | None) -> list[Issue]:
    """What in `log: sensors:` does not fit the study's measurement."""
    sensors = labelled(measurement)
    wrong = dict(_name_issues(list(sources), sensors))
    # What is wrong with a sensor itself it says later on.
    whole = {name for name, sensor in sensors.items() if len(sensor.entries) == len(sensor.units)}
    fitting = ((name, one) for name, one in sources.items() if name in whole - set(wrong))
    return [*wrong.values(), *(issue for name, one in fitting for issue in one.issues(name, sensors[name]))]


def _name_issues(names: Sequence[str], sensors: dict[str, Sensor]) -> Iterator[tuple[str, Issue]]:
    # Names of no sensor of the study, and of sensors that cannot be read so, each with its issue.
    others = [name for name in sensors if name != "poses"]
    for name in names:
        key = ("log", "sensors", name)
        if name == "poses":
            yield name, Issue(key, "poses have a key of their own: log: poses")
        elif name not in sensors:
            known = f"it measures {listing(others)}" if others else "it measures with no other sensors"
            text = f"the study's measurement has no {name}; {known}{did_you_mean(name, others)}"
            yield name, Issue(key, text)
        elif not sensors[name].entries:
            yield name, Issue(key, f"{name} does not say what its readings are: give it `units`")


def checked(found: Sensed, sensor: Sensor) -> Sensed:
    """The readings, if they can be those of the sensor.

    Raises:
        LogError: no reading, times that do not rise, numbers beyond a robot's, ranges below 0, angles and
            rates rather in degrees.
    """
    series = found.series
    there = np.asarray(np.isfinite(series.values).any(axis=1))
    if not there.any():
        text = f"there is no reading of {found.name}"
        raise LogError([FileIssue(series.file, 0, 0, found.name, text)])
    series = series.rows(there)
    names = [f"{found.name}{entry}" for entry in sensor.entries]
    filled = series.with_values(np.where(np.isnan(series.values), 0.0, series.values))
    issues = [*filled.too_large(names), *_value_issues(series, found.name, sensor)]
    runs = None if found.runs is None else tuple(np.array(found.runs)[there].tolist())
    for rows in _by_run(runs, len(series)):
        issues += series.rows(rows).clock_issues()
    if issues:
        raise LogError(shortened(issues))
    return replace(found, series=series, runs=runs)


def _value_issues(series: Series, name: str, sensor: Sensor) -> Iterator[FileIssue]:
    several = len(set(sensor.units)) > 1
    for place, (entry, unit) in enumerate(zip(sensor.entries, sensor.units, strict=True)):
        sizes = np.nan_to_num(np.abs(series.values[:, place]))
        row = int(np.argmax(sizes))
        limit, right = MOST.get(unit, (np.inf, ""))
        # Angles may run on over full turns, but for directions that begin anew.
        if sizes[row] > limit and (unit != "rad" or place in sensor.wrapping):
            of = f" of {quantity_of(entry)}" if several else ""
            text = f"{sizes[row]:.6g} {unit} is more than {limit:.3g}; in degrees say `unit: {right}`{of}"
            yield series.issue(row, f"{name}{entry}", text)
        for row in np.flatnonzero(series.values[:, place] < 0).tolist() if unit == "m" else ():
            text = f"a distance is not below 0, got {series.values[row, place]:.6g} m"
            yield series.issue(row, f"{name}{entry}", text)


def _by_run(runs: tuple[str, ...] | None, count: int) -> list[Bools]:
    if runs is None:
        return [np.ones(count, dtype=bool)]
    return [np.array(runs) == run for run in dict.fromkeys(runs)]


def with_sensors(logs: Sequence[Log], found: Sequence[Sensed]) -> list[Log]:
    """Logs of a file's drives with what the sensors read during each.

    Raises:
        LogError: readings none of which was made during any drive, drives without poses in which nothing else
            was read of where the robot was.
    """
    given = [[_during(log, one) for one in found] for log in logs]
    issues = []
    for place, one in enumerate(found):
        if not any(len(row[place].times) for row in given):
            span = f"{time_text(one.series.times.min())} to {time_text(one.series.times.max())} s"
            log = f"from {time_text(logs[0].input_times[0])} to {time_text(logs[-1].input_times[-1])} s"
            text = f"the readings of {one.name} are from {span}, outside of the log's, {log}"
            issues.append(one.series.issue(0, one.series.clock, f"{text}; are the units of time alike?"))
    if issues:
        raise LogError(issues)
    return [
        _placed(replace(log, sensors=tuple(one for one in row if len(one.times))))
        for log, row in zip(logs, given, strict=True)
    ]


def _during(log: Log, one: Sensed) -> SensorReadings:
    clocks = [log.input_times, *([log.pose_times] if one.clock == "poses" else [])]
    inside = [(one.series.times >= at[0] - MARGIN) & (one.series.times <= at[-1] + MARGIN) for at in clocks]
    own = np.any(inside, axis=0)
    if one.runs is not None:
        stem = Path(log.file).stem
        own &= np.array([log.name.startswith(f"{stem}[{run}]") for run in one.runs])
    return SensorReadings(one.name, one.series.times[own], one.series.values[own], one.clock)


def _placed(log: Log) -> Log:
    # Of a log without poses the times are those at which anything else was read of where the robot was.
    if log.quantities:
        return log
    each: list[Array] = [one.times for one in log.sensors if one.clock == "poses"]
    times = np.unique(np.concatenate([np.zeros(0), *each]))
    return replace(log, pose_times=times, poses=np.zeros((len(times), 0)))
