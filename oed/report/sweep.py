"""The page of a sweep: its points side by side, and how what they reach depends on what was varied."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import quote

from oed.foundation.files import inside
from oed.foundation.text import listing, significant, unit_text, words
from oed.records.record import Record, load_record
from oed.records.stored.sweep import StoredSweep, SweptKey, SweptPoint
from oed.report.comparison import deviation_columns, relative_deviations
from oed.report.figures import chart as charts
from oed.report.figures import paths as path_figures
from oed.report.figures.chart import Chart
from oed.report.figures.driven import path_of, room_of
from oed.report.page import NAME, render
from oed.report.parts.prose import Prose
from oed.report.parts.section import Column, Picture, Section, Table, percent

SAY = Prose("sweep")
SERIES = 6
"""Lines, or bars side by side, beyond which a figure could not be read."""
PAGE = f"{NAME}.html"
PATHS = 12
"""Paths that are drawn."""


def write_sweep(
    found: StoredSweep, source: str | Path, folder: str | Path | None = None, figures: Sequence[str] = ()
) -> Path:
    """Write report.html, report.md and figures/*.svg of a sweep; returns report.html.

    Args:
        found: the sweep.
        source: its folder, where its records are.
        folder: where to write; the sweep's own by default.
        figures: formats in which figures are written beside the SVG of each: "pdf", "png".

    Raises:
        UserMistake: the folder cannot be written to.
    """
    base, target = Path(source), Path(source if folder is None else folder)
    records = {
        one.folder: load_record(inside(base, one.folder)) for one in found.points if one.record is not None
    }
    links = _links(found, base) if base == target else None
    sections = (_summary(found), _precision(found, records), _paths(found, records), links)
    keys = listing([words(axis.name) for axis in found.keys])
    return render(f"{found.name} over {keys}", sections, target, figures=figures)


def _summary(found: StoredSweep) -> Section:
    columns = (
        *map(_key_column, found.keys),
        Column("best result", cell=lambda one: one.design),
        Column("objective", "", significant(4), lambda one: one.objective),
        Column("lambda_min", "", significant(4), lambda one: one.lambda_min),
        Column("bound", "", significant(4), lambda one: one.upper_bound),
        Column("gap", "%", significant(2), lambda one: percent(one.gap)),
        Column("status", cell=lambda one: words(one.status)),
        Column("time", "s", significant(3), lambda one: one.seconds),
        Column("best", cell=lambda one: "best" if one.folder == found.best else "")
        if found.comparable
        else None,
    )
    return Section.of(
        "Points",
        SAY("points", len(found.points), found.comparable),
        Table.of(found.points, columns),
        _objective(found) if found.comparable else None,
        notices=(f"{one.label}: {one.message}" for one in found.points if one.objective is None),
    )


def _key_column(axis: SweptKey) -> Column:
    if not axis.numeric:
        return Column(words(axis.name), cell=lambda one: one.values[axis.key])
    unit = unit_text(axis.unit)
    return Column(words(axis.name), unit, lambda value: f"{value:g}", lambda one: one.numbers[axis.key])


def charted(found: StoredSweep, quantity: str, values: Mapping[str, float | None]) -> Chart | None:
    """Values by the points' folders over the key that changes most; None where they cannot be drawn.

    That is the numeric key of most values, or that of most words where none is numeric.

    Args:
        found: the sweep.
        quantity: that is drawn.
        values: by the points' folders.
    """
    keys = found.varied
    if not keys or all(value is None for value in values.values()):
        return None
    across = max(keys, key=lambda axis: (axis.numeric, len(axis.values)))
    lines: dict[str, dict[str, float | None]] = {}
    for one in found.points:
        name = ", ".join(_setting(axis, one) for axis in keys if axis is not across)
        lines.setdefault(name, {})[one.values[across.key]] = values.get(one.folder)
    numbers = {one.values[across.key]: one.numbers[across.key] or 0.0 for one in found.points}
    order = sorted(across.values, key=lambda text: numbers[text]) if across.numeric else across.values
    unit = f" [{unit_text(across.unit)}]" if across.unit else ""
    return Chart(
        f"{words(across.name)}{unit}",
        tuple(numbers[text] for text in order) if across.numeric else tuple(order),
        tuple((name, tuple(line[text] for text in order)) for name, line in lines.items()),
        quantity,
    )


def _setting(axis: SweptKey, one: SweptPoint) -> str:
    return f"{words(axis.name)} {one.values[axis.key]}"


def _objective(found: StoredSweep) -> Picture | None:
    chart = charted(found, "objective", {one.folder: one.objective for one in found.points})
    grid = len(found.varied) == 2 and all(axis.numeric for axis in found.varied)
    if chart is None or (len(chart.series) > SERIES and not grid):
        return None
    figure = charts.panels([chart]) if len(chart.series) <= SERIES else charts.heat_map(chart)
    return Picture("objective", f"Objective over {chart.across}", SAY("objective"), figure)


def _precision(found: StoredSweep, records: Mapping[str, Record]) -> Section | None:
    deviations = {folder: relative_deviations(record) for folder, record in records.items()}
    names = list(dict.fromkeys(name for one in deviations.values() for name in one))
    if not names:
        return None
    columns = (*map(_key_column, found.keys), *deviation_columns(names, lambda one: deviations[one.folder]))
    table = Table.of((one for one in found.points if deviations.get(one.folder)), columns)
    return Section.of("Predicted precision", SAY("deviations"), table, _deviations(found, names, deviations))


def _deviations(
    found: StoredSweep, names: Sequence[str], deviations: Mapping[str, Mapping[str, float | None]]
) -> Picture | None:
    drawn = []
    for name in names:
        values = {folder: one.get(name) for folder, one in deviations.items()}
        chart = charted(found, "std. deviation [%]", values)
        if chart is not None and len(chart.series) <= SERIES:
            drawn.append(replace(chart, title=words(name)))
    if not drawn:
        return None
    alt = f"Standard deviations over {drawn[0].across}"
    return Picture("precision", alt, SAY("each"), charts.panels(drawn))


def _paths(found: StoredSweep, records: Mapping[str, Record]) -> Section | None:
    best = [(one, records[one.folder]) for one in found.points if one.design is not None]
    # Those in one room share a figure and its scale.
    rooms: dict[str, tuple[Any, list[Any]]] = {}
    for one, record in best[:PATHS]:
        room, result = room_of(record), record.best
        if result is not None:
            title = "\n".join(_setting(axis, one) for axis in found.keys)
            rooms.setdefault(repr(room), (room, []))[1].append(replace(path_of(record, result), title=title))
    pictures = [
        Picture(f"paths_{number}", SAY("room", len(paths)), SAY("best"), path_figures.paths(paths, room))
        for number, (room, paths) in enumerate(rooms.values(), start=1)
    ]
    return Section.of("Best paths", SAY("drawn", PATHS, len(best)), *pictures) if best else None


def _links(found: StoredSweep, base: Path) -> Section | None:
    written = [one for one in found.points if (base / one.folder / PAGE).is_file()]
    links = tuple((one.label, f"{quote(one.folder)}/{PAGE}") for one in written)
    return Section("Reports of the points", links=links) if links else None
