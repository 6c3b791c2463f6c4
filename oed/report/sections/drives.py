"""The drives: paths in the room, played, and the inputs and their rates over time."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from oed.foundation.text import Unit, count, listing, unit_text, words
from oed.records.record import Record
from oed.records.stored.parts import plain
from oed.records.stored.result import Result
from oed.report.figures import chart
from oed.report.figures import paths as path_figures
from oed.report.figures.driven import (
    Path,
    Room,
    path_of,
    robot_width,
    room_of,
    simulated_robots,
    view_of,
)
from oed.report.parts.inputs import Group, Series, groups_of, sampled, series_of
from oed.report.parts.prose import Prose
from oed.report.parts.reading import called, drivable, heading, in_place, runs_of, segments, time_scale
from oed.report.parts.section import Animation, Picture, Section
from oed.robots.limits.shapes import Outline
from oed.robots.models.arcs import finer

SAY = Prose("drives")
DASHES = ("solid", "dashed", "dash-dotted", "dotted")
"""How the lines of a panel are drawn, in their order."""
DECIMALS = 4
"""Of places and headings in the page [m, rad]."""


def paths(record: Record) -> Section | None:
    """The path of every drive to choose from, on one scale."""
    results = drivable(record)
    if not results:
        return None
    drives, room = [path_of(record, one) for one in results], room_of(record)
    figure = path_figures.paths(drives, room)
    picture = Picture("paths", SAY("paths", len(drives)), _caption(record, results, drives, room), figure)
    return Section("Paths in the workspace", figures=(picture,))


def best_path(record: Record) -> Picture | None:
    """The path of the best drive alone, with those of simulated robots; None without one."""
    if record.best is None:
        return None
    drive, room = path_of(record, record.best), room_of(record)
    drive = replace(drive, robots=simulated_robots(record))
    note = _caption(record, [record.best], [drive], room)
    return Picture("best_path", SAY("best_path"), note, path_figures.paths([drive], room))


def _caption(record: Record, results: list[Result], drives: list[Path], room: Room) -> str:
    parts = segments(record, record.study.space.samples)
    return SAY(
        "caption",
        room,
        any(one.sideways for one in drives),
        runs_of(record),
        count(parts, "segment") if parts else "",
        any(one.tows for one in drives),
        any(map(in_place, results)),
        not all(one.feasible for one in results),
        max(len(one.robots) for one in drives),
    )


def wheels(record: Record) -> Section | None:
    """Every drive's inputs by quantity, and their rates, between their limits."""
    results = drivable(record)
    if not results:
        return None
    first = results[0].drive
    assert first is not None
    groups = groups_of(record, len(first.coefficients[0]))
    every = (input_picture(record, group, results) for pair in groups for group in pair)
    pictures = tuple(one for one in every if one is not None)
    return Section(_title([values.limit for values, _ in groups]), figures=pictures)


def _drawn(record: Record, results: list[Result], group: Group) -> list[Series]:
    # Rates are drawn of what was designed; of all where nothing was.
    designed = [one for one in results if one.origin == "search"] if group.rates else []
    return [
        replace(series_of(one, group), title=heading(one, called(record, one))) for one in designed or results
    ]


def _title(quantities: list[str]) -> str:
    if quantities == ["wheel_speed"]:
        return "Wheel speeds and accelerations"
    return f"{listing([f'{words(one)}s' for one in quantities])}, and their rates".capitalize()


def input_picture(record: Record, group: Group, results: list[Result]) -> Picture | None:
    """A panel for each result: a group's inputs, or their rates, between their limits; None of no times.

    Args:
        record: that has the results.
        group: of inputs.
        results: that are drawn.
    """
    drives = [one for one in _drawn(record, results, group) if len(one.times)]
    if not drives:
        return None
    broken = not all(one.feasible for one in results)
    shorts, bounds = group.short_names, group.bounds(record)
    # A line alone needs no label.
    labels = (
        [f"{short} ({DASHES[at % len(DASHES)]})" for at, short in enumerate(shorts)] if shorts[1:] else []
    )
    called = dict(zip(group.names, shorts, strict=True))
    own = [(called[name], ends) for name, ends in group.own_bounds(record).items()]
    caption = SAY("inputs", group, labels, bounds, own, runs_of(record) > 1, broken)
    alt = f"{group.title.capitalize()} over time of {count(len(drives), 'drive')}"
    figure = chart.series(drives, group, labels, bounds, _times(record))
    return Picture(f"{group.limit}s", alt, caption, figure)


def _times(record: Record) -> Unit:
    # Of experiments in a unit that suits how long they are.
    return ("s", 1.0) if record.study.domain == "robots" else time_scale(record.study.space.duration)


def player(record: Record) -> Animation | None:
    """The drives to choose from run by run, the best first, ready to be played in the HTML page."""
    best, room, robot = record.best, room_of(record), record.robot_study.robot
    results = sorted(drivable(record), key=lambda one: best is None or one.name != best.name)
    if not results or results[0].drive is None:
        return None
    groups = [values for values, _ in groups_of(record, len(results[0].drive.coefficients[0]))]
    view = view_of(record, results)
    (left, bottom), (right, top) = view.low, view.high
    return Animation(
        drives=tuple(run for one in results for run in _runs(record, one, groups)),
        view=(float(left), float(right), float(bottom), float(top)),
        workspace=None if room.floor is None else _plain(room.floor),
        obstacles=tuple(map(_plain, room.hatched)),
        width=robot_width(record),
        body_radius=room.body_radius,
        trailer=robot.towed,
        charts=tuple(_chart(record, one) for one in groups),
        caption=SAY(
            "player", hasattr(robot, "track"), room.body_radius, robot.towed, len(simulated_robots(record))
        ),
    )


def _chart(record: Record, group: Group) -> dict[str, Any]:
    labels = group.short_names if len(group.names) > 1 else [""]
    title = f"{group.title} [{unit_text(group.unit)}]" if group.unit else group.title
    return {"title": title, "labels": labels, "limits": group.bounds(record)}


def _plain(outline: Outline) -> dict[str, Any]:
    # As the player draws it.
    if outline.radius:
        x, y = outline.points[0]
        return {"x": x, "y": y, "radius": outline.radius}
    return {"points": [list(point) for point in outline.points]}


def _runs(record: Record, result: Result, groups: list[Group]) -> list[dict[str, Any]]:
    drive = result.drive
    assert drive is not None
    best = record.best is not None and result.name == record.best.name
    others = simulated_robots(record) if best else ()
    found = []
    for number, poses in enumerate(drive.by_run, 1):
        title = called(record, result)
        name = f"{title}, run {number}" if drive.runs > 1 else title
        columns = zip(("x", "y", "heading", "trailer"), finer(poses[:, :4]).T, strict=False)
        places = {key: plain(column, DECIMALS) for key, column in columns}
        inputs = [
            [plain(column, DECIMALS) for column in sampled(result, group, number - 1).T] for group in groups
        ]
        timing = {"duration": drive.knots[-1] / drive.runs, "steps": drive.degree == 0}
        robots = [plain(robot[number - 1], DECIMALS) for robot in others]
        found.append({"name": name, **timing, **places, "inputs": inputs, "robots": robots})
    return found
