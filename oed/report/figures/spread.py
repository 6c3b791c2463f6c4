"""The figures of what scatters: starts, simulated estimates, and errors of a trial on a simulated robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from oed.foundation.arrays import Array
from oed.foundation.text import own_unit
from oed.records.stored.simulation import Simulated, StoredFloor, StoredPlan
from oed.report.figures import spec
from oed.report.figures.spec import FIRST, INK, SECOND, THIRD, WIDTH, Look, mark, stroke

DESIGN = mark("o", 9, FIRST, 1.0, 4, FIRST)
START = mark("o", 7, "white", 1.2, 3)
BOUND = stroke(INK, 2.0, 2, (5, 2))
TEXT: Look = {"va": "center", "ha": "right", "fontsize": "small", "fontweight": "bold", "color": INK}
DOT = 0.125
"""Distance of the dots of starts, side by side and one above the other [inch]."""
MOST_LEVELS = 12
"""Dots one above the other; further ones cover each other."""
NARROWEST = 0.01
"""Of an axis of searches, the share of its values that it spans at least: starts within that are alike."""
CLOUD = "#7a95ad"
ESTIMATES = mark(".", 3, CLOUD, 1.0, 2, CLOUD)
ELLIPSES = (stroke(FIRST, 1.6, 3), stroke(SECOND, 1.6, 3, (4, 1.6)))
TRUTH = mark("+", 11, INK, 1.8, 5)
RADIUS_95 = 2.447747
"""Mahalanobis radius that holds 95 % of a normal distribution in the plane: sqrt(-2 ln 0.05)."""
SQUARE_TICKS = 4
"""Numbers along an axis of a square panel, which is too narrow for more with many digits."""
LONG = 0.02
"""Half the width of a square panel below which numbers along it have three decimals, and are set smaller."""
APART = 3.0
"""Ratio of the widths of two estimates beyond which they are drawn on scales of their own."""


@dataclass(frozen=True)
class Lane:
    """A search, on the axis of all.

    Attributes:
        name: of its design.
        best: what that is worth.
        text: the same, in words.
        starts: what its starts ended with.
    """

    name: str
    best: float
    text: str
    starts: tuple[float, ...]


def strip(lanes: Sequence[Lane], axis: spec.Axis, bound: float | None, title: str) -> spec.Plot:
    """One axis for all: a lane per search with its design and, above that, every start; the bound as a line.

    Args:
        lanes: the first on top.
        axis: what designs are worth.
        bound: what no drive can be worth more than; None where that is not known.
        title: of the panel.
    """
    known = [value for lane in lanes for value in (lane.best, *lane.starts)]
    least, most = min(known), max([*known, *([] if bound is None else [bound])])
    span = max(most - least, NARROWEST * abs(most))
    stacks = [_stacked(lane.starts, span * DOT / WIDTH) for lane in lanes]
    rows = [1.6 + max(levels, default=0) for levels in stacks]
    places = [sum(rows[at + 1 :]) for at in range(len(lanes))]
    parts = [part for each in zip(lanes, stacks, places, strict=True) for part in _lane(*each)]
    keys = [spec.Key("design", DESIGN)] + ([spec.Key("end of a start", START)] if any(stacks) else [])
    if bound is not None:
        parts.append(spec.Call("axvline", (bound,), BOUND))
        keys.append(spec.Key("proved bound", BOUND))
    ends = (most - 1.12 * span, most + 0.03 * span)
    names = [(place, lane.name) for place, lane in zip(places, lanes, strict=True)]
    y = spec.Axis(ends=(-0.9, sum(rows) - 0.4), ticks=names, grid=False)
    panel = spec.Panel(parts, replace(axis, ends=ends), y, title)
    return spec.Plot([panel], height=1.25 + DOT * sum(rows), legend=spec.Legend(keys))


def _lane(lane: Lane, levels: Sequence[int], place: float) -> list[spec.Part]:
    heights = place + np.array(levels, dtype=float)
    return [
        spec.Call("axhline", (place,), stroke("#dddddd", 0.9, 1)),
        spec.Line(sorted(lane.starts), heights, START),
        spec.Line([lane.best], [place], DESIGN),
        spec.Note(lane.text, (lane.best, place), (-9, 0), TEXT),
    ]


def _stacked(values: Sequence[float], width: float) -> list[int]:
    # For each value, in rising order, the lowest level from 1 at which its dot covers no other.
    levels: list[int] = []
    ends: list[float] = []
    for value in sorted(values):
        level = next((at for at, end in enumerate(ends) if value - end >= width), len(ends))
        if level == MOST_LEVELS:
            level = ends.index(min(ends))
        ends[level : level + 1] = [value]
        levels.append(level + 1)
    return levels


@dataclass(frozen=True)
class Estimated:
    """A parameter that is estimated: what its axis says, and whether its errors are drawn instead of itself.

    Attributes:
        name: of the parameter.
        title, unit: of the axis.
        factor: from SI to that unit.
        errors: whether the true value is taken off.
    """

    name: str
    title: str
    unit: str
    factor: float
    errors: bool


@dataclass(frozen=True)
class _Cloud:
    """Simulated estimates of two parameters, (k, 2), the true values, (2,), and two covariances, (2, 2)."""

    points: Array
    true: Array
    covariances: tuple[Array, Array]

    @classmethod
    def of(cls, one: Simulated, pair: Sequence[Estimated]) -> _Cloud:
        at = [one.parameters.index(axis.name) for axis in pair]
        factors, true = np.array([axis.factor for axis in pair]), np.array(one.true)[at]
        origin = np.where([axis.errors for axis in pair], true, 0.0)
        predicted, sampled = (
            np.outer(factors, factors) * np.array(covariance)[np.ix_(at, at)]
            for covariance in (one.predicted_covariance, one.sampled_covariance)
        )
        points = factors * (np.array(one.estimates)[:, at] - origin)
        return cls(points, factors * (true - origin), (predicted, sampled))


def clouds(drives: Sequence[Simulated], titles: Sequence[str], pair: Sequence[Estimated]) -> spec.Plot:
    """One panel per drive, all on one scale: simulated estimates, the truth and their 95 % ellipses.

    Args:
        drives: with simulated estimates.
        titles: of the panels.
        pair: the parameters of both axes.
    """
    drawn = [_Cloud.of(one, pair) for one in drives]
    columns, (x, y) = min(len(drawn), 4), _reach(drawn, pair[0].unit == pair[1].unit)
    reach, equal = 1.25 * np.array([x, y]), x == y
    panels = [_cloud(one, title, pair, reach, equal) for one, title in zip(drawn, titles, strict=True)]
    keys = [
        spec.Key("estimate", {**ESTIMATES, "markersize": 6}),
        spec.Key("true", TRUTH),
        spec.Key("95 %, predicted", ELLIPSES[0]),
        spec.Key("95 %, simulated", ELLIPSES[1]),
    ]
    height = 3.1 * -(-len(drawn) // columns)
    return spec.Plot(panels, columns, height=height, share="y", legend=spec.Legend(keys, 4))


def _cloud(one: _Cloud, title: str, pair: Sequence[Estimated], reach: Array, equal: bool) -> spec.Panel:
    outlines = zip(one.covariances, ELLIPSES, strict=True)
    ellipses = [spec.Line.through(ellipse(one.true, covariance).T, look) for covariance, look in outlines]
    parts = [spec.Line.through(one.points, ESTIMATES), *ellipses, spec.Line.through(one.true[None], TRUTH)]
    ends = np.column_stack([one.true - reach, one.true + reach])
    x, y = (
        spec.Axis(axis.title, axis.unit, (float(low), float(high)), most=SQUARE_TICKS if equal else 0)
        for axis, (low, high) in zip(pair, ends, strict=True)
    )
    return spec.Panel(parts, x, y, title, "box" if equal else "", small=equal and reach[0] < LONG)


def _reach(drawn: Sequence[_Cloud], alike: bool) -> tuple[float, float]:
    # How far the widest ellipse goes along either axis; one scale for both where they are alike.
    outlines = [np.abs(ellipse(0 * one.true, one.covariances[0])).max(axis=1) for one in drawn]
    x, y = (float(size) for size in np.max(outlines, axis=0))
    return (max(x, y), max(x, y)) if alike and max(x, y) <= APART * min(x, y) else (x, y)


def ellipse(centre: Array, covariance: Array) -> Array:
    """Outline (2, 121) of the ellipse that holds 95 % of a normal distribution."""
    angle = np.linspace(0.0, 2 * np.pi, 121)
    circle = RADIUS_95 * np.array([np.cos(angle), np.sin(angle)])
    outline: Array = np.asarray(centre)[:, None] + np.linalg.cholesky(covariance) @ circle
    return outline


MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")
FILLS = (FIRST, SECOND, "#ffffff", THIRD, "#f2c6e0", "#999999", INK, "#b0588f")
"""Of fits, told apart by shape and brightness."""
LANE = 0.72
"""Share of a drive's lane that its fits are spread over."""
ROW = 0.34
"""Height of a drive's lane [inch]."""
UNIT, FACTOR = own_unit("m")
"""Of held-out errors: that of parameters."""
FARTHEST_ERROR = 1e3
"""Times the smallest error that are shown; what is larger stands at the edge."""
PLANNED = stroke(INK, 0.9, 4, (3, 2))


