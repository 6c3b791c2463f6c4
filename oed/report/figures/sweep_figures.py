"""The figures of a sweep: lines over numbers, bars over words, and a map over two numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import NullFormatter, NullLocator

from oed.report.figures.chart import Chart
from oed.report.figures.panels import HANDLE, WIDTH, legend_columns, new_grid
from oed.report.figures.plots import INK, as_drawn, line_style

DECADE = 20.0
"""Ratio of the largest to the smallest value from which an axis is logarithmic."""
MARKERS = ("o", "s", "^", "D", "v", "P")
HATCHES = ("", "///", "...", "xxx", "---", "+++")
FILLS = ("#123f6d", "#e9c08a", "#8fb97a", "#dcb6cf", "#5b87b5", "#d9d9d9")
"""Of bars side by side, told apart by brightness and hatching."""


def lines(chart: Chart) -> Figure:
    """One panel: a line of each combination of the other keys, or bars where the key's values are words."""
    return panels([chart])


def panels(charts: Sequence[Chart]) -> Figure:
    """One panel for each chart, all over the same key."""
    columns = 1 if len(charts) == 1 else 2
    grid = new_grid(len(charts), columns, WIDTH, 3.0 if columns == 1 else 2.4, share_y=False)
    for ax, chart in zip(grid.axes, charts, strict=True):
        plot_chart(ax, chart)
        ax.set_title(as_drawn(chart.title))
    grid.label(charts[0].across, charts[0].quantity)
    for ax in grid.axes:
        ax.tick_params(labelbottom=True, labelleft=True)
    handles = _handles(charts[0])
    if handles:
        names = [str(handle.get_label()) for handle in handles]
        ncols = min(3, legend_columns(names, WIDTH, HANDLE))
        grid.figure.legend(handles=handles, loc="outside upper center", ncols=ncols, handlelength=3.2)
    return grid.figure


def plot_chart(ax: Axes, chart: Chart) -> Axes:
    """Draw a chart's series; axes are logarithmic where the values span decades."""
    if any(isinstance(place, str) for place in chart.places):
        return _plot_bars(ax, chart)
    places = np.array(chart.places, dtype=float)
    for index, (_, values) in enumerate(chart.series):
        ax.plot(places, _numbers(values), **_line(index), zorder=3)
    ax.margins(x=0.06)
    if _spans_decades(places):
        ax.set_xscale("log")
    ax.set_xticks(places, [f"{place:g}" for place in places])
    ax.xaxis.set_minor_locator(NullLocator())
    _scale_values(ax, chart)
    return ax


def _plot_bars(ax: Axes, chart: Chart) -> Axes:
    places, width = np.arange(len(chart.places)), 0.8 / len(chart.series)
    for index, (_, values) in enumerate(chart.series):
        offset = (index - (len(chart.series) - 1) / 2) * width
        ax.bar(places + offset, _numbers(values), 0.92 * width, **_fill(index), zorder=3)
    ax.set_xticks(places, [as_drawn(str(place)) for place in chart.places])
    ax.grid(visible=False, axis="x")
    _scale_values(ax, chart)
    return ax


def _scale_values(ax: Axes, chart: Chart) -> None:
    numbers = np.concatenate([_numbers(values) for _, values in chart.series])
    if _spans_decades(numbers):
        ax.set_yscale("log")
        ax.yaxis.set_minor_formatter(NullFormatter())
    elif np.nanmin(numbers, initial=0.0) >= 0:
        ax.set_ylim(0.0, 1.08 * float(np.nanmax(numbers, initial=0.0)) or 1.0)


def _spans_decades(values: Any) -> bool:
    known = values[np.isfinite(values)]
    return bool(len(known) > 1 and known.min() > 0 and known.max() >= DECADE * known.min())


def _numbers(values: Sequence[float | None]) -> Any:
    found = np.array([np.nan if value is None else value for value in values], dtype=float)
    return np.where(np.isfinite(found), found, np.nan)


def _line(index: int) -> dict[str, Any]:
    # Smaller and smaller, so that lines that coincide are all seen.
    marker = {"marker": MARKERS[index % len(MARKERS)], "markersize": 9.5 - 1.3 * index}
    return {**line_style(index), **marker}


def _fill(index: int) -> dict[str, Any]:
    return {"facecolor": FILLS[index], "hatch": HATCHES[index], "edgecolor": INK, "linewidth": 0.7}


def _handles(chart: Chart) -> list[Any]:
    if len(chart.series) == 1:
        return []
    if any(isinstance(place, str) for place in chart.places):
        return [Patch(**_fill(index), label=as_drawn(name)) for index, (name, _) in enumerate(chart.series)]
    return [
        Line2D([], [], **_line(index), label=as_drawn(name)) for index, (name, _) in enumerate(chart.series)
    ]


def heat_map(chart: Chart) -> Figure:
    """Two numeric keys: a cell for each pair of values, shaded and labelled with what it reaches."""
    values = np.array([_numbers(line) for _, line in chart.series])
    figure = Figure(figsize=(WIDTH, 1.2 + 0.36 * len(values)), layout="constrained")
    ax = figure.subplots()
    image = ax.imshow(values, cmap="Greys", aspect="auto", origin="lower")
    low, high = np.nanmin(values), np.nanmax(values)
    for (row, column), value in np.ndenumerate(values):
        dark = np.isfinite(value) and value - low > 0.55 * (high - low)
        text = f"{value:.3g}" if np.isfinite(value) else "–"
        ax.text(column, row, text, ha="center", va="center", color="white" if dark else INK, fontsize=8)
    ax.set_xticks(range(len(chart.places)), [f"{place:g}" for place in chart.places])
    ax.set_yticks(range(len(values)), [as_drawn(name) for name, _ in chart.series])
    ax.grid(visible=False)
    ax.set_xlabel(as_drawn(chart.across))
    figure.colorbar(image, ax=ax, label=as_drawn(chart.quantity))
    return figure
