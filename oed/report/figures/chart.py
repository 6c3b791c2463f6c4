"""Charts over time, of inputs between their limits and of searches, and of a sweep over what was varied."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from oed.foundation.arrays import Array
from oed.foundation.text import unit_text
from oed.report.figures import spec
from oed.report.figures.spec import FAINT, FIRST, INK, Ends, Look, Values, line_look, mark, stroke
from oed.report.parts.inputs import Group, Series

BEYOND = 0.3
"""How far beyond its limits a panel shows an input that breaks them, as a share of their width."""
LABELS = 0.28
"""Room for the labels of limits that all inputs satisfy."""
LONG = 22
"""Letters of a legend's entry beyond which there are fewer of them on a line."""
LONG_LINES = {"handlelength": 3.2}
PLATE = {"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.6}
LIMIT: Look = {
    "xycoords": ("axes fraction", "data"),
    "ha": "right",
    "fontsize": "small",
    "bbox": PLATE,
    "zorder": 4,
}
"""Of the words at a limit's line."""

Search = tuple[str, Sequence[tuple[float, float]]]
"""Name of a search, and its shortfalls [%] over its seconds."""


def series(drives: Sequence[Series], group: Group, labels: Sequence[str], bounds: Ends | None) -> spec.Plot:
    """One panel per drive: its inputs or their rates over time, between their bounds.

    Args:
        drives: that are drawn.
        group: of inputs.
        labels: of the inputs.
        bounds: of their values.
    """
    columns = 1 if len(drives) == 1 else 2
    several = any(one.breaks for one in drives)
    ends = _ends(drives, bounds)
    name = group.title + ("\n" if group.unit else "")
    panels = [
        spec.Panel(
            _inputs(one, group.unit, bounds),
            spec.Axis(
                "time [s], runs one after the other" if several else "time [s]", ends=(0.0, one.times[-1])
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
    limits: list[spec.Part] = []
    for bound, offset, side in zip(bounds or (), (-3, 3), ("top", "bottom"), strict=False):
        text = f"limit {bound:g} {unit_text(unit)}"
        limits.append(spec.Call("axhline", (bound,), stroke(INK, 0.9, 2)))
        limits.append(spec.Note(text, (0.99, bound), (0, offset), {**LIMIT, "va": side}))
    return [
        *lines,
        *(spec.Call("axvline", (end,), stroke(FAINT, 0.8, 1.5)) for end in drive.breaks),
        *limits,
    ]


def _ends(drives: Sequence[Series], bounds: Ends | None) -> Ends:
    # Room beyond the bounds for their labels, and a little for what exceeds them.
    low = min(float(np.nanmin(one.values)) for one in drives)
    high = max(float(np.nanmax(one.values)) for one in drives)
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
HATCHES = ("", "///", "...", "xxx", "---", "+++")
FILLS = (FIRST, "#e9c08a", "#8fb97a", "#dcb6cf", "#5b87b5", "#d9d9d9")
"""Of bars side by side, told apart by brightness and hatching."""


@dataclass(frozen=True)
class Chart:
    """Values over what was varied.

    Attributes:
        across: name of the key along the axis, with its unit.
        places: its values, numbers or words.
        series: for each combination of the other keys its name and the value of each place; None where there
            is none.
        quantity: what the values are, with their unit.
        title: of the panel.
    """

    across: str
    places: tuple[float, ...] | tuple[str, ...]
    series: tuple[tuple[str, tuple[float | None, ...]], ...]
    quantity: str
    title: str = ""

    @property
    def worded(self) -> bool:
        """Whether the places are words."""
        return any(isinstance(place, str) for place in self.places)

    @property
    def values(self) -> Array:
        """Those of the series, (series, places); not a number where there is none."""
        found = np.array([values for _, values in self.series], dtype=float)
        return np.where(np.isfinite(found), found, np.nan)


def panels(charts: Sequence[Chart]) -> spec.Plot:
    """One panel for each chart, lines over numbers, bars over words; all with the same series."""
    columns, first = (1 if len(charts) == 1 else 2), charts[0]
    height = (3.0 if columns == 1 else 2.4) * -(-len(charts) // columns)
    look = _fill if first.worded else _line
    named = first.series if len(first.series) > 1 else ()
    keys = [spec.Key(name, look(index), patch=first.worded) for index, (name, _) in enumerate(named)]
    legend = spec.Legend(keys, 3, options={"handlelength": 3.2})
    made = [_panel(one) for one in charts]
    alike = len({one.across for one in charts}) == 1
    return spec.Plot(made, columns, height=height, labels="outer ticks" if alike else "each", legend=legend)


def _panel(chart: Chart) -> spec.Panel:
    values, y = chart.values, spec.Axis(chart.quantity)
    if _spans_decades(values):
        y = spec.Axis(chart.quantity, logarithmic=True)
    elif np.nanmin(values, initial=0.0) >= 0:
        y = spec.Axis(chart.quantity, ends=(0.0, 1.08 * float(np.nanmax(values, initial=0.0)) or 1.0))
    if chart.worded:
        words = [(index, str(place)) for index, place in enumerate(chart.places)]
        return spec.Panel(_bars(values), spec.Axis(chart.across, ticks=words, grid=False), y, chart.title)
    places = np.array(chart.places, dtype=float)
    parts = [spec.Line(places, row, {**_line(index), "zorder": 3}) for index, row in enumerate(values)]
    ticks = tuple((float(place), f"{place:g}") for place in places)
    x = spec.Axis(chart.across, logarithmic=_spans_decades(places), ticks=ticks)
    return spec.Panel(parts, x, y, chart.title, margin=0.06)


def _bars(values: Array) -> list[spec.Part]:
    width = 0.8 / len(values)
    middle = np.arange(values.shape[1]) - 0.5 * (len(values) - 1) * width
    return [
        spec.Call("bar", (middle + index * width, row, 0.92 * width), {**_fill(index), "zorder": 3})
        for index, row in enumerate(values)
    ]


def _spans_decades(values: Values) -> bool:
    known = np.asarray(values)[np.isfinite(values)]
    return bool(len(known) > 1 and known.min() > 0 and known.max() >= DECADE * known.min())


def _line(index: int) -> Look:
    # Smaller and smaller, so that lines that coincide are all seen.
    return {**line_look(index), "marker": MARKERS[index % len(MARKERS)], "markersize": 9.5 - 1.3 * index}


def _fill(index: int) -> Look:
    return {"facecolor": FILLS[index], "hatch": HATCHES[index], "edgecolor": INK, "linewidth": 0.7}


def heat_map(chart: Chart) -> spec.Plot:
    """Two numeric keys: a cell for each pair of values, shaded and labelled with what it reaches."""
    places = [(at, f"{place:g}") for at, place in enumerate(chart.places)]
    names = [(at, name) for at, (name, _) in enumerate(chart.series)]
    x, y = spec.Axis(chart.across, ticks=places, grid=False), spec.Axis(ticks=names, grid=False)
    panel = spec.Panel([spec.Cells(chart.values, chart.quantity)], x, y)
    return spec.Plot([panel], height=1.2 + 0.36 * len(chart.series))
