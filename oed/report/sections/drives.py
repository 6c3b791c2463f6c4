"""The drives: paths in the room, played, and the inputs and their rates over time."""

from __future__ import annotations

from typing import Any

from oed.foundation.text import count, listing, words
from oed.records.record import Record
from oed.records.stored.parts import plain
from oed.records.stored.result import Result
from oed.report.figures import chart
from oed.report.figures import paths as path_figures
from oed.report.figures.driven import Path, Room, path_of, robot_width, room_of, view_of
from oed.report.parts.inputs import Group, Series, groups_of, series_of
from oed.report.parts.prose import Prose
from oed.report.parts.reading import in_place, runs_of, segments, with_drive
from oed.report.parts.section import Animation, Picture, Section
from oed.robots.limits.shapes import Outline

SAY = Prose("drives")
DASHES = ("solid", "dashed", "dash-dotted", "dotted")
"""How the lines of a panel are drawn, in their order."""
DECIMALS = 4
"""Of places and headings in the page [m, rad]."""


def paths(record: Record) -> Section | None:
    """Every drive's path in the room, on one scale."""
    results = with_drive(record)
    if not results:
        return None
    drives, room = [path_of(record, one) for one in results], room_of(record)
    figure = path_figures.paths(drives, room)
    pictures = [Picture("paths", SAY("paths", len(drives)), _caption(record, drives, room), figure)]
    if record.best is not None and len(drives) > 1:
        best = path_figures.paths([path_of(record, record.best)], room)
        alt, note = (SAY(which, record.best.name) for which in ("best_path", "best_note"))
        pictures.insert(0, Picture("best_path", alt, note, best))
    return Section("Paths in the workspace", figures=tuple(pictures))


def _caption(record: Record, drives: list[Path], room: Room) -> str:
    parts = segments(record, record.study.trajectory.samples)
    return SAY(
        "caption",
        room,
        any(one.sideways for one in drives),
        runs_of(record),
        count(parts, "segment") if parts else "",
        any(one.tows for one in drives),
        any(map(in_place, with_drive(record))),
        _broken(record),
    )


def _broken(record: Record) -> bool:
    return any(not one.feasible for one in with_drive(record))


def wheels(record: Record) -> Section | None:
    """Every drive's inputs by quantity, and their rates, between their limits."""
    results = [one for one in with_drive(record) if not one.name.endswith("_same_length")]
    if not results:
        return None
    first = results[0].drive
    assert first is not None
    groups = groups_of(record, len(first.coefficients[0]))
    pictures = [
        _picture(record, group, drives)
        for pair in groups
        for group in pair
        if (drives := [one for one in (series_of(each, group) for each in results) if len(one.times)])
    ]
    return Section(_title([values.limit for values, _ in groups]), figures=tuple(pictures))


def _title(quantities: list[str]) -> str:
    if quantities == ["wheel_speed"]:
        return "Wheel speeds and accelerations"
    return f"{listing([f'{words(one)}s' for one in quantities])}, and their rates".capitalize()


def _picture(record: Record, group: Group, drives: list[Series]) -> Picture:
    shorts, bounds = group.short_names, group.bounds(record)
    # A line alone needs no label.
    labels = (
        [f"{short} ({DASHES[at % len(DASHES)]})" for at, short in enumerate(shorts)] if shorts[1:] else []
    )
    called = dict(zip(group.names, shorts, strict=True))
    own = [(called[name], ends) for name, ends in group.own_bounds(record).items()]
    caption = SAY("inputs", group, labels, bounds, own, runs_of(record) > 1, _broken(record))
    alt = f"{group.title.capitalize()} over time of {count(len(drives), 'drive')}"
    return Picture(f"{group.limit}s", alt, caption, chart.series(drives, group, labels, bounds))


def player(record: Record) -> Section | None:
    """All drives run by run, the best first, ready to be played in the HTML page."""
    best, room, robot = record.best, room_of(record), record.study.robot
    results = sorted(with_drive(record), key=lambda one: best is None or one.name != best.name)
    if not results:
        return None
    view = view_of(record, results)
    (left, bottom), (right, top) = view.low, view.high
    animation = Animation(
        drives=tuple(run for one in results for run in _runs(one)),
        view=(float(left), float(right), float(bottom), float(top)),
        workspace=None if room.floor is None else _plain(room.floor),
        obstacles=tuple(map(_plain, room.hatched)),
        width=robot_width(record),
        body_radius=room.body_radius,
        trailer=robot.towed,
    )
    text = SAY("player", hasattr(robot, "track"), room.body_radius, robot.towed)
    return Section("The drive, played", paragraphs=(text,), animation=animation)


def _plain(outline: Outline) -> dict[str, Any]:
    # As the player draws it.
    if outline.radius:
        x, y = outline.points[0]
        return {"x": x, "y": y, "radius": outline.radius}
    return {"points": [list(point) for point in outline.points]}


def _runs(result: Result) -> list[dict[str, Any]]:
    drive = result.drive
    assert drive is not None
    found = []
    for number, poses in enumerate(drive.by_run, 1):
        name = f"{result.name}, run {number}" if drive.runs > 1 else result.name
        columns = zip(("x", "y", "heading", "trailer"), poses[:, :4].T, strict=False)
        places = {key: plain(column, DECIMALS) for key, column in columns}
        found.append({"name": name, "duration": drive.knots[-1] / drive.runs, **places})
    return found
