"""The figures of paths: panels on one scale, with the room around them, speed as colour and a legend."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from oed.report.figures.driven import Array, Box, Path, Room, Run
from oed.report.figures.spec import (
    FAINT,
    INK,
    WIDTH,
    Axis,
    Glyph,
    Key,
    Legend,
    Line,
    Look,
    Note,
    Panel,
    Part,
    Plot,
    Shades,
    Shape,
    legend_columns,
)
from oed.report.parts.reading import NOWHERE
from oed.robots.limits.outline import Outline

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
SCALES, LETTERS = (1.0, 0.85, 0.7), (10.0, 10.0, 9.0)
"""Of marks and of titles, by the number of columns."""

ARROW = Glyph(((-0.9, -0.75), (1.0, 0.0), (-0.9, 0.75), (-0.9, -0.75)))
POINTER = Glyph(((0, 0), (1.0, 0), (0.72, 0.17), (1.0, 0), (0.72, -0.17)), moves=(0, 2))
"""A thin open arrow from the path to where the robot faces."""
TICK = Glyph(((-1, 0), (1, 0)))

FLOOR: Look = {"facecolor": "#f4f4f1", "edgecolor": FAINT, "linewidth": 1.0, "zorder": 0}
OBSTACLE: Look = {
    "facecolor": "#c4c1ba",
    "edgecolor": "#4a4a4a",
    "hatch": "////",
    "linewidth": 1.1,
    "zorder": 1.4,
}
MARK: dict[str, Any] = {"markeredgecolor": INK, "linestyle": "none"}
BEACON: Look = {
    **MARK,
    "marker": "^",
    "markersize": 7,
    "markerfacecolor": "#e6c229",
    "markeredgewidth": 0.9,
    "zorder": 4,
}
START: dict[str, Any] = {
    **MARK,
    "marker": "o",
    "markersize": 9,
    "markerfacecolor": "white",
    "markeredgewidth": 1.6,
    "zorder": 5,
}
END: dict[str, Any] = {
    **MARK,
    "marker": "s",
    "markersize": 5.5,
    "markerfacecolor": INK,
    "markeredgewidth": 0.8,
    "zorder": 6,
}
BODY: Look = {"fill": False, "edgecolor": INK, "linewidth": 0.7, "zorder": 1.6}
BODY_KEY: Look = {
    **MARK,
    "marker": "o",
    "markersize": 13,
    "markeredgewidth": 0.7,
    "markerfacecolor": "none",
}
TRAILER: dict[str, Any] = {"color": "#4a4a4a", "linestyle": (0, (1, 1.5)), "linewidth": 1.5, "zorder": 1.8}
SEGMENT: Look = {
    "color": INK,
    "marker": "|",
    "markersize": 9,
    "markeredgewidth": 1.2,
    "linestyle": "none",
}
INSIDE: Look = {"color": "#8fb4d9", "linewidth": 0.7, "zorder": 1.6}
OUTSIDE: Look = {"color": "#c2410c", "linewidth": 0.8, "linestyle": (0, (4, 1.6)), "zorder": 1.7}
NOMINAL: Look = {"color": INK, "linewidth": 1.6, "zorder": 3}
NUMBER: Look = {
    "fontweight": "bold",
    "color": INK,
    "bbox": {"facecolor": "white", "edgecolor": "none", "alpha": 0.6, "pad": 0.4},
    "zorder": 7,
}


def arrow(forward: bool, angle: float = 0.0, scale: float = 1.0) -> Look:
    """A direction arrow: filled where the robot drives forwards, hollow where backwards."""
    face = {"markerfacecolor": INK if forward else "white", "markeredgewidth": 0.9}
    return {**MARK, **face, "marker": replace(ARROW, angle=angle), "markersize": 7 * scale}


def pointer(angle: float = 0.0, scale: float = 1.0) -> Look:
    """A thin open arrow towards the robot's heading."""
    edge = {"markeredgecolor": "#8a2d10", "markeredgewidth": 1.1 * scale, "linestyle": "none"}
    marker = {"marker": replace(POINTER, angle=angle), "markersize": 32 * scale, "markerfacecolor": "none"}
    return {**marker, **edge, "zorder": 4.5}


def scaled(look: Look, scale: float) -> dict[str, Any]:
    """A mark so much smaller."""
    return {**look, "markersize": scale * look["markersize"]}


