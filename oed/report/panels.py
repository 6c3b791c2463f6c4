"""Whole figures: panels of plot functions with shared scales, labels, legends and colour bars."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.markers import MarkerStyle
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import Bbox

from oed.report import figures
from oed.report.reading import NOWHERE, Cloud, Path, Series
from oed.report.wording import unit_text

WIDTH = 7.2
"""Width of a report's column [inch]."""
BEYOND = 0.3
"""How far beyond the limits a panel shows a drive that breaks them, as a share of the limits' width."""
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
    with style.context(["default", STYLE]):
        buffer = io.StringIO()
        nothing = dict.fromkeys(("Date", "Creator", "Format", "Type"))
        draw().savefig(buffer, format="svg", metadata=nothing)
    return _compact(buffer.getvalue())


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
            ax.set_xlabel(x if below else "")
            ax.set_ylabel(y if beside else "")


def _grid(count: int, columns: int, width: float, panel_height: float, share_y: bool = True) -> Grid:
    rows = math.ceil(count / columns)
    figure = Figure(figsize=(width, rows * panel_height), layout="constrained")
    shape = figure.subplots(rows, columns, squeeze=False, sharey=share_y)
    axes = list(shape.ravel())
    for spare in axes[count:]:
        figure.delaxes(spare)
    return Grid(figure, axes[:count])


def paths(drives: Sequence[Path], workspace: Mapping[str, Any] | None, beacons: Any = ()) -> Figure:
    """One panel per drive on one scale, workspace and beacons behind it, speed as colour and width."""
    boundaries = _speed_classes(drives)
    box = _view(_extent_of(workspace), drives, beacons)
    columns = _path_columns(len(drives), box)
    grid = _grid(len(drives), columns, WIDTH, 3.0)
    _equal_scales(grid, columns, box)
    for ax, drive in zip(grid.axes, drives, strict=True):
        figures.plot_workspace(ax, workspace)
        figures.plot_beacons(ax, beacons)
        figures.plot_path(ax, drive, boundaries, scale=(1.0, 0.85, 0.7)[columns - 1])
        ax.set_title(drive.title, fontsize=(10, 10, 9)[columns - 1])
    grid.label("x [m]", "y [m]")
    _speed_bar(grid, boundaries)
    handles = _path_legend(drives)
    if len(beacons):
        handles.append(Line2D([], [], **figures.BEACON, label="beacon"))
    grid.figure.legend(
        handles=handles, loc="outside lower center", ncols=6, columnspacing=1.2, handletextpad=0.3
    )
    return grid.figure


def _speed_bar(grid: Grid, boundaries: Sequence[float]) -> None:
    colours, norm = figures.speed_colours(boundaries)
    share = min(1.0, 3.6 / float(grid.figure.get_size_inches()[1]))
    bar = ScalarMappable(norm, colours)
    grid.figure.colorbar(bar, ax=grid.axes, label="speed [m/s]", shrink=share, aspect=22, pad=0.02)


def _view(area: Bbox | None, drives: Sequence[Path], beacons: Any = ()) -> Bbox:
    # All that is feasible, and of beacons and drives that break limits as much as leaves that in sight.
    marks = [Bbox.from_extents(x, y, x, y) for x, y in beacons]
    everything = [_extent(drive) for drive in drives] + marks + ([area] if area else [])
    core = [_extent(drive) for drive in drives if drive.feasible] + ([area] if area else [])
    if not core:
        return Bbox.union(everything)
    box = Bbox.union(core)
    seen = Bbox.intersection(Bbox.union(everything), box.padded(BEYOND * max(box.width, box.height)))
    return seen or box


def _extent(drive: Path) -> Bbox:
    return Bbox.from_extents(drive.x.min(), drive.y.min(), drive.x.max(), drive.y.max())


def _speed_classes(drives: Sequence[Path]) -> list[float]:
    fastest = max(float(np.abs(drive.speed).max()) for drive in drives)
    locator = MaxNLocator(nbins=8, steps=[1, 2, 2.5, 5, 10])
    return [float(level) for level in locator.tick_values(0.0, fastest if fastest > 0 else 1.0)]


def _extent_of(workspace: Mapping[str, Any] | None) -> Bbox | None:
    if workspace is None or workspace["kind"] not in figures.OUTLINES:
        return None
    patch = figures.OUTLINES[workspace["kind"]](workspace)
    return patch.get_path().transformed(patch.get_patch_transform()).get_extents()


def _path_columns(count: int, box: Bbox) -> int:
    if box.height < 0.45 * box.width:
        return 1
    return 1 if count == 1 else 2 if count <= 4 else 3


