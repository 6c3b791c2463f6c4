"""Figures of an estimate: residuals in panels, and driven paths beside their dead reckoning."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from matplotlib.ticker import MaxNLocator

from oed.records.stored.estimate import ReckonedPath
from oed.report.figures.draw import as_drawn, new_grid
from oed.report.figures.residuals import Array, Readings, Residuals
from oed.report.figures.spec import FAINT, INK, WIDTH

SHADES = ("#123f6d", "#8fa9c2")
"""Of logs one after the other."""
DOTS = "#8fa9c2"
LINE = {"color": INK, "linewidth": 1.2, "marker": "o", "markersize": 3}
DASHED: dict[str, Any] = {"color": "#b35c00", "linestyle": (0, (4, 2)), "linewidth": 1.2}
SPREAD = 7.0
"""Typical sizes of residuals beyond which they are drawn as triangles."""
MOST_DOTS = 1000
"""Dots of a panel."""
GAP = 0.01
"""Between logs on the axis of time, as a share of all."""
LETTERS = 26
"""Of a panel's title."""
REFERENCE: dict[str, Any] = {"color": INK, "linestyle": "-", "linewidth": 1.0}
BEFORE: dict[str, Any] = {"color": "#e07b00", "linestyle": (0, (4, 1.8)), "linewidth": 1.2}
AFTER: dict[str, Any] = {"color": "#2f7fc4", "linestyle": (0, (1.2, 1.1)), "linewidth": 1.7}
START: dict[str, Any] = {
    "marker": "o",
    "markersize": 5,
    "markerfacecolor": "white",
    "markeredgecolor": INK,
    "linestyle": "none",
}


def residuals(one: Residuals) -> Figure:
    """Residuals over time, quantity by quantity, and below against speed, a normal and later residuals."""
    count = len(one.quantities)
    figure = Figure(figsize=(WIDTH, 1.25 * count + 2.5), layout="constrained")
    rows = [[f"time {index}"] * 3 for index in range(count)] + [["speed", "normal", "later"]]
    panels = figure.subplot_mosaic(rows, height_ratios=[1.25] * count + [2.2])
    limit = _limit(one.everything.values)
    for index, (name, logs) in enumerate(one.quantities.items()):
        ax = panels[f"time {index}"]
        _plot_time(ax, logs, limit, one.numbered and index == 0)
        ax.set_ylabel(as_drawn(f"{name} [{one.unit}]"))
        ax.tick_params(labelbottom=index == count - 1)
    panels[f"time {count - 1}"].set_xlabel("time [s], one log after the other")
    _plot_speed(panels["speed"], one, limit)
    _plot_normal(panels["normal"], one)
    _plot_later(panels["later"], one)
    return figure


def _limit(values: Array) -> float:
    typical = float(np.quantile(np.abs(values), 0.68))
    largest = float(np.abs(values).max())
    return 1.05 * (min(largest, SPREAD * typical) or 1.0)


def _dots(ax: Axes, x: Array, y: Array, colour: str, size: float = 1.6) -> None:
    # One path of lines without length and with round ends: far smaller than a marker each.
    points = np.repeat(np.column_stack([x, y]), 2, axis=0)
    codes = np.tile([Path.MOVETO, Path.LINETO], len(x))
    path = Path(points, codes)
    path.should_simplify = False
    ax.add_patch(
        PathPatch(path, facecolor="none", edgecolor=colour, linewidth=size, capstyle="round", zorder=2)
    )


def _within(ax: Axes, x: Array, y: Array, limit: float, colour: str) -> None:
    inside = np.abs(y) <= limit
    _dots(ax, x[inside], y[inside], colour)
    for sign, marker in ((1, "^"), (-1, "v")):
        beyond = sign * y > limit
        edge = np.full(int(beyond.sum()), sign * 0.95 * limit)
        ax.plot(x[beyond], edge, marker=marker, markersize=3, color=INK, linestyle="none", zorder=3)


def thinned(x: Array, y: Array, most: int = MOST_DOTS) -> tuple[Array, Array]:
    """So many of the points, at random but always the same: regular ones would meet the logs' own rhythm."""
    if len(x) <= most:
        return x, y
    kept = np.sort(np.random.default_rng(0).choice(len(x), most, replace=False))
    return x[kept], y[kept]


def _one_after_the_other(logs: Sequence[Readings]) -> list[tuple[float, Readings]]:
    # Where on a common axis of time each log begins, its times counted from its own beginning.
    ends = np.array([log.end for log in logs])
    gap = GAP * ends.sum() / max(len(logs) - 1, 1)
    begins = np.concatenate([[0.0], np.cumsum(ends[:-1] + gap)])
    return list(zip(map(float, begins), logs, strict=True))