@dataclass(frozen=True)
class Bundle:
    """A drive's paths with the robots that may be, each (n, 2) [m].

    Attributes:
        title: the result's name, and how many robots leave the limits.
        inside, outside: of robots that keep the limits, and of those that leave them.
        nominal: of the nominal robot, run by run.
    """

    title: str
    inside: tuple[Array, ...]
    outside: tuple[Array, ...]
    nominal: tuple[Array, ...]


def paths(drives: Sequence[Path], room: Room) -> Plot:
    """One panel per drive on one scale, its room behind it, speed as colour and width."""
    box = _view(drives, room)
    columns = 1 if len(drives) == 1 or box.size[1] < 0.45 * box.size[0] else 2 if len(drives) <= 4 else 3
    x, y, width, height = _scales(box, columns, len(drives))
    scale, letters = SCALES[columns - 1], LETTERS[columns - 1]
    panels = [
        Panel([*surroundings(room), *_path(one, room, x, scale)], x, y, one.title, "box", letters)
        for one in drives
    ]
    keys = [*_path_keys(drives), *_room_keys(drives, room)]
    # Lines of the top panels' titles for which there is no room; those below grow into the gaps.
    lines = max(0, *(one.title.count("\n") - 1 for one in drives[:columns]))
    lines += -(-len(keys) // legend_columns([key.label for key in keys], width, HANDLE)) - 1
    return Plot(
        panels,
        columns,
        width,
        height + LINE * lines,
        share="y",
        legend=Legend(keys, 6, "lower", HANDLE, {"columnspacing": 1.2, "handletextpad": 0.3}),
        fastest=max(float(np.abs(run.speed).max()) for one in drives for run in one.runs),
    )


def bundles(cases: Sequence[Bundle], room: Room) -> Plot:
    """One panel per drive on one scale: where robots with other parameters go."""
    every = Box.of(*(np.vstack([*one.inside, *one.outside, *one.nominal]) for one in cases))
    box = every if room.area is None else _in_sight(every, room.area)
    columns = min(2, len(cases))
    x, y, width, height = _scales(box, columns, len(cases))
    panels = [Panel([*surroundings(room), *_bundle(one)], x, y, one.title, "box") for one in cases]
    looks = {"nominal robot": NOMINAL, "keeps the limits": INSIDE, "leaves them": OUTSIDE}
    keys = [Key(label, {**look, "linewidth": 1.6}) for label, look in looks.items()]
    keys += [Key("start", START), Key("end", END)]
    legend = Legend(keys, 6, "lower", HANDLE)
    return Plot(panels, columns, width, height + LINE, share="y", legend=legend)


def _in_sight(every: Box, area: Box) -> Box:
    # An area, and of what goes beyond it as much as leaves it in sight.
    seen = every.within(area.padded(BEYOND * float(max(area.size))))
    return area if seen is None else Box.around([seen, area])


def _view(drives: Sequence[Path], room: Room) -> Box:
    # All that is feasible, and of what lies about and of drives that break limits as much as leaves that
    # in sight.
    areas = [] if room.area is None else [room.area]
    marks = [Box(place, place) for place in room.beacons]
    every = Box.around([*(_extent(one, room) for one in drives), *marks, *room.shapes, *areas])
    core = [*(_extent(one, room) for one in drives if one.feasible), *areas]
    if not core:
        return every
    box = Box.around(core)
    return every.within(box.padded(BEYOND * float(max(box.size)))) or box


def _extent(drive: Path, room: Room) -> Box:
    ends = Box.of(*(run.ends for run in drive.runs)).padded(room.body_radius)
    return Box.around([Box.of(*(run.points for run in drive.runs)), ends])


def _scales(box: Box, columns: int, panels: int) -> tuple[Axis, Axis, float, float]:
    # One box for all panels; the figure's height follows from its shape.
    seen = box.padded(0.06 * max(*box.size, 1e-3))
    x, y = (
        Axis(name, "m", (float(low), float(high)), most=most)
        for name, low, high, most in zip("xy", seen.low, seen.high, (4 if columns > 2 else 6, 6), strict=True)
    )
    ratio = float(seen.size[1] / seen.size[0])
    width = 5.6 if columns == 1 and ratio > 0.5 else WIDTH
    panel = (width - 1.4) / columns * min(ratio, 1.6)
    return x, y, width, -(-panels // columns) * (panel + 0.35) + 0.8


def surroundings(room: Room) -> list[Part]:
    """Workspace, obstacles and beacons; nothing of what has no outline."""
    floor = [] if room.floor is None else [Shape(room.floor, FLOOR)]
    beacons = [Line.through(room.beacons, BEACON)] if len(room.beacons) else []
    return [*floor, *(Shape(one, OBSTACLE) for one in room.hatched), *beacons]


def _path(drive: Path, room: Room, x: Axis, scale: float) -> Iterator[Part]:
    # Every run with its start, end, direction and segments.
    assert x.ends is not None
    width = x.ends[1] - x.ends[0]
    for run in drive.runs:
        if run.trailer is not None:
            yield Line.through(run.trailer, {**TRAILER, "linewidth": scale * TRAILER["linewidth"]})
        yield Shades(run.x, run.y, run.speed, scale)
        yield from _segments(run, scale, drive.sideways)
        yield from _directions(run, width, scale, drive.sideways)
        for mark, (end_x, end_y) in zip((START, END), run.ends, strict=True):
            yield Line([end_x], [end_y], scaled(mark, scale))
            if room.body_radius:
                yield Shape(Outline(((end_x, end_y),), room.body_radius), BODY)
    if len(drive.runs) > 1:
        places = number_places(drive.runs, NUMBERS_APART * width)
        for number, place in enumerate(places, 1):
            yield Note(str(number), place, 6 * scale, {**NUMBER, "fontsize": 10.5 * scale})


def _bundle(case: Bundle) -> Iterator[Part]:
    for lines, look in ((case.inside, INSIDE), (case.outside, OUTSIDE), (case.nominal, NOMINAL)):
        for line in lines:
            yield Line.through(line, look)
    for line in case.nominal:
        for mark, end in ((START, line[0]), (END, line[-1])):
            yield Line([end[0]], [end[1]], scaled(mark, 0.8))


def _segments(run: Run, scale: float, sideways: bool) -> Iterator[Part]:
    if len(run.edges) >= MOST_TICKS:
        return
    motion = np.arctan2(np.diff(run.y), np.diff(run.x))
    along = motion[run.edges] if sideways else run.heading[run.edges]
    for x, y, angle in zip(run.x[run.edges], run.y[run.edges], along + np.pi / 2, strict=True):
        edge = {"markeredgewidth": 1.2 * scale, "zorder": 3}
        yield Line([x], [y], {**scaled(SEGMENT, scale), **edge, "marker": replace(TICK, angle=angle)})


def _directions(run: Run, width: float, scale: float, sideways: bool) -> Iterator[Part]:
    travelled = np.cumsum(run.steps)
    if travelled[-1] < NOWHERE:
        return
    count = int(np.clip(travelled[-1] / (APART * width), 2, scale * ARROWS))
    shares = np.arange(count) / count
    for index in np.unique(np.searchsorted(travelled, (shares + 0.5 / count) * travelled[-1])):
        x, y = run.x[index : index + 2], run.y[index : index + 2]
        angle = float(np.arctan2(y[1] - y[0], x[1] - x[0]))
        look = {**arrow(bool(run.speed[index] >= 0), angle, scale), "zorder": 4}
        yield Line([x.mean()], [y.mean()], look)
    # Where it faces, between the arrows, from the start on.
    for index in np.unique(np.searchsorted(travelled, shares * travelled[-1])) if sideways else ():
        yield Line([run.x[index]], [run.y[index]], pointer(float(run.heading[index]), scale))


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


def _path_keys(drives: Sequence[Path]) -> Iterator[Key]:
    runs = [run for one in drives for run in one.runs]
    sideways = any(one.sideways for one in drives)
    yield Key("start", START)
    yield Key("end", END)
    if any(one.goes for one in drives):
        yield Key("motion" if sideways else "forwards", arrow(True))
        if sideways:
            yield Key("heading", pointer(scale=0.7))
    if any((run.speed < 0).any() for run in runs):
        yield Key("backwards", arrow(False))
    if any(0 < len(run.edges) < MOST_TICKS for run in runs):
        yield Key("segments meet", SEGMENT)


def _room_keys(drives: Sequence[Path], room: Room) -> Iterator[Key]:
    if len(room.beacons):
        yield Key("beacon", BEACON)
    if room.obstacles:
        yield Key("obstacle", OBSTACLE, patch=True)
    if room.body_radius:
        yield Key("robot's body", BODY_KEY)
    if any(run.trailer is not None for one in drives for run in one.runs):
        yield Key("trailer's axle", TRAILER)