def errors(floors: Sequence[StoredFloor], fits: Sequence[str]) -> spec.Plot:
    """One panel per floor, all on one scale: a lane per drive, in it a mark with its interval per fit."""
    drives = list(dict.fromkeys(one.drive for one in floors[0].errors))
    tables = [_errors(floor, drives, fits) for floor in floors]
    most = FARTHEST_ERROR * min(
        (float(np.nanmin(one)) for one in tables if np.isfinite(one).any()), default=1.0
    )
    lanes = spec.Axis(ends=(len(drives) - 0.5, -0.5), ticks=tuple(enumerate(drives)), grid=False)
    x = spec.Axis("held-out error", UNIT, logarithmic=True, most=1)
    panels = [
        spec.Panel(_lanes(table, most), x, lanes, f"friction {floor.friction:g}")
        for floor, table in zip(floors, tables, strict=True)
    ]
    legend = spec.Legend([spec.Key(name, _mark(index)) for index, name in enumerate(fits)], 3, handle=0.4)
    height = 1.0 + len(fits) // 3 * 0.2 + max(ROW, 0.13 * len(fits)) * len(drives)
    return spec.Plot(panels, len(floors), height=height, labels="figure", share="xy", legend=legend)


def _errors(floor: StoredFloor, drives: Sequence[str], fits: Sequence[str]) -> Array:
    # Value, low and high of each, (drives, fits, 3) as shown; not a number where there is none.
    table = {(one.drive, one.fit): (one.value, one.low, one.high) for one in floor.errors}
    return FACTOR * np.array([[table[drive, fit] for fit in fits] for drive in drives], dtype=float)


