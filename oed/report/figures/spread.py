"""The figures of what scatters: starts, simulated estimates, and errors of a trial on a simulated robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from oed.report.figures import spec
from oed.report.figures.spec import FIRST, INK, SECOND, THIRD, WIDTH, Array, Look, mark, stroke

DOTS = mark("o", 6, FIRST, 1.0, 3, FIRST)
CROSSES = mark("x", 6, INK, 1.0, 3)
ALIKE: Look = {"color": "#e6eef5", "zorder": 0}
CLOUD = "#7a95ad"
ESTIMATES = mark(".", 3, CLOUD, 1.0, 2, CLOUD)
ELLIPSES = (stroke(FIRST, 1.6, 3), stroke(SECOND, 1.6, 3, (4, 1.6)))
TRUTH = mark("+", 11, INK, 1.8, 5)
RADIUS_95 = 2.447747
"""Mahalanobis radius that holds 95 % of a normal distribution in the plane: sqrt(-2 ln 0.05)."""
APART = 3.0
"""Ratio of the widths of two estimates beyond which they are drawn on scales of their own."""


def starts(spreads: Sequence[tuple[str, Sequence[float], int]]) -> spec.Plot:
    """One panel per search: its starts' shortfalls [%], best first, and starts without a design."""
    columns = 1 if len(spreads) == 1 else 2
    panels = [_starts(title, shortfalls, failed) for title, shortfalls, failed in spreads]
    keys = [spec.Key("start", DOTS), spec.Key("within 1 % of the best", ALIKE, patch=True)]
    if any(failed for _, _, failed in spreads):
        keys.append(spec.Key("no feasible design", CROSSES))
    height = 2.7 * -(-len(spreads) // columns)
    return spec.Plot(panels, columns, height=height, labels="outer ticks", legend=spec.Legend(keys, 3))


def _starts(title: str, shortfalls: Sequence[float], failed: int) -> spec.Panel:
    found, lowest = len(shortfalls), min(*shortfalls, -1.0)
    parts: list[spec.Part] = [
        spec.Band(-1.0, 0.0, ALIKE),
        spec.Line(np.arange(1, found + 1), shortfalls, DOTS),
    ]
    if failed:
        parts.append(spec.Line(found + 1 + np.arange(failed), np.full(failed, lowest), CROSSES))
    x = spec.Axis("starts, best first", ends=(0.3, found + failed + 0.7), most=12, whole=True)
    return spec.Panel(
        parts, x, spec.Axis("below the best start", "%", (1.12 * lowest, -0.08 * lowest)), title
    )


@dataclass(frozen=True)
class Cloud:
    """Simulated estimates of two parameters.

    Attributes:
        title: the result's name.
        axes: the two parameters, with units.
        points: estimates, (k, 2).
        true: (2,).
        promised, sampled: covariances, (2, 2).
        alike: whether both axes are of one unit.
    """

    title: str
    axes: tuple[spec.Axis, spec.Axis]
    points: Array
    true: Array
    promised: Array
    sampled: Array
    alike: bool = True


def clouds(drawn: Sequence[Cloud]) -> spec.Plot:
    """One panel per drive, all on one scale: simulated estimates, the truth and their 95 % ellipses."""
    columns, (x, y) = min(len(drawn), 2), _reach(drawn)
    panels = [_cloud(one, 1.25 * np.array([x, y]), "box" if x == y else "") for one in drawn]
    keys = [
        spec.Key("estimate", {**ESTIMATES, "markersize": 6}),
        spec.Key("true", TRUTH),
        spec.Key("95 %, predicted", ELLIPSES[0]),
        spec.Key("95 %, simulated", ELLIPSES[1]),
    ]
    height = 3.1 * -(-len(drawn) // columns)
    return spec.Plot(panels, columns, height=height, share="y", legend=spec.Legend(keys, 4))


def _cloud(cloud: Cloud, reach: Array, equal: Any) -> spec.Panel:
    outlines = [
        spec.Line.through(ellipse(cloud.true, covariance).T, look)
        for covariance, look in zip((cloud.promised, cloud.sampled), ELLIPSES, strict=True)
    ]
    parts = [
        spec.Line.through(cloud.points, ESTIMATES),
        *outlines,
        spec.Line.through(cloud.true[None], TRUTH),
    ]
    x, y = (
        spec.Axis(axis.title, axis.unit, (float(at - by), float(at + by)))
        for axis, at, by in zip(cloud.axes, cloud.true, reach, strict=True)
    )
    return spec.Panel(parts, x, y, cloud.title, equal)


def _reach(drawn: Sequence[Cloud]) -> tuple[float, float]:
    # How far the widest ellipse goes along either axis; one scale for both where they are alike.
    outlines = [np.abs(ellipse(0 * one.true, one.promised)).max(axis=1) for one in drawn]
    x, y = (float(size) for size in np.max(outlines, axis=0))
    alike = drawn[0].alike and max(x, y) <= APART * min(x, y)
    return (max(x, y), max(x, y)) if alike else (x, y)


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
MOST = 1e3
"""Times the smallest error that are shown; what is larger stands at the edge."""
PLANNED = stroke(INK, 0.9, 4, (3, 2))


@dataclass(frozen=True)
class Floor:
    """Held-out errors on one floor.

    Attributes:
        title: of the panel.
        drives: from top to bottom.
        fits: by which models.
        errors: value, low, high of each, (drives, fits, 3) [mm]; not finite where there is none.
    """

    title: str
    drives: tuple[str, ...]
    fits: tuple[str, ...]
    errors: Array


@dataclass(frozen=True)
class Went:
    """Where a drive was to go, and where it went on floors of different friction; (n, 2) [m]."""

    title: str
    planned: Array
    true: tuple[tuple[str, Array], ...]


def errors(floors: Sequence[Floor]) -> spec.Plot:
    """One panel per floor, all on one scale: a lane per drive, in it a mark with its interval per fit."""
    lanes, fits = len(floors[0].drives), floors[0].fits
    height = 1.0 + len(fits) // 3 * 0.2 + max(ROW, 0.13 * len(fits)) * lanes
    known = [one.errors[np.isfinite(one.errors)] for one in floors]
    most = MOST * min((float(part.min()) for part in known if part.size), default=1.0)
    x = spec.Axis("held-out error", "mm", logarithmic=True, most=1)
    panels = [
        spec.Panel(
            _errors(one, most),
            x,
            spec.Axis(ends=(lanes - 0.5, -0.5), ticks=tuple(enumerate(one.drives)), grid=False),
            one.title,
        )
        for one in floors
    ]
    keys = [spec.Key(name, _mark(index)) for index, name in enumerate(fits)]
    legend = spec.Legend(keys, 3, handle=0.4)
    return spec.Plot(panels, len(floors), height=height, labels="figure", share="xy", legend=legend)


def _errors(floor: Floor, most: float) -> list[spec.Part]:
    lanes, count = np.arange(len(floor.drives)), len(floor.fits)
    parts: list[spec.Part] = [spec.Limit(lane - 0.5, stroke("#dddddd", 0.8, 1)) for lane in lanes[1:]]
    for index in range(count):
        value, low, high = np.minimum(np.nan_to_num(floor.errors[:, index].T, nan=most, posinf=most), most)
        heights = lanes + LANE * ((index + 0.5) / count - 0.5)
        parts.append(spec.Intervals(heights, low, high, stroke(INK, 1.0, 2)))
        parts.append(spec.Line(value, heights, _mark(index)))
    return parts


def _mark(index: int) -> Look:
    return mark(MARKERS[index % len(MARKERS)], 5.5, FILLS[index % len(FILLS)], 0.8, 3)


def went(drives: Sequence[Went]) -> spec.Plot:
    """One panel per drive, each on a scale of its own: as planned dashed, as driven from a dot to crosses."""
    columns = min(4, len(drives))
    x, y = spec.Axis("x", "m"), spec.Axis("y", "m")
    panels = [spec.Panel(_went(one), x, y, one.title, "ends", 7.9, small=True) for one in drives]
    keys = [spec.Key("planned", PLANNED)]
    keys += [spec.Key(name, _went_look(index)) for index, (name, _) in enumerate(drives[0].true)]
    height = 0.5 + 2.0 * -(-len(drives) // columns)
    legend = spec.Legend(keys, len(keys))
    return spec.Plot(panels, columns, WIDTH, height, labels="figure", legend=legend)


def _went(one: Went) -> list[spec.Part]:
    parts: list[spec.Part] = []
    for index, (_, path) in enumerate(one.true):
        look = _went_look(index)
        cross = mark("x", 5, look["color"], 1.0, 5, look["color"])
        parts += [spec.Line.through(path, look), spec.Line.through(path[-1:], cross)]
    dot = mark("o", 3.5, INK, 1.0, 6)
    return [*parts, spec.Line.through(one.planned, PLANNED), spec.Line.through(one.planned[:1], dot)]


def _went_look(index: int) -> Look:
    colours = ("#9fb4c7", FIRST, SECOND)
    return stroke(colours[index % len(colours)], 2.6 - 0.7 * (index % 3), 2 + index)
