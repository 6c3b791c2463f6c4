"""The robot played along its drives, in the HTML page."""

from __future__ import annotations

from typing import Any

from oed.record import Record, drive_of, rounded
from oed.report.reading import Entry, with_drive
from oed.report.section import Animation, Section

MARGIN = 0.08
"""Room around the paths and the workspace, as a share of their size."""


def player(record: Record) -> Section | None:
    """All drives, the best first, ready to be played."""
    entries = with_drive(record)
    if not entries:
        return None
    best = record.best
    entries.sort(key=lambda entry: best is None or entry["name"] != best["name"])
    drives = tuple(_drive(entry) for entry in entries)
    workspace = _rectangle(record)
    text = "Press Play in `report.html` to see the robot drive; the triangle's base is as wide as the track."
    animation = Animation(drives, _view(drives, workspace), workspace, _width(record))
    return Section("The drive, played", paragraphs=(text,), animation=animation)


def _drive(entry: Entry) -> dict[str, Any]:
    trajectory = drive_of(entry)
    assert trajectory is not None
    x, y, heading = (
        list(column) for column in zip(*(pose[:3] for pose in entry["drive"]["poses"]), strict=True)
    )
    return {
        "name": str(entry["name"]),
        "duration": trajectory.duration,
        "x": rounded(x, 4),
        "y": rounded(y, 4),
        "heading": rounded(heading, 4),
    }


def _rectangle(record: Record) -> tuple[float, float, float, float] | None:
    workspace = record.data["study"]["limits"].get("workspace")
    if workspace is None or workspace["kind"] != "rectangle":
        return None
    return (*workspace["x"], *workspace["y"])


def _view(
    drives: tuple[dict[str, Any], ...], workspace: tuple[float, float, float, float] | None
) -> tuple[float, float, float, float]:
    x = [value for drive in drives for value in drive["x"]] + list(workspace[:2] if workspace else ())
    y = [value for drive in drives for value in drive["y"]] + list(workspace[2:] if workspace else ())
    pad = MARGIN * max(max(x) - min(x), max(y) - min(y), 0.1)
    return min(x) - pad, max(x) + pad, min(y) - pad, max(y) + pad


def _width(record: Record) -> float:
    return float(record.data["study"]["robot"].get("track", 0.0))
