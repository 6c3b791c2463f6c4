"""The figures of paths: panels on one scale, with the room around them, speed as colour and a legend."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from oed.foundation.arrays import Array
from oed.report.figures import spec
from oed.report.figures.driven import Box, Path, Room, Run
from oed.report.figures.spec import FAINT, INK, WIDTH, Look, legend_columns, mark, stroke
from oed.report.parts.reading import NOWHERE
from oed.robots.limits.shapes import Outline
from oed.robots.models.arcs import finer

BEYOND = 0.3
"""How far beyond the limits a panel shows a drive that breaks them, as a share of the limits' width."""
ARROWS = 10
"""Direction arrows per path at most, at full size."""
APART = 0.11
"""Least distance between direction arrows, as a share of the panel's width."""
NUMBERS_APART = 0.08
"""Least distance between the numbers of two runs, as a share of the panel's width."""
MOST_TICKS = 40
"""Segments beyond which their boundaries are not marked."""
HANDLE = 0.45
"""Width of what stands before an entry of the legend, and of the gap after it [inch]."""
LINE = 0.28
"""Height of a further line of a legend or a title [inch]."""
MOST_COLUMNS = 4
"""Panels beside each other."""
SCALES, LETTERS = (1.0, 0.85, 0.8, 0.7), (10.0, 10.0, 10.0, 9.0)
"""Of marks and of titles, by the number of columns."""

ARROW = spec.Glyph(((-0.9, -0.75), (1.0, 0.0), (-0.9, 0.75), (-0.9, -0.75)))
POINTER = spec.Glyph(((0, 0), (1.0, 0), (0.72, 0.17), (1.0, 0), (0.72, -0.17)), moves=(0, 2))
"""A thin open arrow from the path to where the robot faces."""
TICK = spec.Glyph(((-1, 0), (1, 0)))

FLOOR: Look = {"facecolor": "#f4f4f1", "edgecolor": FAINT, "linewidth": 1.0, "zorder": 0}
GREY = "#4a4a4a"
OBSTACLE: Look = {"facecolor": "#c4c1ba", "edgecolor": GREY, "hatch": "////", "linewidth": 1.1, "zorder": 1.4}
BODY: Look = {"fill": False, "edgecolor": INK, "linewidth": 0.7, "zorder": 1.6}
BODY_KEY = mark("o", 13, "none", 0.7)
BEACON = mark("^", 7, "#e6c229", 0.9, 4)
START = mark("o", 9, "white", 1.6, 5)
END = mark("s", 5.5, INK, 0.8, 6)
SEGMENT = mark("|", 9, INK, 1.2, 3)
TRAILER = stroke(GREY, 1.5, 1.8, (1, 1.5))
ROBOT = stroke("#a9a9a4", 0.6, 1.5)
INSIDE = stroke("#8fb4d9", 0.7, 1.6)
OUTSIDE = stroke("#c2410c", 0.8, 1.7, (4, 1.6))
NOMINAL = stroke(INK, 1.6, 3)
HALO = {"facecolor": "white", "edgecolor": "none", "alpha": 0.6, "pad": 0.4}
NUMBER: Look = {"fontweight": "bold", "color": INK, "bbox": HALO, "zorder": 7}


def _arrow(forward: bool, angle: float = 0.0, scale: float = 1.0) -> Look:
    # Of a direction: filled where the robot drives forwards, hollow where backwards.
    return mark(replace(ARROW, angle=angle), 7 * scale, INK if forward else "white", 0.9, 4)


def _pointer(angle: float = 0.0, scale: float = 1.0) -> Look:
    # A thin open arrow towards the robot's heading.
    return mark(replace(POINTER, angle=angle), 32 * scale, "none", 1.1 * scale, 4.5, "#8a2d10")


def scaled(look: Look, scale: float) -> dict[str, Any]:
    """A mark so much smaller."""
    return {**look, "markersize": scale * look["markersize"]}


@dataclass(frozen=True)
class Bundle:
    """A drive's paths with the robots that may be, each (n, 2) [m].

    Attributes:
        title: the result's name, and how many robots violate the limits.
        inside, outside: of robots that satisfy the limits, and of those that violate them.
        nominal: of the nominal robot, run by run.
    """

    title: str
    inside: tuple[Array, ...]
    outside: tuple[Array, ...]
    nominal: tuple[Array, ...]


