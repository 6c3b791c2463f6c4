"""Charts over time, of inputs between their limits and of searches, and of a sweep over what was varied."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from oed.foundation.arrays import Array
from oed.foundation.text import Unit, unit_text
from oed.report.figures import spec
from oed.report.figures.spec import FAINT, INK, Ends, Look, Values, line_look, mark, stroke
from oed.report.parts.inputs import Group, Series

BEYOND = 0.3
"""How far beyond its limits a panel shows an input that breaks them, as a share of their width."""
LABELS = 0.28
"""Room for the labels of limits that all inputs satisfy."""
LONG = 22
"""Letters of a legend's entry beyond which there are fewer of them on a line."""
LONG_LINES = {"handlelength": 3.2}
PLATE = {"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.6}
AT_VALUE: Look = {"xycoords": ("axes fraction", "data")}
"""Of words at a value, wherever along the axis."""
LIMIT: Look = {
    **AT_VALUE,
    "ha": "right",
    "fontsize": "small",
    "bbox": PLATE,
    "zorder": 4,
}
"""Of the words at a limit's line."""

Search = tuple[str, Sequence[tuple[float, float]]]
"""Name of a search, and its shortfalls [%] over its seconds."""


def series(
    drives: Sequence[Series],
    group: Group,
    labels: Sequence[str],
    bounds: Ends | None,
    times: Unit = ("s", 1.0),
) -> spec.Plot:
    """One panel per drive: its inputs or their rates over time, between their bounds.

    Args:
        drives: that are drawn.
        group: of inputs.
        labels: of the inputs.
        bounds: of their values.
        times: unit of the axis of time, and its factor from s.
    """
    unit, factor = times
    if factor != 1.0:
        drives = [
            replace(one, times=factor * one.times, breaks=tuple(factor * end for end in one.breaks))
            for one in drives
        ]
    columns = 1 if len(drives) == 1 else 2
    several = any(one.breaks for one in drives)
    ends = _ends(drives, bounds)
    name = group.title + ("\n" if group.unit else "")
    panels = [
        spec.Panel(
            _inputs(one, group.unit, bounds),
            spec.Axis(
                f"time [{unit}], runs one after the other" if several else f"time [{unit}]",
                ends=(0.0, one.times[-1]),
            ),
            spec.Axis(name, group.unit, ends),
            one.title,
        )
        for one in drives
    ]
    keys = [spec.Key(label, line_look(index)) for index, label in enumerate(labels)]
    height = (2.5 if columns == 1 else 2.1) * -(-len(drives) // columns)
    return spec.Plot(
        panels, columns, height=height, share="y", legend=spec.Legend(keys, most=4, options=LONG_LINES)
    )


def _inputs(drive: Series, unit: str, bounds: Ends | None) -> list[spec.Part]:
    steps = {"drawstyle": "steps-post"} if drive.steps else {}
    lines = [
        spec.Line(drive.times, column, {**line_look(index), **steps, "zorder": 3})
        for index, column in enumerate(drive.values.T)
    ]
    return [
        *lines,
        *(spec.Call("axvline", (end,), stroke(FAINT, 0.8, 1.5)) for end in drive.breaks),
        *limit_lines(bounds, unit),
    ]


def limit_lines(bounds: Ends | None, unit: str) -> list[spec.Part]:
    """A line at each of two limits, which says what it is."""
    limits: list[spec.Part] = []
    for bound, offset, side in zip(bounds or (), (-3, 3), ("top", "bottom"), strict=False):
        text = f"limit {bound:g} {unit_text(unit)}"
        limits.append(spec.Call("axhline", (bound,), stroke(INK, 0.9, 2)))
        limits.append(spec.Note(text, (0.99, bound), (0, offset), {**LIMIT, "va": side}))
    return limits


def _ends(drives: Sequence[Series], bounds: Ends | None) -> Ends:
    low = min(float(np.nanmin(one.values)) for one in drives)
    high = max(float(np.nanmax(one.values)) for one in drives)
    return ends_within(low, high, bounds)


def ends_within(low: float, high: float, bounds: Ends | None) -> Ends:
    """The ends of an axis of values between two limits: with room for their labels, and a little for what
    exceeds them.

    Args:
        low: least value.
        high: largest value.
        bounds: the limits; None for none.
    """
    if bounds is None:
        room = 0.06 * (high - low or 1.0)
        return low - room, high + room
    within = bounds[0] <= low + 1e-9 and high <= bounds[1] + 1e-9
    room = (LABELS if within else BEYOND) * (bounds[1] - bounds[0])
    return bounds[0] - room, bounds[1] + room


def convergence(searches: Sequence[Search], apart: bool) -> spec.Plot:
    """All searches on one pair of axes: shortfall from the best [%], `apart` by each one's own criterion."""
    parts = [part for index, (_, points) in enumerate(searches) for part in _search(points, line_look(index))]
    values = [value for _, points in searches for _, value in points]
    below = "below the best by\nits own criterion" if apart else "below the best"
    x = spec.Axis("time", "s", logarithmic=True, most=1)
    y = spec.Axis(below, "%", (min(values) / 2, 2 * max(*values, 1.0)), logarithmic=True)
    keys = [spec.Key(name, line_look(index)) for index, (name, _) in enumerate(searches)]
    longest = max(len(name) for name, _ in searches)
    most = 4 if longest <= LONG else 2 if longest <= 2 * LONG else 1
    return spec.Plot(
        [spec.Panel(parts, x, y)], height=3.2, legend=spec.Legend(keys, most, options=LONG_LINES)
    )


def _search(points: Sequence[tuple[float, float]], look: Look) -> list[spec.Part]:
    seconds, shortfalls = (list(one) for one in zip(*points, strict=True))
    dot = mark("o", 5, look["color"], 1.0, 4, look["color"])
    line = spec.Line(seconds, shortfalls, {**look, "drawstyle": "steps-post", "zorder": 3})
    return [line, spec.Line(seconds[:: len(points) - 1 or 1], shortfalls[:: len(points) - 1 or 1], dot)]


DECADE = 20.0
"""Ratio of the largest to the smallest value from which an axis is logarithmic."""
MARKERS = ("o", "s", "^", "D", "v", "P")
MARGIN = 0.07
"""Beside the points of a panel, as a share of its extent."""
POINTS = 52.0
"""Of a panel's own height, for each inch of its figure's row."""
APART = 11.0
"""Between names of lines [points]."""
NAMED: Look = {"va": "center", "fontsize": "small", "fontweight": "bold", "zorder": 5}
"""Of a line's name at its end."""
WANTED: Look = {
    **AT_VALUE,
    "va": "top",
    "fontsize": "small",
    "color": INK,
    "zorder": 5,
}
"""Of the word at a level."""


@dataclass(frozen=True)
class Chart:
    """Values over what was varied.

    Attributes:
        across: name of the key along the axis, with its unit.
        places: its values.
        series: for each combination of the other keys its name and the value of each place; None where there
            is none.
        quantity: what the values are, with their unit.
        title: of the panel.
        level: that is wanted; None for none.
    """

    across: str
    places: tuple[float, ...]
    series: tuple[tuple[str, tuple[float | None, ...]], ...]
    quantity: str
    title: str = ""
    level: float | None = None

    @property
    def values(self) -> Array:
        """Those of the series, (series, places); not a number where there is none."""
        found = np.array([values for _, values in self.series], dtype=float)
        return np.where(np.isfinite(found), found, np.nan)


def panels(charts: Sequence[Chart]) -> spec.Plot:
    """One panel for each chart: lines, named where they end if there are several, and what is wanted."""
    columns = 2 if len(charts) == 4 else min(len(charts), 3)
    height = (3.4 if columns == 1 else 2.9) * -(-len(charts) // columns)
    alike = len({(one.across, one.quantity) for one in charts}) == 1
    made = [_panel(one, height) for one in charts]
    return spec.Plot(made, columns, height=height, labels="outer ticks" if alike else "each")


def _panel(chart: Chart, height: float) -> spec.Panel:
    values, level = chart.values, [] if chart.level is None else [chart.level]
    every = np.array([*values[np.isfinite(values)], *level])
    y = spec.Axis(chart.quantity, logarithmic=_spans_decades(every), ends=_span(every, 0.0))
    places = np.array(chart.places, dtype=float)
    x = spec.Axis(
        chart.across,
        ends=_span(places),
        logarithmic=_spans_decades(places),
        ticks=tuple((float(place), f"{place:.3g}") for place in places),
    )
    parts: list[spec.Part] = [
        spec.Line(places, row, {**_line(index), "zorder": 3}) for index, row in enumerate(values)
    ]
    if chart.level is not None:
        parts.append(spec.Call("axhline", (chart.level,), stroke(INK, 1.1, 2, (4, 2))))
        parts.append(_wanted(chart.level, values))
    return spec.Panel([*parts, *_names(chart, y, height)], x, y, chart.title)


def _wanted(level: float, values: Array) -> spec.Note:
    # At the end where the lines are farther from the level.
    near = np.nanmin(np.abs(values[:, [0, -1]] - level), axis=0) if np.isfinite(values).any() else (1.0, 0.0)
    right = bool(near[1] > near[0])
    at, side = (1.0, "right") if right else (0.0, "left")
    return spec.Note("wanted", (at, level), (-3 if right else 3, -3), {**WANTED, "ha": side})


def _span(values: Array, least: float | None = None) -> Ends:
    # A margin on either side; from `least` on unless something is below it.
    if not len(values):
        return 0.0, 1.0
    low, high = float(values.min()), float(values.max())
    if _spans_decades(values):
        return low / (high / low) ** MARGIN, high * (high / low) ** MARGIN
    room = MARGIN * (high - (low if least is None else min(low, least)) or 1.0)
    return low - room if least is None or low < least else least, high + room


def _names(chart: Chart, y: spec.Axis, height: float) -> list[spec.Part]:
    # Beside the last point of each of several lines, moved apart where they would lie over each other.
    known = [(index, np.flatnonzero(np.isfinite(row))) for index, row in enumerate(chart.values)]
    ends = [(index, at[-1], chart.values[index, at[-1]]) for index, at in known if len(at)]
    if len(chart.series) < 2:
        return []
    assert y.ends is not None
    scale = np.log if y.logarithmic else np.asarray
    low, high = scale(np.array(y.ends))
    points, free = POINTS * height, -np.inf
    found: list[spec.Part] = []
    for index, at, value in sorted(ends, key=lambda end: end[2]):
        place = float((scale(np.array(value)) - low) / (high - low) * points)
        free = max(place, free + APART)
        look = {**NAMED, "color": line_look(index)["color"]}
        where, beside = (chart.places[at], value), 9
        if at == len(chart.places) - 1:
            # Beyond the frame, which would run through it.
            where, beside, look = (1.0, value), 5, {**look, **AT_VALUE}
        found.append(spec.Note(chart.series[index][0], where, (beside, free - place), look))
    return found


def _spans_decades(values: Values) -> bool:
    known = np.asarray(values)[np.isfinite(values)]
    return bool(len(known) > 1 and known.min() > 0 and known.max() >= DECADE * known.min())


def _line(index: int) -> Look:
    # Smaller and smaller, so that lines that coincide are all seen.
    return {**line_look(index), "marker": MARKERS[index % len(MARKERS)], "markersize": 9.5 - 1.3 * index}


def heat_map(chart: Chart) -> spec.Plot:
    """Two numeric keys: a cell for each pair of values, shaded and labelled with what it reaches."""
    places = [(at, f"{place:g}") for at, place in enumerate(chart.places)]
    names = [(at, name) for at, (name, _) in enumerate(chart.series)]
    x, y = spec.Axis(chart.across, ticks=places, grid=False), spec.Axis(ticks=names, grid=False)
    panel = spec.Panel([spec.Cells(chart.values, chart.quantity)], x, y)
    return spec.Plot([panel], height=1.2 + 0.36 * len(chart.series))