def _plot_time(ax: Axes, logs: Sequence[Readings], limit: float, numbered: bool) -> None:
    placed = _one_after_the_other(logs)
    for first, shade in enumerate(SHADES[: len(logs)]):
        every = placed[first :: len(SHADES)]
        times = np.concatenate([begin + log.times for begin, log in every])
        values = np.concatenate([log.values for _, log in every])
        _within(ax, *thinned(times, values, MOST_DOTS // len(SHADES[: len(logs)])), limit, shade)
    if numbered and len(logs) > 1:
        _number(ax, placed)
    begin, last = placed[-1]
    ax.set_xlim(0.0, (begin + last.end) or 1.0)
    ax.set_ylim(-limit, limit)
    ax.yaxis.set_major_locator(MaxNLocator(nbins=4, steps=[1, 2, 5, 10]))


def _number(ax: Axes, placed: Sequence[tuple[float, Readings]]) -> None:
    style = {"ha": "center", "va": "bottom", "fontsize": "small", "color": FAINT}
    for number, (begin, log) in enumerate(placed, 1):
        middle = begin + log.end / 2
        ax.text(middle, 1.03, str(number), transform=ax.get_xaxis_transform(), **style)


def _plot_speed(ax: Axes, one: Residuals, limit: float) -> None:
    whole = one.everything
    speeds, values = thinned(np.abs(whole.speeds), whole.values)
    _within(ax, speeds, values, limit, DOTS)
    fastest = float(speeds.max(initial=0.0)) or 1.0
    drawn, sizes = one.noise_by_speed()
    for sign in (-1, 1):
        ax.plot(drawn, sign * sizes, **DASHED, zorder=4)
    ax.plot(*one.by_speed(), **LINE, zorder=5)
    ax.set_xlim(0.0, fastest)
    ax.set_ylim(-limit, limit)
    ax.set_xlabel("speed [m/s]")
    ax.set_ylabel(as_drawn(f"residual [{one.unit}]"))
    ax.xaxis.set_major_locator(MaxNLocator(nbins=4))


def _plot_normal(ax: Axes, one: Residuals) -> None:
    normal, found = one.against_normal()
    reach = float(np.abs(normal).max())
    ax.plot([-reach, reach], [-reach, reach], **DASHED, zorder=3)
    _dots(ax, normal, found, SHADES[0], 2.4)
    ax.set_xlim(-1.05 * reach, 1.05 * reach)
    height = 1.05 * max(reach, float(np.abs(found).max()))
    ax.set_ylim(-height, height)
    ax.set_xlabel("normal quantile")
    ax.set_ylabel("residual / noise")


def _plot_later(ax: Axes, one: Residuals) -> None:
    values = np.nan_to_num(one.correlations)
    if not len(values):
        ax.remove()
        return
    ax.bar(np.arange(1, len(values) + 1), values, width=0.65, color=SHADES[0], zorder=2)
    ax.axhline(0.0, color=INK, linewidth=0.8, zorder=3)
    for sign in (-1, 1):
        if one.bound is not None:
            ax.axhline(sign * one.bound, **DASHED, zorder=4)
    ax.set_xlabel("readings later")
    ax.set_ylabel("correlation")
    ax.set_xlim(0.4, len(values) + 0.6)
    low, high = min(float(values.min()), 0.0), max(float(values.max()), 0.0)
    ax.set_ylim(min(1.15 * low, -0.1), max(1.15 * high, 0.25))
    ax.xaxis.set_major_locator(MaxNLocator(nbins=5, integer=True))


def paths(drawn: Sequence[ReckonedPath]) -> Figure:
    """One panel per log: its measured path, and dead reckoning before and after."""
    columns = 1 if len(drawn) == 1 else 2 if len(drawn) in (2, 4) else 3
    grid = new_grid(len(drawn), columns, WIDTH, 3.0, share_y=False)
    panel = WIDTH / columns * (0.6 if columns == 1 else 1.0)
    shape = float(np.clip(np.median([_shape(one) for one in drawn]), 0.4, 1.2))
    rows = math.ceil(len(drawn) / columns)
    grid.figure.set_size_inches(WIDTH, rows * (max(panel * shape, 1.3) + 0.45) + 0.5)
    for ax, one in zip(grid.axes, drawn, strict=True):
        _plot_path(ax, one)
        ax.set_title(as_drawn(shortened(one.log)), fontsize=(10, 9.5, 8.5)[columns - 1])
    grid.label("x [m]", "y [m]")
    for ax in grid.axes:
        ax.tick_params(labelbottom=True, labelleft=True)
    labels = {"reference": REFERENCE, "dead reckoning, nominal": BEFORE, "dead reckoning, estimated": AFTER}
    handles = [Line2D([], [], **style, label=label) for label, style in {**labels, "start": START}.items()]
    grid.figure.legend(handles=handles, loc="outside upper center", ncols=4, handlelength=3.0)
    return grid.figure


def shortened(name: str, letters: int = LETTERS) -> str:
    """A name with its middle left out where it is too long."""
    half = (letters - 1) // 2
    return name if len(name) <= letters else f"{name[:half]}…{name[-half:]}"


def _plot_path(ax: Axes, one: ReckonedPath) -> None:
    for order, (path, line) in enumerate(zip(one.paths, (REFERENCE, BEFORE, AFTER), strict=True), start=2):
        ax.plot(*path.T, **line, zorder=order)
    measured = one.paths[0]
    ax.plot(*measured[np.isfinite(measured).all(axis=1)][0], **START, zorder=5)
    ax.set_aspect("equal", adjustable="datalim")
    ax.margins(0.06)
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(MaxNLocator(nbins=5, steps=[1, 2, 5, 10]))


def _shape(one: ReckonedPath) -> float:
    # Height over width.
    every = np.concatenate(one.paths)
    width, height = np.maximum(np.nanmax(every, axis=0) - np.nanmin(every, axis=0), 1e-3)
    return float(height / width)
