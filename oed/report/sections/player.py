"""The robot played along its drives, in the HTML page."""

from __future__ import annotations

from typing import Any

import numpy as np

from oed.record import Record, drive_of, rounded
from oed.report.driven import Array, path_of, poses_of
from oed.report.reading import Entry, with_drive
from oed.report.rooms import Room, corners, outline, robot_width, room_of
from oed.report.section import Animation, Section

MARGIN = 0.08
"""Room around the paths and the workspace, as a share of their size."""


def player(record: Record) -> Section | None:
    """All drives run by run, the best first, ready to be played."""
    entries = with_drive(record)
    if not entries:
        return None
    best = record.best
    entries.sort(key=lambda entry: best is None or entry["name"] != best["name"])
    room = room_of(record)
    floor, obstacles = outline(room.workspace), tuple(filter(None, map(outline, room.obstacles)))
    shapes = [floor, *obstacles] if floor else list(obstacles)
    animation = Animation(
        drives=tuple(run for entry in entries for run in _runs(entry)),
        view=_view(record, entries, [place for shape in shapes for place in corners(shape)], room),
        workspace=floor,
        obstacles=obstacles,
        width=robot_width(record),
        body_radius=room.body_radius,
        trailer=_trailer(record),
    )
    return Section("The drive, played", paragraphs=(_text(record, room),), animation=animation)


def _text(record: Record, room: Room) -> str:
    track = "track" in record.data["study"]["robot"]
    told = ["the triangle's base is as wide as the track" if track else "the triangle points where it heads"]
    told += ["the circle is its body"] if room.body_radius else []
    told += ["the bar is the trailer, from the hitch to its axle"] if _trailer(record) else []
    return f"Press Play in `report.html` to see the robot drive; {', '.join(told)}."


def _runs(entry: Entry) -> list[dict[str, Any]]:
    trajectory, runs = drive_of(entry), poses_of(entry)
    assert trajectory is not None
    names = [
        f"{entry['name']}, run {number + 1}" if len(runs) > 1 else str(entry["name"])
        for number in range(len(runs))
    ]
    return [
        _run(name, trajectory.duration / len(runs), poses) for name, poses in zip(names, runs, strict=True)
    ]


def _run(name: str, duration: float, poses: Array) -> dict[str, Any]:
    keys = ("x", "y", "heading", "trailer")
    columns = {key: rounded(column, 4) for key, column in zip(keys, poses[:, :4].T, strict=False)}
    return {"name": name, "duration": duration, **columns}


def _trailer(record: Record) -> tuple[float, float] | None:
    robot = record.data["study"]["robot"]
    if "trailer_length" not in robot:
        return None
    return float(robot.get("hitch_offset", 0.0)), float(robot["trailer_length"])


def _view(
    record: Record, entries: list[Entry], shapes: list[tuple[float, float]], room: Room
) -> tuple[float, float, float, float]:
    paths = [run.points for entry in entries for run in path_of(record, entry, sideways=False).runs]
    own = np.vstack(paths)
    points = np.vstack([own - room.body_radius, own + room.body_radius, np.reshape(shapes, (-1, 2))])
    (left, bottom), (right, top) = points.min(axis=0), points.max(axis=0)
    pad = MARGIN * max(right - left, top - bottom, 0.1)
    return float(left - pad), float(right + pad), float(bottom - pad), float(top + pad)
