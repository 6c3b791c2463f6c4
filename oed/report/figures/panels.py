"""Whole figures: panels of plot functions with shared scales, labels, legends and colour bars."""

from __future__ import annotations

import io
import math
import re
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from oed.foundation.shown import page_text
from oed.foundation.text import unit_text
from oed.report.figures import plots as figures
from oed.report.figures.plots import as_drawn
from oed.report.parts.inputs import Series
from oed.report.parts.reading import Cloud

WIDTH = 7.2
"""Width of a report's column [inch]."""
BEYOND = 0.3
"""How far beyond the limits a panel shows a drive that breaks them, as a share of the limits' width."""
LETTER = 0.072
"""Width of a letter of a legend [inch]."""
HANDLE = 0.75
"""Width of a line before a legend's entry, and of the gap after it [inch]."""
LONG = 22
"""Letters of a legend's entry beyond which there are fewer of them on a line."""
APART = 3.0
"""Ratio of the widths of two estimates beyond which they are drawn on scales of their own."""
Line = tuple[str, Sequence[tuple[float, float]]]
"""A search's name, and its shortfalls [%] over its seconds."""
STYLE = {
    "font.size": 9.5,
    "axes.titlesize": 10,
    "axes.titleweight": "bold",
    "axes.edgecolor": figures.FAINT,
    "axes.linewidth": 0.8,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "xtick.color": figures.INK,
    "ytick.color": figures.INK,
    "legend.frameon": False,
    "svg.hashsalt": "oed",
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans", "Verdana", "Arial"],
}


def svg_text(draw: Any) -> str:
    """The SVG of the Figure that `draw()` makes: the same text for the same data."""
    with style.context(["default", STYLE]), warnings.catch_warnings():
        # Letters that the font here has not: those of the viewer are drawn.
        warnings.filterwarnings("ignore", message="Glyph ", category=UserWarning)
        buffer = io.StringIO()
        nothing = dict.fromkeys(("Date", "Creator", "Format", "Type"))
        draw().savefig(buffer, format="svg", metadata=nothing)
    return page_text(_compact(buffer.getvalue()))


def _compact(svg: str) -> str:
    # Coordinates to a hundredth of a point, far below what can be seen; no indentation, no idle names.
    def shorten(match: re.Match[str]) -> str:
        return re.sub(r"-?\d+\.\d{3,}", lambda number: f"{float(number[0]):.2f}", match[0])

    shortened = re.sub(r' (?:d|x|y)="[^"]*"|translate\([^)]*\)', shorten, svg)
    anonymous = re.sub(r'<g id="[^"]*"', "<g", shortened)
    return "\n".join(line.strip() for line in anonymous.splitlines() if line.strip()) + "\n"


@dataclass(frozen=True)
class Grid:
    """A figure and its panels, row by row."""

    figure: Figure
    axes: list[Axes]

    def label(self, x: str, y: str) -> None:
        """Axis labels on the outer panels, tick labels on all that have nothing below or beside them."""
        columns = self.axes[0].get_gridspec().ncols
        for index, ax in enumerate(self.axes):
            below, beside = index + columns >= len(self.axes), index % columns == 0
            ax.tick_params(labelbottom=below, labelleft=beside)
            ax.set_xlabel(as_drawn(x) if below else "")
            ax.set_ylabel(as_drawn(y) if beside else "")


def new_grid(count: int, columns: int, width: float, panel_height: float, share_y: bool = True) -> Grid:
    """A figure of that width [inch] with `count` panels in so many columns."""
    rows = math.ceil(count / columns)
    figure = Figure(figsize=(width, rows * panel_height), layout="constrained")
    shape = figure.subplots(rows, columns, squeeze=False, sharey=share_y)
    axes = list(shape.ravel())
    for spare in axes[count:]:
        figure.delaxes(spare)
    return Grid(figure, axes[:count])


def legend_columns(labels: Sequence[str], width: float, handle: float) -> int:
    """How many entries of a legend fit side by side, at most 6.

    Args:
        labels: of the entries, which fill column by column.
        width: of the figure [inch].
        handle: room that each entry takes beside its text [inch].
    """
    for rows in range(math.ceil(len(labels) / 6), len(labels)):
        columns = math.ceil(len(labels) / rows)
        filled = np.array_split([len(label) for label in labels], columns)
        if LETTER * sum(int(letters.max()) for letters in filled) + handle * columns <= width:
            return columns
    return 1


def series(drives: Sequence[Series], labels: Sequence[str], quantity: str, unit: str, bounds: Any) -> Figure:
    """One panel per drive: its inputs or their rates over time, between their bounds."""
    columns = 1 if len(drives) == 1 else 2
    grid = new_grid(len(drives), columns, WIDTH, 2.5 if columns == 1 else 2.1)
    for ax, drive in zip(grid.axes, drives, strict=True):
        figures.plot_series(ax, drive, bounds, unit)
        ax.set_title(as_drawn(drive.title))
    low, high = _range(drives, bounds)
    grid.axes[0].set_ylim(low, high)
    several = any(drive.breaks for drive in drives)
    time = "time [s], runs one after the other" if several else "time [s]"
    grid.label(time, f"{quantity}\n[{unit_text(unit)}]" if unit else quantity)
    handles = [
        Line2D([], [], **figures.line_style(index), label=as_drawn(label))
        for index, label in enumerate(labels)
    ]
    if handles:
        ncols = min(4, legend_columns(labels, WIDTH, HANDLE))
        grid.figure.legend(handles=handles, loc="outside upper center", ncols=ncols, handlelength=3.2)
    return grid.figure