def _lanes(table: Array, most: float) -> list[spec.Part]:
    lanes, count = np.arange(len(table)), table.shape[1]
    between = stroke("#dddddd", 0.8, 1)
    parts: list[spec.Part] = [spec.Call("axhline", (lane - 0.5,), between) for lane in lanes[1:]]
    for index in range(count):
        value, low, high = np.minimum(np.nan_to_num(table[:, index].T, nan=most, posinf=most), most)
        heights = lanes + LANE * ((index + 0.5) / count - 0.5)
        parts.append(spec.Call("hlines", (heights, low, high), stroke(INK, 1.0, 2)))
        parts.append(spec.Line(value, heights, _mark(index)))
    return parts


def _mark(index: int) -> Look:
    return mark(MARKERS[index % len(MARKERS)], 5.5, FILLS[index % len(FILLS)], 0.8, 3)


def went(planned: Sequence[StoredPlan], floors: Sequence[StoredFloor]) -> spec.Plot:
    """One panel per drive, each on a scale of its own: as planned dashed, as driven from a dot to crosses."""
    paths = {one.name: np.array(one.path) for one in planned if one.path}
    names, x, y = list(floors[0].paths), spec.Axis("x", "m"), spec.Axis("y", "m")
    panels = [
        spec.Panel(
            _went(paths[name], [np.array(one.paths[name]) for one in floors]), x, y, name, "ends", 7.9, True
        )
        for name in names
    ]
    keys = [spec.Key("planned", PLANNED)]
    keys += [
        spec.Key(f"driven, friction {one.friction:g}", _went_look(index)) for index, one in enumerate(floors)
    ]
    columns = min(4, len(names))
    height = 0.5 + 2.0 * -(-len(names) // columns)
    return spec.Plot(panels, columns, WIDTH, height, labels="figure", legend=spec.Legend(keys, len(keys)))


def _went(planned: Array, driven: Sequence[Array]) -> list[spec.Part]:
    parts: list[spec.Part] = []
    for index, path in enumerate(driven):
        look = _went_look(index)
        cross = mark("x", 5, look["color"], 1.0, 5, look["color"])
        parts += [spec.Line.through(path, look), spec.Line.through(path[-1:], cross)]
    dot = mark("o", 3.5, INK, 1.0, 6)
    return [*parts, spec.Line.through(planned, PLANNED), spec.Line.through(planned[:1], dot)]


def _went_look(index: int) -> Look:
    colours = ("#9fb4c7", FIRST, SECOND)
    return stroke(colours[index % len(colours)], 2.6 - 0.7 * (index % 3), 2 + index)
