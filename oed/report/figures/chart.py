"""The figures of a sweep, over what was varied: lines over numbers, bars over words, a map over two."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from oed.report.figures import spec
from oed.report.figures.spec import FIRST, INK, Array, Look, Values, line_look

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
    """One panel for each chart, all over the same key: lines over numbers, bars over words."""
    columns, first = (1 if len(charts) == 1 else 2), charts[0]
    height = (3.0 if columns == 1 else 2.4) * -(-len(charts) // columns)
    look = _fill if first.worded else _line
    named = first.series if len(first.series) > 1 else ()
    keys = [spec.Key(name, look(index), patch=first.worded) for index, (name, _) in enumerate(named)]
    legend = spec.Legend(keys, 3, options={"handlelength": 3.2})
    made = [_panel(one) for one in charts]
    return spec.Plot(made, columns, height=height, labels="outer ticks", legend=legend)


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
        spec.Bars(middle + index * width, row, 0.92 * width, {**_fill(index), "zorder": 3})
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
