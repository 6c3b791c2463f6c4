"""The figures of paths: panels on one scale, with the room around them, a speed bar and a legend."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.markers import MarkerStyle
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import Bbox

from oed.report.figures import path_figures
from oed.report.figures.driven import Bundle, Path
from oed.report.figures.panels import BEYOND, WIDTH, Grid, legend_columns, new_grid
from oed.report.figures.plots import INK, as_drawn
from oed.report.parts.rooms import Room
from oed.robots.limits.outline import Outline

HANDLE = 0.45
"""Width of what stands before an entry of the legend, and of the gap after it [inch]."""
LINE = 0.28
"""Height of a further line of a legend or a title [inch]."""


def paths(drives: Sequence[Path], room: Room) -> Figure:
    """One panel per drive on one scale, its room behind it, speed as colour and width."""
    boundaries = _speed_classes(drives)
    box = _view(drives, room)
    columns = _path_columns(len(drives), box)
    grid = new_grid(len(drives), columns, WIDTH, 3.0)
    _equal_scales(grid, columns, box)
    for ax, drive in zip(grid.axes, drives, strict=True):
        path_figures.plot_room(ax, room)
        scale = (1.0, 0.85, 0.7)[columns - 1]
        path_figures.plot_path(ax, drive, boundaries, scale, room.body_radius)
        ax.set_title(as_drawn(drive.title), fontsize=(10, 10, 9)[columns - 1])
    grid.label("x [m]", "y [m]")
    _speed_bar(grid, boundaries)
    handles, (width, height) = _path_legend(drives) + _room_legend(drives, room), _size(grid)
    ncols = legend_columns([str(handle.get_label()) for handle in handles], width, HANDLE)
    lines = math.ceil(len(handles) / ncols) - 1 + _long_titles(drives[:columns])
    grid.figure.set_size_inches(width, height + LINE * lines)
    grid.figure.legend(
        handles=handles, loc="outside lower center", ncols=ncols, columnspacing=1.2, handletextpad=0.3
    )
    return grid.figure


def bundles(cases: Sequence[Bundle], room: Room) -> Figure:
    """One panel per drive on one scale: where robots with other parameters go."""
    area = _extent_of(room.floor)
    points = np.vstack([np.vstack([*case.inside, *case.outside, *case.nominal]) for case in cases])
    everything = Bbox.from_extents(*points.min(axis=0), *points.max(axis=0))
    widest = everything if area is None else area.padded(BEYOND * max(area.width, area.height))
    box = Bbox.intersection(everything, widest) or everything
    box = box if area is None else Bbox.union([box, area])
    columns = min(2, len(cases))
    grid = new_grid(len(cases), columns, WIDTH, 3.0)
    _equal_scales(grid, columns, box)
    for ax, case in zip(grid.axes, cases, strict=True):
        path_figures.plot_room(ax, room)
        path_figures.plot_bundle(ax, case.inside, case.outside, case.nominal)
        ax.set_title(as_drawn(case.title))
    grid.label("x [m]", "y [m]")
    looks = {
        "nominal robot": path_figures.NOMINAL,
        "keeps the limits": path_figures.INSIDE,
        "leaves them": path_figures.OUTSIDE,
    }
    handles = [Line2D([], [], **{**look, "linewidth": 1.6}, label=label) for label, look in looks.items()]
    handles += [Line2D([], [], **path_figures.START, label="start")]
    handles += [Line2D([], [], **path_figures.END, label="end")]
    width, height = _size(grid)
    grid.figure.set_size_inches(width, height + LINE)
    grid.figure.legend(
        handles=handles,
        loc="outside lower center",
        ncols=legend_columns([str(handle.get_label()) for handle in handles], width, HANDLE),
    )
    return grid.figure


def _size(grid: Grid) -> tuple[float, float]:
    width, height = grid.figure.get_size_inches()
    return float(width), float(height)


def _long_titles(top: Sequence[Path]) -> int:
    # Lines of the top panels' titles for which there is no room; those below grow into the gaps.
    return max(0, *(drive.title.count("\n") - 1 for drive in top))


def _speed_bar(grid: Grid, boundaries: Sequence[float]) -> None:
    colours, norm = path_figures.speed_colours(boundaries)
    share = min(1.0, 3.6 / _size(grid)[1])
    bar = ScalarMappable(norm, colours)
    grid.figure.colorbar(bar, ax=grid.axes, label="speed [m/s]", shrink=share, aspect=22, pad=0.02)


def _view(drives: Sequence[Path], room: Room) -> Bbox:
    # All that is feasible, and of what lies about and of drives that break limits as much as leaves that
    # in sight.
    area = _extent_of(room.floor)
    marks = [Bbox.from_extents(x, y, x, y) for x, y in room.beacons]
    marks += [box for box in map(_extent_of, room.hatched) if box]
    everything = [_extent(drive, room) for drive in drives] + marks + ([area] if area else [])
    core = [_extent(drive, room) for drive in drives if drive.feasible] + ([area] if area else [])
    if not core:
        return Bbox.union(everything)
    box = Bbox.union(core)
    seen = Bbox.intersection(Bbox.union(everything), box.padded(BEYOND * max(box.width, box.height)))
    return seen or box


def _extent(drive: Path, room: Room) -> Bbox:
    points = np.vstack([run.points for run in drive.runs])
    box = Bbox.from_extents(*points.min(axis=0), *points.max(axis=0))
    ends = [(run.x[end], run.y[end]) for run in drive.runs for end in (0, -1)] if room.body_radius else []
    return Bbox.union([box, *(Bbox.from_extents(x, y, x, y).padded(room.body_radius) for x, y in ends)])


def _speed_classes(drives: Sequence[Path]) -> list[float]:
    fastest = max(float(np.abs(run.speed).max()) for drive in drives for run in drive.runs)
    locator = MaxNLocator(nbins=8, steps=[1, 2, 2.5, 5, 10])
    return [float(level) for level in locator.tick_values(0.0, fastest if fastest > 0 else 1.0)]


def _extent_of(outline: Outline | None) -> Bbox | None:
    if outline is None:
        return None
    left, right, bottom, top = outline.extent
    return Bbox.from_extents(left, bottom, right, top)


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


def _path_legend(drives: Sequence[Path]) -> list[Any]:
    arrow = MarkerStyle(path_figures.ARROW)
    runs = [run for drive in drives for run in drive.runs]
    sideways = any(drive.sideways for drive in drives)
    handles: list[Any] = [
        Line2D([], [], **path_figures.START, label="start"),
        Line2D([], [], **path_figures.END, label="end"),
    ]
    if any(drive.goes for drive in drives):
        label = "motion" if sideways else "forwards"
        handles.append(Line2D([], [], marker=arrow, **path_figures.arrow_style(True), label=label))
    if sideways and any(drive.goes for drive in drives):
        pointer = MarkerStyle(path_figures.POINTER)
        handles.append(Line2D([], [], marker=pointer, **path_figures.pointer_style(0.7), label="heading"))
    if any((run.speed < 0).any() for run in runs):
        handles.append(Line2D([], [], marker=arrow, **path_figures.arrow_style(False), label="backwards"))
    if any(0 < len(run.edges) < path_figures.MOST_TICKS for run in runs):
        tick = {"marker": "|", "markersize": 9, "markeredgewidth": 1.2, "linestyle": "none"}
        handles.append(Line2D([], [], color=INK, **tick, label="segments meet"))
    return handles


def _room_legend(drives: Sequence[Path], room: Room) -> list[Any]:
    handles: list[Any] = []
    if len(room.beacons):
        handles.append(Line2D([], [], **path_figures.BEACON, label="beacon"))
    if room.obstacles:
        handles.append(Patch(**path_figures.OBSTACLE, label="obstacle"))
    if room.body_radius:
        circle = {"marker": "o", "markersize": 13, "markeredgewidth": 0.7, "linestyle": "none"}
        face = {"markerfacecolor": "none", "markeredgecolor": INK}
        handles.append(Line2D([], [], **circle, **face, label="robot's body"))
    if any(run.trailer is not None for drive in drives for run in drive.runs):
        handles.append(Line2D([], [], **path_figures.TRAILER, label="trailer's axle"))
    return handles