def _equal_scales(grid: Grid, columns: int, box: Bbox) -> None:
    # One box for all panels; the figure's height follows from its shape.
    pad = 0.06 * max(box.width, box.height, 1e-3)
    for ax in grid.axes:
        ax.set_xlim(box.x0 - pad, box.x1 + pad)
        ax.set_ylim(box.y0 - pad, box.y1 + pad)
        ax.set_aspect("equal")
        ax.xaxis.set_major_locator(MaxNLocator(nbins=4 if columns > 2 else 6, steps=[1, 2, 5, 10]))
        ax.yaxis.set_major_locator(MaxNLocator(nbins=6, steps=[1, 2, 5, 10]))
    ratio = (box.height + 2 * pad) / (box.width + 2 * pad)
    width = 5.6 if columns == 1 and ratio > 0.5 else WIDTH
    panel = (width - 1.4) / columns * min(ratio, 1.6)
    grid.figure.set_size_inches(width, math.ceil(len(grid.axes) / columns) * (panel + 0.35) + 0.8)


def _path_legend(drives: Sequence[Path]) -> list[Line2D]:
    arrow = MarkerStyle(figures.ARROW)
    handles = [
        Line2D([], [], **figures.START, label="start"),
        Line2D([], [], **figures.END, label="end"),
    ]
    if any(np.hypot(np.diff(drive.x), np.diff(drive.y)).sum() >= NOWHERE for drive in drives):
        handles.append(Line2D([], [], marker=arrow, **figures.arrow_style(True), label="forwards"))
    if any((drive.speed < 0).any() for drive in drives):
        handles.append(Line2D([], [], marker=arrow, **figures.arrow_style(False), label="backwards"))
    if any(0 < len(drive.edges) < figures.MOST_TICKS for drive in drives):
        tick = {"marker": "|", "markersize": 9, "markeredgewidth": 1.2, "linestyle": "none"}
        handles.append(Line2D([], [], color=figures.INK, **tick, label="segments meet"))
    return handles


def series(drives: Sequence[Series], labels: Sequence[str], quantity: str, unit: str, bounds: Any) -> Figure:
    """One panel per drive: its inputs or their rates over time, between their bounds."""
    columns = 1 if len(drives) == 1 else 2
    grid = _grid(len(drives), columns, WIDTH, 2.5 if columns == 1 else 2.1)
    for ax, drive in zip(grid.axes, drives, strict=True):
        figures.plot_series(ax, drive, bounds, unit)
        ax.set_title(drive.title)
    low, high = _range(drives, bounds)
    grid.axes[0].set_ylim(low, high)
    grid.label("time [s]", f"{quantity}\n[{unit_text(unit)}]")
    handles = [
        Line2D([], [], **line, label=label) for line, label in zip(figures.LINES, labels, strict=False)
    ]
    grid.figure.legend(handles=handles, loc="outside upper center", ncols=4, handlelength=3.2)
    return grid.figure


def _range(drives: Sequence[Series], bounds: tuple[float, float] | None) -> tuple[float, float]:
    # Room beyond the bounds for their labels, and a little for what exceeds them.
    low = min(float(drive.values.min()) for drive in drives)
    high = max(float(drive.values.max()) for drive in drives)
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
    grid = _grid(len(spreads), columns, WIDTH, 2.7, share_y=False)
    for ax, (title, shortfalls, failed) in zip(grid.axes, spreads, strict=True):
        figures.plot_starts(ax, shortfalls, failed)
        ax.set_title(title)
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
        Line2D([], [], **line, label=name) for (name, _), line in zip(lines, _cycled(len(lines)), strict=True)
    ]
    longest = max(len(name) for name, _ in lines)
    columns = 4 if longest <= LONG else 2 if longest <= 2 * LONG else 1
    figure.legend(handles=handles, loc="outside upper center", ncols=columns, handlelength=3.2)
    return figure


def _cycled(count: int) -> list[Mapping[str, Any]]:
    return [figures.LINES[index % len(figures.LINES)] for index in range(count)]


def clouds(drawn: Sequence[Cloud]) -> Figure:
    """One panel per drive, all on one scale: simulated estimates and their ellipses."""
    columns = min(len(drawn), 2)
    grid = _grid(len(drawn), columns, WIDTH, 3.1)
    reach = _reach(drawn)
    for ax, cloud in zip(grid.axes, drawn, strict=True):
        figures.plot_cloud(ax, cloud)
        ax.set_xlim(cloud.true[0] - 1.25 * reach[0], cloud.true[0] + 1.25 * reach[0])
        ax.set_ylim(cloud.true[1] - 1.25 * reach[1], cloud.true[1] + 1.25 * reach[1])
        if reach[0] == reach[1]:
            ax.set_aspect("equal")
        ax.set_title(cloud.title)
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
