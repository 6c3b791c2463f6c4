"""The page of a sweep: which of its points is better, and how precision depends on what was varied."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from oed.foundation.files import inside
from oed.foundation.text import listing, significant, unit_text, words
from oed.records.record import load_record
from oed.records.stored.sweep import StoredSweep, SweptKey, SweptPoint
from oed.report import contenders
from oed.report.contenders import (
    Contender,
    best_paths,
    dots,
    error_columns,
    finding,
    parameters_of,
    shared_unit,
    vocabulary_of,
)
from oed.report.figures import chart as charts
from oed.report.figures.chart import Chart
from oed.report.page import NAME, address_of, render
from oed.report.parts.prose import Prose
from oed.report.parts.section import Cell, Column, Link, Picture, Section, Table, percent
from oed.report.parts.spoken import in_words

SAY = Prose("sweep")
SERIES = 6
"""Lines beyond which a figure could not be read."""
Designs = Mapping[str, Contender]
"""By the points' folders."""


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
    designs = {
        one.folder: Contender(
            ", ".join(_setting(axis, one) for axis in found.keys),
            load_record(inside(base, one.folder)),
            address_of(base / one.folder / f"{NAME}.html", target),
        )
        for one in found.points
        if one.record is not None
    }
    some = list(designs.values())
    made = (_summary(found, designs), best_paths(some), _searches(found))
    sections = (in_words(one, vocabulary_of(some)) for one in made)
    keys = listing([words(axis.name) for axis in found.keys])
    return render(f"{found.name} over {keys}", sections, target, figures=figures)


def _summary(found: StoredSweep, designs: Designs) -> Section:
    some = list(designs.values())
    leader = designs.get(found.best or "") if found.comparable else None
    title, said = finding(some, leader)
    columns = (
        *(_key_column(axis, designs if number == 0 else {}) for number, axis in enumerate(found.keys)),
        *error_columns(some, lambda one: designs[one.folder]),
    )
    shown = (one for one in found.points if one.folder in designs)
    table = Table.of(shown, columns, SAY("errors"), sortable=True)
    return Section.of(
        title,
        said,
        _lines(found, designs) or dots(some, leader),
        table if some else None,
        notices=(f"{one.label}: {one.message}" for one in found.points if one.objective is None),
    )


def _key_column(axis: SweptKey, designs: Designs) -> Column:
    # A word, or a number; the first leads to the reports.
    unit = unit_text(axis.unit) if axis.numeric else ""

    def cell(one: SweptPoint) -> Cell:
        page = designs[one.folder].page if one.folder in designs else ""
        number = one.numbers[axis.key] if axis.numeric else None
        text = one.values[axis.key] if number is None else f"{number:g}"
        return Link(text, page, number) if page else text if number is None else number

    return Column(words(axis.name), unit, (lambda value: f"{value:g}") if axis.numeric else None, cell)


def _searches(found: StoredSweep) -> Section:
    columns = (
        *(_key_column(axis, {}) for axis in found.keys),
        Column("best result", cell=lambda one: one.design),
        Column("objective", "", significant(4), lambda one: one.objective),
        Column("lambda_min", "", significant(4), lambda one: one.lambda_min),
        Column("bound", "", significant(4), lambda one: one.upper_bound),
        Column("gap", "%", significant(2), lambda one: percent(one.gap)),
        Column("status", cell=lambda one: words(one.status)),
        Column("search time", "s", significant(3), lambda one: one.seconds),
        Column("best", cell=lambda one: "best" if one.folder == found.best else "")
        if found.comparable
        else None,
    )
    section = Section.of(
        "What the searches found",
        SAY("points", len(found.points), found.comparable),
        Table.of(found.points, columns),
        _objective(found) if found.comparable else None,
    )
    return replace(section, folded=True)


def charted(found: StoredSweep, quantity: str, values: Mapping[str, float | None]) -> Chart | None:
    """Values by the points' folders over the numeric key of most values; None where they cannot be drawn.

    Args:
        found: the sweep.
        quantity: that is drawn.
        values: by the points' folders.
    """
    keys = found.varied
    numeric = [axis for axis in keys if axis.numeric]
    if not numeric or all(value is None for value in values.values()):
        return None
    across = max(numeric, key=lambda axis: len(axis.values))
    lines: dict[str, dict[str, float | None]] = {}
    for one in found.points:
        name = ", ".join(_setting(axis, one) for axis in keys if axis is not across)
        lines.setdefault(name, {})[one.values[across.key]] = values.get(one.folder)
    numbers = {one.values[across.key]: one.numbers[across.key] or 0.0 for one in found.points}
    order = sorted(across.values, key=lambda text: numbers[text])
    unit = f" [{unit_text(across.unit)}]" if across.unit else ""
    return Chart(
        f"{words(across.name)}{unit}",
        tuple(numbers[text] for text in order),
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


def _lines(found: StoredSweep, designs: Designs) -> Picture | None:
    # Of each parameter over what was varied; None where that is words, or of too many lines.
    drawn = []
    for one in parameters_of(designs.values())[: contenders.MOST_SCALES]:
        unit, factor = shared_unit(one, designs.values())
        sizes = {folder: design.error(one) for folder, design in designs.items()}
        values = {folder: None if size is None else factor * size for folder, size in sizes.items()}
        chart = charted(found, f"standard error [{unit_text(unit)}]" if unit else "standard error", values)
        if chart is not None and len(chart.series) <= SERIES:
            drawn.append(replace(chart, title=words(one.name)))
    if not drawn:
        return None
    return Picture("precision", f"Standard errors over {drawn[0].across}", SAY("lines"), charts.panels(drawn))