def _range(drives: Sequence[Series], bounds: tuple[float, float] | None) -> tuple[float, float]:
    # Room beyond the bounds for their labels, and a little for what exceeds them.
    low = min(float(np.nanmin(drive.values)) for drive in drives)
    high = max(float(np.nanmax(drive.values)) for drive in drives)
    if bounds is None:
        room = 0.06 * (high - low or 1.0)
        return low - room, high + room
    room = (0.28 if bounds[0] <= low + 1e-9 and high <= bounds[1] + 1e-9 else BEYOND) * (
        bounds[1] - bounds[0]
    )
    return bounds[0] - room, bounds[1] + room


def starts(spreads: Sequence[tuple[str, Sequence[float], int]]) -> Figure:
    """One panel per search: its starts' shortfalls [%], best first, and starts without a design."""
    columns = 1 if len(spreads) == 1 else 2
    grid = new_grid(len(spreads), columns, WIDTH, 2.7, share_y=False)
    for ax, (title, shortfalls, failed) in zip(grid.axes, spreads, strict=True):
        figures.plot_starts(ax, shortfalls, failed)
        ax.set_title(as_drawn(title))
        ax.xaxis.set_major_locator(MaxNLocator(nbins=12, integer=True))
    grid.label("starts, best first", "below the best start [%]")
    for ax in grid.axes:
        ax.tick_params(labelbottom=True, labelleft=True)
    handles: list[Any] = [
        Line2D([], [], marker="o", color="#123f6d", linestyle="none", label="start"),
        Patch(color="#e6eef5", label="within 1 % of the best"),
    ]
    if any(failed for _, _, failed in spreads):
        handles.append(
            Line2D([], [], marker="x", color=figures.INK, linestyle="none", label="no feasible design")
        )
    grid.figure.legend(handles=handles, loc="outside upper center", ncols=3)
    return grid.figure


def convergence(lines: Sequence[Line], apart: bool) -> Figure:
    """All searches on one pair of axes: shortfall from the best [%] against seconds.

    Args:
        lines: of each search.
        apart: whether the best is that by each search's own criterion.
    """
    figure = Figure(figsize=(WIDTH, 3.2), layout="constrained")
    ax = figure.subplots()
    for (_, points), line in zip(lines, _cycled(len(lines)), strict=True):
        figures.plot_convergence(ax, points, line)
    lowest, highest = (choose(value for _, points in lines for _, value in points) for choose in (min, max))
    ax.set_ylim(lowest / 2, 2 * max(highest, 1.0))
    ax.set_xlabel("time [s]")
    ax.set_ylabel("below the best by\nits own criterion [%]" if apart else "below the best [%]")
    handles = [
        Line2D([], [], **line, label=as_drawn(name))
        for (name, _), line in zip(lines, _cycled(len(lines)), strict=True)
    ]
    longest = max(len(name) for name, _ in lines)
    columns = 4 if longest <= LONG else 2 if longest <= 2 * LONG else 1
    figure.legend(handles=handles, loc="outside upper center", ncols=columns, handlelength=3.2)
    return figure


def _cycled(count: int) -> list[Mapping[str, Any]]:
    return [figures.line_style(index) for index in range(count)]


def clouds(drawn: Sequence[Cloud]) -> Figure:
    """One panel per drive, all on one scale: simulated estimates and their ellipses."""
    columns = min(len(drawn), 2)
    grid = new_grid(len(drawn), columns, WIDTH, 3.1)
    reach = _reach(drawn)
    for ax, cloud in zip(grid.axes, drawn, strict=True):
        figures.plot_cloud(ax, cloud)
        ax.set_xlim(cloud.true[0] - 1.25 * reach[0], cloud.true[0] + 1.25 * reach[0])
        ax.set_ylim(cloud.true[1] - 1.25 * reach[1], cloud.true[1] + 1.25 * reach[1])
        if reach[0] == reach[1]:
            ax.set_aspect("equal")
        ax.set_title(as_drawn(cloud.title))
    grid.label(*drawn[0].labels)
    handles = [
        Line2D([], [], marker=".", color="#7a95ad", linestyle="none", label="estimate"),
        Line2D([], [], **figures.TRUTH, label="true"),
        Line2D([], [], **figures.ELLIPSES[0], label="95 %, promised"),
        Line2D([], [], **figures.ELLIPSES[1], label="95 %, simulated"),
    ]
    grid.figure.legend(handles=handles, loc="outside upper center", ncols=4)
    return grid.figure


def _reach(drawn: Sequence[Cloud]) -> tuple[float, float]:
    # How far the widest ellipse goes along either axis; one scale for both where they are alike.
    outlines = [np.abs(figures.ellipse(0 * one.true, one.promised)).max(axis=1) for one in drawn]
    x, y = (float(size) for size in np.max(outlines, axis=0))
    alike = drawn[0].alike and max(x, y) <= APART * min(x, y)
    return (max(x, y), max(x, y)) if alike else (x, y)