def paths(drives: Sequence[Path], room: Room) -> spec.Plot:
    """One panel per drive on one scale, its room behind it, speed as colour and width."""
    box = _view(drives, room)
    columns = min(2 if box.size[1] < 0.45 * box.size[0] else MOST_COLUMNS, len(drives))
    x, y, width, height = _scales(box, columns, len(drives))
    scale, letters = SCALES[columns - 1], LETTERS[columns - 1]
    panels = [
        spec.Panel([*surroundings(room), *_path(one, room, x, scale)], x, y, one.title, "box", letters)
        for one in drives
    ]
    keys = [*_path_keys(drives), *_room_keys(drives, room)]
    # Further lines of titles, row by row, and of the legend.
    titles = [one.title.count("\n") for one in drives]
    lines = sum(max(titles[first : first + columns]) for first in range(0, len(drives), columns))
    lines += -(-len(keys) // legend_columns([key.label for key in keys], width, HANDLE)) - 1
    return spec.Plot(
        panels,
        columns,
        width,
        height + LINE * lines,
        share="y",
        legend=spec.Legend(keys, 6, "lower", HANDLE, {"columnspacing": 1.2, "handletextpad": 0.3}),
        fastest=max(float(np.abs(run.speed).max()) for one in drives for run in one.runs),
    )


def bundles(cases: Sequence[Bundle], room: Room) -> spec.Plot:
    """One panel per drive on one scale: where robots with other parameters go."""
    every = Box.of(*(np.vstack([*one.inside, *one.outside, *one.nominal]) for one in cases))
    box = every if room.area is None else _in_sight(every, room.area)
    columns = min(2, len(cases))
    x, y, width, height = _scales(box, columns, len(cases))
    panels = [spec.Panel([*surroundings(room), *_bundle(one)], x, y, one.title, "box") for one in cases]
    looks = {"nominal robot": NOMINAL, "satisfies the limits": INSIDE, "violates them": OUTSIDE}
    keys = [spec.Key(label, {**look, "linewidth": 1.6}) for label, look in looks.items()]
    keys += [spec.Key("start", START), spec.Key("end", END)]
    legend = spec.Legend(keys, 6, "lower", HANDLE)
    return spec.Plot(panels, columns, width, height + LINE, share="y", legend=legend)


def _in_sight(every: Box, area: Box) -> Box:
    # An area, and of what goes beyond it as much as leaves it in sight.
    seen = every.within(area.padded(BEYOND * float(max(area.size))))
    return area if seen is None else Box.around([seen, area])


def _view(drives: Sequence[Path], room: Room) -> Box:
    # All that is feasible, and of what lies about and of drives that break limits as much as leaves that
    # in sight.
    areas = [] if room.area is None else [room.area]
    marks = [Box(place, place) for place in room.beacons]
    robots = [Box.of(*(run for runs in one.robots for run in runs)) for one in drives if one.robots]
    every = Box.around([*(_extent(one, room) for one in drives), *robots, *marks, *room.shapes, *areas])
    core = [*(_extent(one, room) for one in drives if one.feasible), *areas]
    if not core:
        return every
    box = Box.around(core)
    return every.within(box.padded(BEYOND * float(max(box.size)))) or box


def _extent(drive: Path, room: Room) -> Box:
    ends = Box.of(*(run.ends for run in drive.runs)).padded(room.body_radius)
    return Box.around([Box.of(*(run.points for run in drive.runs)), ends])


def _scales(box: Box, columns: int, panels: int) -> tuple[spec.Axis, spec.Axis, float, float]:
    # One box for all panels; the figure's height follows from its shape.
    seen = box.padded(0.06 * max(*box.size, 1e-3))
    x, y = axes(seen, 4 if columns > 2 else 6)
    ratio = float(seen.size[1] / seen.size[0])
    width = 5.6 if columns == 1 and ratio > 0.5 else WIDTH
    panel = (width - 1.4) / columns * min(ratio, 1.6)
    return x, y, width, -(-panels // columns) * (panel + 0.35) + 0.8


def axes(seen: Box, most: int = 6) -> tuple[spec.Axis, spec.Axis]:
    """The axes of a panel that shows a box, with so many ticks on the first at most."""
    (left, bottom), (right, top) = seen.low.tolist(), seen.high.tolist()
    return spec.Axis("x", "m", (left, right), most=most), spec.Axis("y", "m", (bottom, top), most=6)


def surroundings(room: Room) -> list[spec.Part]:
    """Workspace, obstacles and beacons; nothing of what has no outline."""
    floor = [] if room.floor is None else [spec.Shape(room.floor, FLOOR)]
    beacons = [spec.Line.through(room.beacons, BEACON)] if len(room.beacons) else []
    return [*floor, *(spec.Shape(one, OBSTACLE) for one in room.hatched), *beacons]


def _path(drive: Path, room: Room, across: spec.Axis, scale: float) -> Iterator[spec.Part]:
    # Every run with its start, end, direction and segments.
    assert across.ends is not None
    width = across.ends[1] - across.ends[0]
    for robot in drive.robots:
        yield from (spec.Line.through(path, ROBOT) for path in robot)
    for run in drive.runs:
        if run.trailer is not None:
            yield spec.Line.through(run.trailer, {**TRAILER, "linewidth": scale * TRAILER["linewidth"]})
        x, y, _ = finer(np.column_stack([run.x, run.y, run.heading])).T
        yield spec.Shades(x, y, np.repeat(run.speed, (len(x) - 1) // len(run.speed)), scale)
        yield from _segments(run, scale, drive.sideways)
        yield from _directions(run, width, scale, drive.sideways)
        for look, (end_x, end_y) in zip((START, END), run.ends, strict=True):
            yield spec.Line([end_x], [end_y], scaled(look, scale))
            if room.body_radius:
                yield spec.Shape(Outline(((end_x, end_y),), room.body_radius), BODY)
    if len(drive.runs) > 1:
        places = number_places(drive.runs, NUMBERS_APART * width)
        for number, place in enumerate(places, 1):
            yield spec.Note(str(number), place, 6 * scale, {**NUMBER, "fontsize": 10.5 * scale})


def _bundle(case: Bundle) -> Iterator[spec.Part]:
    for lines, look in ((case.inside, INSIDE), (case.outside, OUTSIDE), (case.nominal, NOMINAL)):
        for line in lines:
            yield spec.Line.through(line, look)
    for line in case.nominal:
        for look, end in ((START, line[0]), (END, line[-1])):
            yield spec.Line([end[0]], [end[1]], scaled(look, 0.8))


def _segments(run: Run, scale: float, sideways: bool) -> Iterator[spec.Part]:
    if len(run.edges) >= MOST_TICKS:
        return
    motion = np.arctan2(np.diff(run.y), np.diff(run.x))
    along = motion[run.edges] if sideways else run.heading[run.edges]
    for x, y, angle in zip(run.x[run.edges], run.y[run.edges], along + np.pi / 2, strict=True):
        look = mark(replace(TICK, angle=angle), 9 * scale, INK, 1.2 * scale, 3)
        yield spec.Line([x], [y], look)


def _directions(run: Run, width: float, scale: float, sideways: bool) -> Iterator[spec.Part]:
    travelled = np.cumsum(run.steps)
    if travelled[-1] < NOWHERE:
        return
    count = int(np.clip(travelled[-1] / (APART * width), 2, scale * ARROWS))
    shares = np.arange(count) / count
    for index in np.unique(np.searchsorted(travelled, (shares + 0.5 / count) * travelled[-1])):
        x, y = run.x[index : index + 2], run.y[index : index + 2]
        angle = float(np.arctan2(y[1] - y[0], x[1] - x[0]))
        yield spec.Line([x.mean()], [y.mean()], _arrow(bool(run.speed[index] >= 0), angle, scale))
    # Where it faces, between the arrows, from the start on.
    for index in np.unique(np.searchsorted(travelled, shares * travelled[-1])) if sideways else ():
        yield spec.Line([run.x[index]], [run.y[index]], _pointer(float(run.heading[index]), scale))


def number_places(runs: Sequence[Run], apart: float) -> list[tuple[float, float]]:
    """Where the number of each run is set [m]: at its start, or as far along it as keeps numbers apart."""
    places: list[tuple[float, float]] = []
    for run in runs:
        points = np.column_stack([run.x, run.y])
        gaps = [np.hypot(*(points - np.array(place)).T) for place in places]
        nearest = np.min(gaps, axis=0) if gaps else np.full(len(points), np.inf)
        free = np.flatnonzero(nearest >= apart)
        x, y = points[free[0] if len(free) else int(np.argmax(nearest))]
        places.append((float(x), float(y)))
    return places


def _path_keys(drives: Sequence[Path]) -> Iterator[spec.Key]:
    runs = [run for one in drives for run in one.runs]
    sideways = any(one.sideways for one in drives)
    yield spec.Key("start", START)
    yield spec.Key("end", END)
    if any(one.goes for one in drives):
        yield spec.Key("motion" if sideways else "forwards", _arrow(True))
        if sideways:
            yield spec.Key("heading", _pointer(scale=0.7))
    if any((run.speed < 0).any() for run in runs):
        yield spec.Key("backwards", _arrow(False))
    if any(0 < len(run.edges) < MOST_TICKS for run in runs):
        yield spec.Key("segments meet", SEGMENT)
    if any(one.robots for one in drives):
        yield spec.Key("other robots", {**ROBOT, "linewidth": 1.6})


def _room_keys(drives: Sequence[Path], room: Room) -> Iterator[spec.Key]:
    if len(room.beacons):
        yield spec.Key("beacon", BEACON)
    if room.obstacles:
        yield spec.Key("obstacle", OBSTACLE, patch=True)
    if room.body_radius:
        yield spec.Key("robot's body", BODY_KEY)
    if any(one.tows for one in drives):
        yield spec.Key("trailer's axle", TRAILER)
