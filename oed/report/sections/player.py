"""The robot played along its drives, in the HTML page."""

from __future__ import annotations

from typing import Any

from oed.records.numbers import rounded
from oed.records.record import Record, drive_of
from oed.report.figures.driven import Array, poses_of
from oed.report.parts.motion import view_of
from oed.report.parts.reading import Entry, with_drive
from oed.report.parts.rooms import Room, robot_width, room_of
from oed.report.parts.section import Animation, Section
from oed.robots.limits.outline import Outline


def player(record: Record) -> Section | None:
    """All drives run by run, the best first, ready to be played."""
    entries = with_drive(record)
    if not entries:
        return None
    best = record.best
    entries.sort(key=lambda entry: best is None or entry["name"] != best["name"])
    room = room_of(record)
    animation = Animation(
        drives=tuple(run for entry in entries for run in _runs(entry)),
        view=view_of(record, entries, room),
        workspace=None if room.floor is None else _plain(room.floor),
        obstacles=tuple(map(_plain, room.hatched)),
        width=robot_width(record),
        body_radius=room.body_radius,
        trailer=record.study.robot.towed,
    )
    return Section("The drive, played", paragraphs=(_text(record, room),), animation=animation)


def _plain(outline: Outline) -> dict[str, Any]:
    # As the player draws it.
    if outline.radius:
        x, y = outline.points[0]
        return {"x": x, "y": y, "radius": outline.radius}
    return {"points": [list(point) for point in outline.points]}


def _text(record: Record, room: Room) -> str:
    robot = record.study.robot
    track = hasattr(robot, "track")
    told = ["the triangle's base is as wide as the track" if track else "the triangle points where it heads"]
    told += ["the circle is its body"] if room.body_radius else []
    told += ["the bar is the trailer, from the hitch to its axle"] if robot.towed else []
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
