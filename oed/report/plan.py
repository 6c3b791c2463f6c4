"""The page of a plan: the answer, and precision against duration, the room and the noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from oed.foundation.text import deviation_text, error_text, fixed, own_unit, shown_unit, words
from oed.records.stored.plan import PlannedAim, PlannedAxis, PlannedPoint, StoredPlan
from oed.report.figures import chart as charts
from oed.report.figures.chart import Chart
from oed.report.page import render
from oed.report.parts.prose import Prose
from oed.report.parts.section import Column, Picture, Section, Table

SAY = Prose("plan")
ACROSS = {
    "duration": "duration of the drive",
    "room": "longer side of the room",
    "noise": "size of the noise",
}
"""What is varied, in words."""
TIMES = "times the study's"
"""Unit of what is a share of the study's own."""


def write_plan(found: StoredPlan, folder: str | Path, figures: Sequence[str] = ()) -> Path:
    """Write report.html, report.md and figures/*.svg of a plan into `folder`; returns report.html.

    Args:
        found: the plan.
        folder: where to write.
        figures: formats in which figures are written beside the SVG of each: "pdf", "png".

    Raises:
        UserMistake: the folder cannot be written to.
    """
    target = Path(folder)
    tables = (_table(found, axis) for axis in found.axes)
    sections = (_summary(found), Section.of("The drives that were designed", *tables))
    return render(f"{found.name}: how long, or how many drives", sections, target, figures=figures)


def _summary(found: StoredPlan) -> Section:
    drawn = [one for axis in found.axes if (one := _chart(found, axis)) is not None]
    figure = None
    if drawn:
        across = [ACROSS[axis.name] for axis in found.axes]
        caption = SAY("caption", [one.name for one in found.aims], across)
        figure = Picture("precision", SAY("alt"), caption, charts.panels(drawn))
    wanted = [(words(one.name), deviation_text(one.wanted, one.unit)) for one in found.aims]
    title, _, more = found.answer.partition(". ")
    section = Section.of(title.rstrip("."), more, SAY("wanted", wanted), figure, SAY("adding"))
    return replace(section, brief=(len(section.paragraphs) - 1, 0))


def _chart(found: StoredPlan, axis: PlannedAxis) -> Chart | None:
    points = {float(f"{one.value:.3g}"): one for one in _with_own(found, axis) if one.errors}
    places = tuple(points)
    if len(places) < 2:
        return None
    single = len(found.aims) == 1
    name = f"standard error [{shown_unit(found.aims[0].unit)}]" if single else "share of what is wanted"
    lines = [
        (words(aim.name), tuple(_drawn(points[place], aim, single) for place in places)) for aim in found.aims
    ]
    level = found.aims[0].wanted * own_unit(found.aims[0].unit)[1] if single else 1.0
    unit = f" [{axis.unit}]" if axis.unit else f", {TIMES}"
    return Chart(f"{ACROSS[axis.name]}{unit}", places, tuple(lines), name, level=level)


def _with_own(found: StoredPlan, axis: PlannedAxis) -> list[PlannedPoint]:
    # The study's own drive among them, which was designed with the durations.
    if found.own is None:
        return axis.points
    others = [one for one in axis.points if one.value != axis.base]
    own = found.own.model_copy(update={"value": axis.base})
    return sorted([*others, own], key=lambda one: one.value)


def _drawn(one: PlannedPoint, aim: PlannedAim, single: bool) -> float | None:
    error = one.errors.get(aim.name)
    return None if error is None else error * own_unit(aim.unit)[1] if single else error / aim.wanted


def _table(found: StoredPlan, axis: PlannedAxis) -> Table:
    title = ACROSS[axis.name]
    columns = (
        Column(title, axis.unit or TIMES, lambda value: f"{value:.3g}", lambda one: one.value),
        *(_error_column(aim) for aim in found.aims),
        Column("drives needed", "", fixed(0), lambda one: one.drives),
        Column("status", cell=lambda one: words(one.status)),
    )
    return Table.of(_with_own(found, axis), columns, f"{title[0].upper()}{title[1:]}")


def _error_column(aim: PlannedAim) -> Column:
    factor = own_unit(aim.unit)[1]

    def error(one: PlannedPoint) -> float | None:
        return one.errors[aim.name] * factor if aim.name in one.errors else None

    return Column(f"standard error of {words(aim.name)}", shown_unit(aim.unit), error_text, error)
