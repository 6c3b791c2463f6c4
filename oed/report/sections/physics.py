"""Drives of a simulated robot with slip: which drive and model predict best, and how surely."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from oed.foundation.text import fixed, significant, words
from oed.records.record import Record
from oed.records.stored.simulation import Around, Scatter, StoredFloor, StoredTrial
from oed.report.figures import spread
from oed.report.figures.spread import FACTOR, UNIT
from oed.report.parts.prose import Prose
from oed.report.parts.section import Column, Picture, Section, Table, percent

SAY = Prose("physics")
BEST = " ← best"


def physics(record: Record) -> Section | None:
    """Held-out errors of every drive and model, scatter of the estimates and true paths."""
    trial = record.trial
    if trial is None:
        return None
    floors = [one for one in trial.floors if one.errors]
    methods = dict.fromkeys(words(one.method) for one in trial.fits)
    return Section.of(
        "Drives of a simulated robot with slip",
        SAY("intro", trial, methods, record.study.space),
        SAY("drives", trial.planned),
        *(_errors(trial, one) for one in floors),
        *(_excess(trial, one) for one in floors if one.attainable),
        _scatter(trial, floors) if floors else None,
        *(_figures(trial, floors) if floors else ()),
        notices=_notices(trial, floors),
    )


def _notices(trial: StoredTrial, floors: Sequence[StoredFloor]) -> Iterator[str]:
    if trial.interrupted:
        yield SAY("interrupted", trial, bool(floors))
    yield SAY("unused", [one.name for one in trial.planned if not one.feasible])
    yield SAY("refused", sum(one.refused for floor in floors for one in floor.errors))


def _errors(trial: StoredTrial, floor: StoredFloor) -> Table:
    table = {(one.drive, one.fit): one for one in floor.errors}
    best = min(floor.errors, key=lambda one: math.inf if one.value is None else one.value)

    def column(fit: str) -> Column:
        return Column(
            fit, UNIT, cell=lambda drive: _around_text(table[drive, fit], table[drive, fit] is best)
        )

    columns = (Column("calibrated from"), *(column(one.name) for one in trial.fits))
    return Table.of(dict.fromkeys(one.drive for one in floor.errors), columns, SAY("errors", floor))


def _around_text(error: Around | None, best: bool) -> str:
    if error is None or error.value is None:
        return "refused"
    value, low, high = (
        "∞" if one is None else significant(3)(FACTOR * one) for one in (error.value, error.low, error.high)
    )
    return f"{value} ({low} to {high}){BEST if best else ''}"


def _excess(trial: StoredTrial, floor: StoredFloor) -> Table:
    # First what the models leave themselves, then how much more is left by drive.
    table = {(one.drive, one.fit): one.excess for one in floor.errors}
    drives = dict.fromkeys(one.drive for one in floor.errors)
    least = {one.fit: one for one in floor.attainable}

    def column(fit: str) -> Column:
        best = min((_size(table[drive, fit]), drive) for drive in drives)[1]

        def cell(drive: str | None) -> str:
            found = least[fit] if drive is None else table[drive, fit]
            return _around_text(found, drive is not None and drive == best)

        return Column(fit, UNIT, cell=cell)

    first = Column("calibrated from", cell=lambda drive: drive or SAY("attainable"))
    columns = (first, *(column(one.name) for one in trial.fits if one.name in least))
    return Table.of([None, *drives], columns, SAY("excess", floor, trial.held_out))


def _size(around: Around | None) -> float:
    return math.inf if around is None or around.value is None else around.value


def _scatter(trial: StoredTrial, floors: Sequence[StoredFloor]) -> Table:
    own = trial.models[0]
    predicted = {one.name: one.predicted or {} for one in trial.planned}
    items = [(floor, one) for floor in floors for one in floor.scatter if one.fit == own.name]

    def relative(at: int) -> Callable[[tuple[StoredFloor, Scatter]], float]:
        return lambda item: 100 * item[1].relative[at]

    def noise(item: tuple[StoredFloor, Scatter]) -> float | None:
        known = predicted[item[1].drive]
        sizes = [(known.get(one.name), one.scale) for one in own.parameters]
        shares = [100 * size / scale for size, scale in sizes if size is not None]
        return float(np.sqrt(np.mean(np.square(shares)))) if len(shares) == len(sizes) else None

    columns = (
        Column("friction", cell=lambda item: f"{item[0].friction:g}"),
        Column("calibrated from", cell=lambda item: item[1].drive),
        *(Column(words(one.name), "%", fixed(3), relative(at)) for at, one in enumerate(own.parameters)),
        Column("all", "%", fixed(3), lambda item: percent(item[1].total.value)),
        Column("interval", "%", cell=lambda item: _interval(item[1].total)),
        Column("predicted from noise alone", "%", fixed(3), noise),
    )
    return Table.of(items, columns, SAY("scatter", own.name))


def _interval(total: Around) -> str:
    return f"{100 * (total.low or 0):.3f} to {100 * (total.high or 0):.3f}"


def _figures(trial: StoredTrial, floors: Sequence[StoredFloor]) -> tuple[Picture, ...]:
    held_out = spread.errors(floors, [one.name for one in trial.fits])
    true = spread.went(trial.planned, floors)
    return (
        Picture("held_out_errors", SAY("held_out"), SAY("held_out_caption"), held_out),
        Picture("true_paths", SAY("true_paths"), SAY("true_paths_caption"), true),
    )
