"""The drives as figures: paths in the room, and the inputs and their rates over time."""

from __future__ import annotations

from functools import partial
from typing import Any

from oed.foundation.text import count, listing, unit_text, words
from oed.records.record import Record
from oed.report.figures.driven import Path, path_of, paths_of
from oed.report.parts.inputs import (
    Group,
    Series,
    groups_of,
    inputs_of,
    limit_bounds,
    own_bounds,
    rates_of,
    short_names,
)
from oed.report.parts.reading import on_the_spot, runs_of, segments, with_drive
from oed.report.parts.rooms import Room, body_text, room_of, surroundings_text
from oed.report.parts.section import Picture, Section

DASHES = ("solid", "dashed", "dash-dotted", "dotted")
"""How the lines of a panel are drawn, in their order."""


def paths(record: Record) -> Section | None:
    """Every drive's path in the room, on one scale."""
    entries = with_drive(record)
    if not entries:
        return None
    drives, room = paths_of(record, entries), room_of(record)
    alt = f"Paths of {count(len(drives), 'drive')} in the x-y plane, coloured by speed"
    pictures = [Picture("paths", alt, _caption(record, drives, room), partial(_draw_paths, drives, room))]
    if record.best is not None and len(drives) > 1:
        winner = [path_of(record, record.best)]
        note = f"The best drive, {record.best['name']}; the same as in the panel below."
        alt = f"Path of the best drive, {record.best['name']}"
        pictures.insert(0, Picture("best_path", alt, note, partial(_draw_paths, winner, room)))
    return Section("Paths in the workspace", figures=tuple(pictures))


def _caption(record: Record, drives: list[Path], room: Room) -> str:
    arrows = "hollow where it drives backwards"
    if any(drive.sideways for drive in drives):
        arrows = "thin open ones where it faces"
    sentences = [
        f"Path of the robot's origin. {surroundings_text(room)} Darker and wider is faster; arrows point "
        f"where the robot moves, {arrows}.",
        _runs(record),
        _ticks(record),
        body_text(room),
        "Dotted is the path of the trailer's axle." if _with_trailer(drives) else "",
        "Triangles are beacons; one far outside is not shown." if len(room.beacons) else "",
        "A drive on the spot is a dot." if any(map(on_the_spot, with_drive(record))) else "",
        _cut(record),
    ]
    return " ".join(filter(None, sentences))


def _runs(record: Record) -> str:
    runs = runs_of(record)
    return f"Each drive is in {runs} runs, numbered at or just after their starts." if runs > 1 else ""


def _ticks(record: Record) -> str:
    parts = segments(record, record.data["study"]["trajectory"]["samples"])
    if not parts:
        return ""
    each = " of each run" if runs_of(record) > 1 else ""
    return f"Ticks across the path are where the {count(parts, 'segment')}{each} meet."


def _with_trailer(drives: list[Path]) -> bool:
    return any(run.trailer is not None for drive in drives for run in drive.runs)


def wheels(record: Record) -> Section | None:
    """Every drive's inputs by quantity, and their rates, between their limits."""
    entries = [entry for entry in with_drive(record) if not entry["name"].endswith("_same_length")]
    if not entries:
        return None
    groups = groups_of(record, len(entries[0]["drive"]["coefficients"][0]))
    drawn = []
    for values, rates in groups:
        drawn.append((values, [inputs_of(entry, values) for entry in entries]))
        drawn.append((rates, [rates_of(entry, rates) for entry in entries]))
    figures = [_picture(record, group, [one for one in series if len(one.times)]) for group, series in drawn]
    pictures = tuple(picture for picture in figures if picture is not None)
    return Section(_title([values.limit for values, _ in groups]), figures=pictures)


def _title(quantities: list[str]) -> str:
    if quantities == ["wheel_speed"]:
        return "Wheel speeds and accelerations"
    return f"{listing([f'{words(one)}s' for one in quantities])}, and their rates".capitalize()


def _picture(record: Record, group: Group, drives: list[Series]) -> Picture | None:
    if not drives:
        return None
    bounds, name, labels = limit_bounds(record, group), words(group.limit), _labels(group)
    lines = f"{name.capitalize()}: {', '.join(labels)}." if labels else f"{name.capitalize()}."
    gaps = "Runs follow each other, with a line between them." if runs_of(record) > 1 else ""
    told = (lines, _limits(record, group), gaps, _cut(record))
    alt = f"{name.capitalize()} over time of {count(len(drives), 'drive')}"
    draw = partial(_draw_series, drives, labels, name, group.unit, bounds)
    return Picture(f"{group.limit}s", alt, " ".join(filter(None, told)), draw)


def _limits(record: Record, group: Group) -> str:
    own, name = own_bounds(record, group), words(group.limit)
    if limit_bounds(record, group):
        return f"The lines marked are the limits of the {name}."
    if not own:
        return f"No {name} limit."
    shorts = dict(zip(group.names, short_names(group), strict=True))
    each = [f"{shorts[one]} {low:g} to {high:g} {unit_text(group.unit)}" for one, (low, high) in own.items()]
    return f"No limit is drawn, as each has its own: {', '.join(each)}."


def _cut(record: Record) -> str:
    broken = any(not entry["feasible"] for entry in with_drive(record))
    return "A drive far beyond a limit is cut off at the frame." if broken else ""


def _labels(group: Group) -> list[str]:
    # A line alone needs none.
    if len(group.names) == 1:
        return []
    return [f"{short} ({DASHES[index % len(DASHES)]})" for index, short in enumerate(short_names(group))]


def _draw_paths(drives: list[Path], room: Room) -> Any:
    # Imported late: the drawing library takes longer to load than the rest of a report.
    from oed.report.figures import path_panels

    return path_panels.paths(drives, room)


def _draw_series(*data: Any) -> Any:
    from oed.report.figures import panels

    return panels.series(*data)
