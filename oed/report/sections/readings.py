"""Which readings are taken, how much they count, and what proves that no others are better."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from oed.foundation.arrays import Array
from oed.foundation.text import significant, unit_text, words
from oed.kernel.measurement.measurement import sensors_of
from oed.kernel.measurement.readings import sensor_labels
from oed.records.record import Record
from oed.records.stored.selection import StoredReading, StoredSelection
from oed.report.figures import courses as figures
from oed.report.figures import spec
from oed.report.parts.experiments import scale_of
from oed.report.parts.prose import Prose
from oed.report.parts.reading import TAKEN, time_scale
from oed.report.parts.section import Column, Picture, Section, Table

SAY = Prose("readings")
NUMBER = spec.Axis("number of the setting")
MOST_ROWS = 40
"""Readings that are listed."""


def readings(record: Record) -> Section | None:
    """The chosen readings of the best design; None where all are taken."""
    found = None if record.best is None else record.best.selection
    if found is None:
        return None
    taken = [one for one in found.readings if one.weight > TAKEN * _most(found)]
    share = 100 * (found.efficiency or 0.0)
    noun, groups = "reading", [_stems(record, found, *group) for group in _groups(found)]
    across = _axis(record)
    if found.of_runs:
        noun, groups, across = "run", [_stems_of_runs(found)], spec.Axis("run", most=10, whole=True)
    alt = f"Weights of {noun}s, and their directional derivatives"
    picture = Picture("weights", alt, SAY("caption", noun), figures.stems(groups, across))
    said = SAY("chosen", found, noun, len(found.readings), len(taken)), SAY("efficiency", found, share)
    return Section.of(f"Which {noun}s are taken", *said, _table(record, found, taken), picture)


def _stems_of_runs(found: StoredSelection) -> figures.Stems:
    level = _levels(found)
    return figures.Stems(
        "",
        np.array([one.run + 1.0 for one in found.readings]),
        np.array([one.weight for one in found.readings]),
        np.array([one.derivative / one.size / level[place] for place, one in enumerate(found.readings)]),
        _most(found),
    )


def _most(found: StoredSelection) -> float:
    return max(one.most for one in found.budgets)


def _groups(found: StoredSelection) -> list[tuple[int, str]]:
    return list(dict.fromkeys((one.run, one.sensor) for one in found.readings))[:6]


def _axis(record: Record) -> spec.Axis:
    if record.states_are_none:
        one = record.inputs[0]
        single = len(record.inputs) == 1
        return spec.Axis(words(one.name), scale_of(record, one.name, one.unit).unit) if single else NUMBER
    scale = time_scale(record.study.space.duration)
    return spec.Axis("time", scale[0])


def _stems(record: Record, found: StoredSelection, run: int, sensor: str) -> figures.Stems:
    own = [(place, one) for place, one in enumerate(found.readings) if (one.run, one.sensor) == (run, sensor)]
    places = _places(record, own)
    order = np.argsort(places, kind="stable")
    own, level = [own[place] for place in order], _levels(found)
    trials = len({one.run for one in found.readings})
    title = ", ".join(filter(None, [words(_called(record, sensor)), f"run {run + 1}" if trials > 1 else ""]))
    return figures.Stems(
        title,
        places[order],
        np.array([one.weight for _, one in own]),
        np.array([one.derivative / one.size / level[place] for place, one in own]),
        _most(found),
    )


def _places(record: Record, own: Sequence[tuple[int, StoredReading]]) -> Array:
    # Times, values of the only input, or numbers of settings, as shown.
    if not record.states_are_none:
        factor = time_scale(record.study.space.duration)[1]
        return np.array([factor * reading.time for _, reading in own])
    best = record.best
    if len(record.inputs) != 1 or best is None or best.drive is None:
        return np.array([place + 1.0 for place, _ in own])
    one, table = record.inputs[0], best.drive.trajectory.inputs[:, 0]
    factor = scale_of(record, one.name, one.unit).factor
    return np.array([factor * table[place % len(table)] for place, _ in own])


def _levels(found: StoredSelection) -> dict[int, float]:
    # Of every reading what a unit of its budget is worth at the margin: the least of those taken.
    levels = dict[int, float]()
    for budget in found.budgets:
        own = [found.readings[place] for place in budget.readings]
        taken = [one.derivative / one.size for one in own if one.relaxed > TAKEN * budget.most]
        level = min(taken, default=max(one.derivative / one.size for one in own)) or 1.0
        levels |= dict.fromkeys(budget.readings, level)
    return levels


def _called(record: Record, sensor: str) -> str:
    # A sensor that reads one output is called by that.
    sensors = sensors_of(record.study.measurement)
    for one, label in zip(sensors, sensor_labels(sensors), strict=True):
        if label == sensor and len(one.entries) == 1 and one.entries[0].strip("."):
            return one.entries[0].strip(".")
    return sensor


def _table(record: Record, found: StoredSelection, taken: list[StoredReading]) -> Table | None:
    if not taken or len(taken) > MOST_ROWS:
        return None
    unit, factor = time_scale(record.study.space.duration)
    trials, settings = len({one.run for one in found.readings}) > 1, record.states_are_none
    whole = found.of_runs
    times = Column("time", unit, significant(4), lambda one: factor * one.time)
    columns = [
        Column("run", cell=lambda one: str(one.run + 1)) if trials else None,
        *([] if whole else [Column("what", cell=lambda one: words(_called(record, one.sensor)))]),
        *(_settings(record, found) if settings else [] if whole else [times]),
        Column("weight", "", _four, lambda one: one.weight),
    ]
    return Table.of(taken, columns, f"{'Runs' if whole else 'Readings'} that are taken")


def _four(value: float) -> str:
    # A weight's digits, without idle zeros.
    return f"{value:.4g}"


def _settings(record: Record, found: StoredSelection) -> Iterator[Column]:
    # The inputs' values where a reading is one of a setting.
    assert record.best is not None
    assert record.best.drive is not None
    table = record.best.drive.trajectory.inputs
    rows = {id(one): table[place % len(table)] for place, one in enumerate(found.readings)}

    def column(name: str, unit: str, factor: float, place: int) -> Column:
        return Column(name, unit_text(unit), significant(4), lambda one: factor * float(rows[id(one)][place]))

    for place, one in enumerate(record.inputs):
        yield column(words(one.name), *record.study.shown_units.get(one.name, (one.unit, 1.0)), place)
