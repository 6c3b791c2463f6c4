"""Figures of a trial on a simulated robot: held-out errors, and where the robot truly went."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from oed.report.figures import panels
from oed.report.figures import plots as figures
from oed.report.figures.plots import as_drawn

Array = npt.NDArray[np.float64]

MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")
FILLS = ("#123f6d", "#e07b00", "#ffffff", "#5a9a3c", "#f2c6e0", "#999999", "#222222", "#b0588f")
"""Of fits, told apart by shape and brightness."""
LANE = 0.72
"""Share of a drive's lane that its fits are spread over."""
ROW = 0.34
"""Height of a drive's lane [inch]."""
MOST = 1e3
"""Times the smallest error that are shown; what is larger stands at the edge."""


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


def plot_errors(ax: Axes, floor: Floor, most: float) -> Axes:
    """One lane per drive, in it a mark with its interval for every fit."""
    lanes, count = np.arange(len(floor.drives)), len(floor.fits)
    for index in range(count):
        value, low, high = (
            np.minimum(np.nan_to_num(part, nan=most, posinf=most), most) for part in floor.errors[:, index].T
        )
        heights = lanes + LANE * ((index + 0.5) / count - 0.5)
        ax.hlines(heights, low, high, color=figures.INK, linewidth=1.0, zorder=2)
        ax.plot(value, heights, **_mark(index), zorder=3)
    for lane in lanes[1:]:
        ax.axhline(lane - 0.5, color="#dddddd", linewidth=0.8, zorder=1)
    ax.set_xscale("log")
    ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ax.xaxis.set_minor_formatter(NullFormatter())
    ax.set_yticks(lanes, [as_drawn(name) for name in floor.drives])
    ax.set_ylim(len(lanes) - 0.5, -0.5)
    ax.grid(visible=False, axis="y")
    ax.set_title(as_drawn(floor.title))
    return ax


def plot_went(ax: Axes, went: Went) -> Axes:
    """The planned path dashed, the true ones solid, from a dot to crosses."""
    for index, (_, path) in enumerate(went.true):
        style = _went_style(index)
        ax.plot(*path.T, **style, zorder=2 + index)
        ax.plot(*path[-1], marker="x", color=style["color"], markersize=5, zorder=5)
    ax.plot(*went.planned.T, **PLANNED, zorder=4)
    ax.plot(*went.planned[0], marker="o", color=figures.INK, markersize=3.5, zorder=6)
    ax.set_aspect("equal", adjustable="datalim")
    ax.set_title(as_drawn(went.title), fontsize="small")
    return ax


PLANNED: dict[str, Any] = {"color": figures.INK, "linestyle": (0, (3, 2)), "linewidth": 0.9}


def _went_style(index: int) -> dict[str, Any]:
    colours = ("#9fb4c7", "#123f6d", "#e07b00")
    return {"color": colours[index % len(colours)], "linewidth": 2.6 - 0.7 * (index % 3)}


def _mark(index: int) -> dict[str, Any]:
    return {
        "marker": MARKERS[index % len(MARKERS)],
        "markerfacecolor": FILLS[index % len(FILLS)],
        "markeredgecolor": figures.INK,
        "markeredgewidth": 0.8,
        "markersize": 5.5,
        "linestyle": "none",
    }


def errors(floors: Sequence[Floor]) -> Figure:
    """One panel per floor, all on one scale."""
    lanes, fits = len(floors[0].drives), floors[0].fits
    height = 1.0 + len(fits) // 3 * 0.2 + max(ROW, 0.13 * len(fits)) * lanes
    figure = Figure(figsize=(panels.WIDTH, height), layout="constrained")
    axes = figure.subplots(1, len(floors), sharex=True, sharey=True, squeeze=False)[0]
    known = [floor.errors[np.isfinite(floor.errors)] for floor in floors]
    least = min((float(part.min()) for part in known if part.size), default=1.0)
    for ax, floor in zip(axes, floors, strict=True):
        plot_errors(ax, floor, MOST * least)
    figure.supxlabel("held-out error [mm]", fontsize="medium")
    handles = [Line2D([], [], **_mark(index), label=as_drawn(name)) for index, name in enumerate(fits)]
    ncols = panels.legend_columns(fits, panels.WIDTH, 0.4)
    figure.legend(handles=handles, loc="outside upper center", ncols=min(ncols, 3))
    return figure


def went(drives: Sequence[Went]) -> Figure:
    """One panel per drive, each on a scale of its own."""
    columns = min(4, len(drives))
    rows = math.ceil(len(drives) / columns)
    figure = Figure(figsize=(panels.WIDTH, 0.5 + 2.0 * rows), layout="constrained")
    axes = list(figure.subplots(rows, columns, squeeze=False).ravel())
    for spare in axes[len(drives) :]:
        figure.delaxes(spare)
    for ax, drive in zip(axes, drives, strict=False):
        plot_went(ax, drive)
        ax.tick_params(labelsize="x-small")
    figure.supxlabel("x [m]", fontsize="medium")
    figure.supylabel("y [m]", fontsize="medium")
    handles = [Line2D([], [], **PLANNED, label="planned")]
    handles += [
        Line2D([], [], **_went_style(index), label=as_drawn(name))
        for index, (name, _) in enumerate(drives[0].true)
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles))
    return figure
