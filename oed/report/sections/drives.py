"""The drives as figures: paths in the workspace, wheel speeds and accelerations over time."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from oed.record import Record
from oed.report.reading import (
    beacons,
    inputs_of,
    limit_bounds,
    on_the_spot,
    path_of,
    rates_of,
    segments,
    with_drive,
)
from oed.report.section import Picture, Section
from oed.report.wording import count, words

INPUTS = ("wheel_speed_right", "wheel_speed_left")


def paths(record: Record) -> Section | None:
    """Every drive's path in the workspace, on one scale."""
    drives = [path_of(record, entry) for entry in with_drive(record)]
    if not drives:
        return None
    workspace = record.data["study"]["limits"].get("workspace")
    parts = segments(record, record.data["study"]["trajectory"]["samples"])
    marks = f" Ticks across the path are where the {count(parts, 'segment')} meet." if parts else ""
    places = beacons(record)
    marks += " Triangles are beacons; one far outside is not shown." if len(places) else ""
    marks += " A drive on the spot is a dot." if any(map(on_the_spot, with_drive(record))) else ""
    area = "The shaded area is the workspace." if workspace else "The study sets no workspace."
    caption = (
        f"Path of the robot's origin. {area} Darker and wider is faster; arrows point where the robot "
        f"moves, hollow where it drives backwards.{marks}{_cut(record)}"
    )
    alt = f"Paths of {count(len(drives), 'drive')} in the x-y plane, coloured by speed"
    pictures = [Picture("paths", alt, caption, partial(_draw, "paths", drives, workspace, places))]
    if record.best is not None and len(drives) > 1:
        winner = [path_of(record, record.best)]
        note = f"The best drive, {record.best['name']}; the same as in the panel below."
        alt = f"Path of the best drive, {record.best['name']}"
        pictures.insert(
            0, Picture("best_path", alt, note, partial(_draw, "paths", winner, workspace, places))
        )
    return Section("Paths in the workspace", figures=tuple(pictures))


def wheels(record: Record) -> Section | None:
    """Every drive's wheel speeds and wheel accelerations, between their limits."""
    entries = [entry for entry in with_drive(record) if not entry["name"].endswith("_same_length")]
    if not entries:
        return None
    speeds, rates = [inputs_of(entry) for entry in entries], [rates_of(entry) for entry in entries]
    figures = (
        _series(record, "wheel_speed", "rad/s", speeds),
        _series(record, "wheel_acceleration", "rad/s^2", [series for series in rates if len(series.times)]),
    )
    return Section("Wheel speeds and accelerations", figures=figures)


def _series(record: Record, limit: str, unit: str, drives: list[Any]) -> Picture:
    bounds = limit_bounds(record, limit)
    quantity = words(limit)
    between = f"The lines marked are the limits of the {quantity}." if bounds else f"No {quantity} limit."
    labels = _labels(record, drives[0].values.shape[1])
    caption = f"{quantity.capitalize()}: {', '.join(labels)}. {between}{_cut(record)}"
    alt = f"{quantity.capitalize()} over time of {count(len(drives), 'drive')}"
    draw = partial(_draw, "series", drives, labels, quantity, unit, bounds)
    return Picture(f"{limit}s", alt, caption, draw)


def _cut(record: Record) -> str:
    broken = any(not entry["feasible"] for entry in with_drive(record))
    return " A drive far beyond a limit is cut off at the frame." if broken else ""


def _labels(record: Record, inputs: int) -> list[str]:
    names = INPUTS if inputs == len(INPUTS) else [f"input {index + 1}" for index in range(inputs)]
    dashes = ("solid", "dashed", "dash-dotted", "dotted")
    shorts = [words(name).removeprefix("wheel speed ") for name in names]
    return [f"{short} ({dash})" for short, dash in zip(shorts, dashes, strict=False)]


def _draw(panel: str, *data: Any) -> Any:
    # Imported late: the drawing library takes longer to load than the rest of a report.
    from oed.report import panels

    draw: Callable[..., Any] = getattr(panels, panel)
    return draw(*data)
