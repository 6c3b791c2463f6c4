"""Drives of a simulated robot with slip: which drive and model predict best, and how surely."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from oed.foundation.text import fixed, significant, words
from oed.records.record import Record
from oed.records.stored.trial import Error, Scatter, StoredFloor, StoredTrial, TriedModel
from oed.report.figures import spread
from oed.report.figures.spread import MILLIMETRES
from oed.report.parts.prose import Prose
from oed.report.parts.section import Cell, Column, Picture, Section, Table

SAY = Prose("physics")
BEST = " ← best"


def physics(record: Record) -> Section | None:
    """Held-out errors of every drive and model, scatter of the estimates and true paths."""
    trial = record.trial
    if trial is None:
        return None
    floors = [one for one in trial.floors if one.errors]
    methods = dict.fromkeys(words(one.method) for one in trial.fits)
    tables = [_errors(trial, one) for one in floors] + ([_scatter(trial, floors)] if floors else [])
    return Section(
        "Drives of a simulated robot with slip",
        paragraphs=(SAY("intro", trial, methods, record.study.trajectory), SAY("drives", trial.planned)),
        notices=tuple(_notices(trial, floors)),
        figures=_figures(trial, floors) if floors else (),
        tables=tuple(tables),
    )


def _notices(trial: StoredTrial, floors: Sequence[StoredFloor]) -> Iterator[str]:
    if trial.interrupted:
        yield SAY("interrupted", trial, bool(floors))
    unused = [one.name for one in trial.planned if not one.feasible]
    if unused:
        yield SAY("unused", unused)
    refused = sum(one.refused for floor in floors for one in floor.errors)
    if refused:
        yield SAY("refused", refused)


def _by_fit(floor: StoredFloor) -> tuple[list[str], Mapping[tuple[str, str], Error]]:
    # The drives, and the errors by drive and fit.
    return list(dict.fromkeys(one.drive for one in floor.errors)), {
        (one.drive, one.fit): one for one in floor.errors
    }


def _errors(trial: StoredTrial, floor: StoredFloor) -> Table:
    drives, table = _by_fit(floor)
    best = min(table.values(), key=lambda one: math.inf if one.value is None else one.value)
    columns = [Column("calibrated from"), *(_errors_by(one.name, table, best) for one in trial.fits)]
    return Table.of(drives, columns, SAY("errors", floor))


def _errors_by(fit: str, table: Mapping[tuple[str, str], Error], best: Error) -> Column:
    return Column(fit, "mm", cell=lambda drive: _error_text(table[drive, fit], table[drive, fit] is best))


def _error_text(error: Error, best: bool) -> str:
    if error.value is None:
        return "refused"
    value, low, high = (
        "∞" if one is None else significant(3)(MILLIMETRES * one)
        for one in (error.value, error.low, error.high)
    )
    return f"{value} ({low} to {high}){BEST if best else ''}"


def _scatter(trial: StoredTrial, floors: Sequence[StoredFloor]) -> Table:
    own = trial.models[0]
    predicted = {one.name: one.predicted or {} for one in trial.planned}
    columns = (
        Column("friction"),
        Column("calibrated from"),
        *(Column(words(one.name), "%", fixed(3)) for one in own.parameters),
        Column("all", "%", fixed(3)),
        Column("interval", "%"),
        Column("predicted from noise alone", "%", fixed(3)),
    )
    rows = tuple(
        (f"{floor.friction:g}", one.drive, *_scatter_cells(one, own, predicted[one.drive]))
        for floor in floors
        for one in floor.scatter
        if one.fit == own.name
    )
    return Table(columns, rows, SAY("scatter", own.name))


def _scatter_cells(one: Scatter, own: TriedModel, predicted: Mapping[str, float | None]) -> tuple[Cell, ...]:
    sizes = [(predicted.get(parameter.name), parameter.scale) for parameter in own.parameters]
    shares = [100 * size / scale for size, scale in sizes if size is not None]
    noise = float(np.sqrt(np.mean(np.square(shares)))) if len(shares) == len(sizes) else None
    total = one.total
    return (
        *(100 * value for value in one.relative),
        None if total.value is None else 100 * total.value,
        f"{100 * (total.low or 0):.3f} to {100 * (total.high or 0):.3f}",
        noise,
    )


def _figures(trial: StoredTrial, floors: Sequence[StoredFloor]) -> tuple[Picture, ...]:
    held_out = spread.errors(floors, [one.name for one in trial.fits])
    true = spread.went(trial.planned, floors)
    return (
        Picture("held_out_errors", SAY("held_out"), SAY("held_out_caption"), held_out),
        Picture("true_paths", SAY("true_paths"), SAY("true_paths_caption"), true),
    )
