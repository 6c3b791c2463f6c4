"""The page of a sweep: its points side by side, and how what they reach depends on what was varied."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import quote

from oed.foundation.files import inside
from oed.foundation.text import count, listing, significant, unit_text, words
from oed.records.record import Record, load_record
from oed.report.comparison import relative_deviations
from oed.report.figures import chart as chart_figures
from oed.report.figures import paths as path_figures
from oed.report.figures.chart import Chart
from oed.report.figures.driven import path_of, room_of
from oed.report.page import NAME, render
from oed.report.parts.section import Picture, Section
from oed.report.parts.tables import Cell, Column, Table

Row = Mapping[str, Any]

SERIES = 6
"""Lines, or bars side by side, beyond which a figure could not be read."""
PAGE = f"{NAME}.html"
PATHS = 12
"""Paths that are drawn."""


def write_sweep(data: Mapping[str, Any], source: str | Path, folder: str | Path | None = None) -> Path:
    """Write report.html, report.md and figures/*.svg of a sweep; returns report.html.

    Args:
        data: what sweep.json holds.
        source: the sweep's folder, where its records are.
        folder: where to write; the sweep's own by default.

    Raises:
        UserMistake: the folder cannot be written to.
    """
    base, target = Path(source), Path(source if folder is None else folder)
    records = {
        str(row["folder"]): load_record(inside(base, row["folder"]))
        for row in data["points"]
        if row["record"] is not None
    }
    sections = [
        _summary(data),
        _precision(data, records),
        _paths(data, records),
        _links(data, base) if base == target else None,
    ]
    keys = listing([words(axis["name"]) for axis in data["keys"]])
    return render(f"{data['name']} over {keys}", [one for one in sections if one is not None], target)


def _summary(data: Mapping[str, Any]) -> Section:
    points = data["points"]
    meaning = (
        "The largest objective is marked."
        if data["comparable"]
        else "Their objectives mean different things and do not compare; standard deviations do."
    )
    text = f"The best drive of each of {count(len(points), 'point')}. {meaning}"
    columns = (
        *_key_columns(data),
        Column("best result"),
        Column("objective", "", significant(4)),
        Column("lambda_min", "", significant(4)),
        Column("bound", "", significant(4)),
        Column("gap", "%", significant(2)),
        Column("status"),
        Column("time", "s", significant(3)),
        *((Column("best"),) if data["comparable"] else ()),
    )
    rows = tuple(_summary_row(data, row) for row in points)
    missing = tuple(f"{row['label']}: {row['message']}" for row in points if row["objective"] is None)
    figures = _objective_figures(data) if data["comparable"] else ()
    table = Table(columns, rows)
    return Section("Points", paragraphs=(text,), tables=(table,), figures=figures, notices=missing)


def _key_columns(data: Mapping[str, Any]) -> tuple[Column, ...]:
    return tuple(
        Column(words(axis["name"]), unit_text(axis["unit"]), lambda value: f"{value:g}")
        if axis["numeric"]
        else Column(words(axis["name"]))
        for axis in data["keys"]
    )


def _key_cells(data: Mapping[str, Any], row: Row) -> tuple[Cell, ...]:
    return tuple(
        row["numbers"][axis["key"]] if axis["numeric"] else row["values"][axis["key"]]
        for axis in data["keys"]
    )


def _summary_row(data: Mapping[str, Any], row: Row) -> tuple[Cell, ...]:
    best = ("best" if row["folder"] == data["best"] else "",) if data["comparable"] else ()
    gap = None if row["gap"] is None else 100 * row["gap"]
    numbers = (row["objective"], row["lambda_min"], row["upper_bound"], gap)
    status = words(row["status"])
    return (*_key_cells(data, row), row["design"], *numbers, status, row["seconds"], *best)


def charted(data: Mapping[str, Any], quantity: str, values: Mapping[str, float | None]) -> Chart | None:
    """Values by the points' folders over the key that tells most; None where they cannot be drawn.

    That is the numeric key of most values, or that of most words where none is numeric.
    """
    keys = [axis for axis in data["keys"] if len(axis["values"]) > 1]
    if not keys or all(value is None for value in values.values()):
        return None
    across = max(keys, key=lambda axis: (axis["numeric"], len(axis["values"])))
    others = [axis for axis in keys if axis is not across]
    found: dict[str, dict[str, float | None]] = {}
    for row in data["points"]:
        name = ", ".join(f"{words(axis['name'])} {row['values'][axis['key']]}" for axis in others)
        found.setdefault(name, {})[row["values"][across["key"]]] = values.get(row["folder"])
    places = across["values"]
    numbers = {row["values"][across["key"]]: row["numbers"][across["key"]] for row in data["points"]}
    order = sorted(places, key=lambda text: numbers[text]) if across["numeric"] else list(places)
    unit = f" [{unit_text(across['unit'])}]" if across["unit"] else ""
    return Chart(
        f"{words(across['name'])}{unit}",
        tuple(numbers[text] for text in order) if across["numeric"] else tuple(order),
        tuple((name, tuple(line[text] for text in order)) for name, line in found.items()),
        quantity,
    )


def _objective_figures(data: Mapping[str, Any]) -> tuple[Picture, ...]:
    chart = charted(data, "objective", {row["folder"]: row["objective"] for row in data["points"]})
    if chart is None:
        return ()
    varied = [axis for axis in data["keys"] if len(axis["values"]) > 1]
    grid = len(varied) == 2 and all(axis["numeric"] for axis in varied)
    if len(chart.series) > SERIES and not grid:
        return ()
    caption = "Objective of the best drive; there is none where no point is drawn."
    draw = partial(_draw, "lines" if len(chart.series) <= SERIES else "heat_map", chart)
    return (Picture("objective", f"Objective over {chart.across}", caption, draw),)


def _draw(kind: str, *data: Any) -> Any:
    return getattr(chart_figures, kind)(*data)


def _precision(data: Mapping[str, Any], records: Mapping[str, Record]) -> Section | None:
    found = {folder: relative_deviations(record) for folder, record in records.items()}
    names = list(dict.fromkeys(name for one in found.values() for name in one))
    if not names:
        return None
    columns = (*_key_columns(data), *(Column(words(name), "%", significant(3)) for name in names))
    rows = tuple(
        (*_key_cells(data, row), *(found[row["folder"]].get(name) for name in names))
        for row in data["points"]
        if found.get(row["folder"])
    )
    charts = [
        charted(data, "std. deviation [%]", {folder: one.get(name) for folder, one in found.items()})
        for name in names
    ]
    drawn = [
        replace(chart, title=words(name))
        for name, chart in zip(names, charts, strict=True)
        if chart is not None and len(chart.series) <= SERIES
    ]
    text = "Predicted standard deviations of one best drive, as shares of the nominal values."
    figures: tuple[Picture, ...] = ()
    if drawn:
        draw = partial(_draw, "panels", drawn)
        alt = f"Standard deviations over {drawn[0].across}"
        figures = (Picture("precision", alt, "Predicted standard deviation of each parameter.", draw),)
    return Section("Predicted precision", paragraphs=(text,), tables=(Table(columns, rows),), figures=figures)


def _paths(data: Mapping[str, Any], records: Mapping[str, Record]) -> Section | None:
    best = [(row, records[row["folder"]]) for row in data["points"] if row["design"] is not None]
    drawn = [(row, record, record.best) for row, record in best][:PATHS]
    if not drawn:
        return None
    paths = [
        (replace(path_of(record, entry), title=_title(data, row)), room_of(record))
        for row, record, entry in drawn
        if entry is not None
    ]
    # Those in one room share a figure and its scale.
    groups: list[tuple[Any, list[Any]]] = []
    for path, room in paths:
        same = [group for known, group in groups if repr(known) == repr(room)]
        if same:
            same[0].append(path)
        else:
            groups.append((room, [path]))
    pictures = tuple(
        Picture(
            f"paths_{index + 1}",
            f"Paths of {count(len(group), 'best drive')} in the same room",
            "Best drives; colour and width tell the speed.",
            partial(_draw_paths, group, room),
        )
        for index, (room, group) in enumerate(groups)
    )
    rest = len(best) - len(drawn)
    notes = (f"The first {PATHS} of {len(best)}; the others are in their own records.",) if rest else ()
    return Section("Best paths", paragraphs=notes, figures=pictures)


def _title(data: Mapping[str, Any], row: Row) -> str:
    return "\n".join(f"{words(axis['name'])} {row['values'][axis['key']]}" for axis in data["keys"])


def _draw_paths(paths: Sequence[Any], room: Any) -> Any:
    return path_figures.paths(paths, room)


def _links(data: Mapping[str, Any], base: Path) -> Section | None:
    written = [row for row in data["points"] if (base / row["folder"] / PAGE).is_file()]
    if not written:
        return None
    links = tuple((str(row["label"]), f"{quote(row['folder'])}/{PAGE}") for row in written)
    return Section("Reports of the points", links=links)
