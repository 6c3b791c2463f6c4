"""Plot functions: each draws plain data on the axes it is given and returns them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.markers import MarkerStyle
from matplotlib.patches import Circle, Patch, Polygon, Rectangle
from matplotlib.path import Path as Outline
from matplotlib.ticker import LogLocator, NullFormatter

from oed.report.reading import NOWHERE, Cloud, Path, Series
from oed.report.wording import unit_text

INK = "#222222"
FAINT = "#767676"
LINES = (
    {"color": "#123f6d", "linestyle": "-", "linewidth": 1.7},
    {"color": "#e07b00", "linestyle": (0, (4, 1.6)), "linewidth": 1.7},
    {"color": "#5a9a3c", "linestyle": (0, (6, 1.5, 1, 1.5)), "linewidth": 1.5},
    {"color": "#b0588f", "linestyle": (0, (1, 1.3)), "linewidth": 1.7},
)
"""Styles of a drive's inputs: told apart by dashes and by brightness, not by hue alone."""
ARROWS = 10
"""Direction arrows per path at most, at full size."""
APART = 0.11
"""Least distance between direction arrows, as a share of the panel's width."""
MOST_TICKS = 40
"""Segments beyond which their boundaries are not marked."""
ARROW = Outline([(-0.9, -0.75), (1.0, 0.0), (-0.9, 0.75), (-0.9, -0.75)], closed=True)

OUTLINES: dict[str, Callable[[Mapping[str, Any]], Patch]] = {
    "rectangle": lambda area: Rectangle(
        (area["x"][0], area["y"][0]), area["x"][1] - area["x"][0], area["y"][1] - area["y"][0]
    ),
    "circle": lambda area: Circle(area["center"], area["radius"]),
    "polygon": lambda area: Polygon(area["vertices"], closed=True),
}
"""Workspace kind -> its outline, from the study's echo of the workspace."""


def speed_colours(boundaries: Sequence[float]) -> tuple[ListedColormap, BoundaryNorm]:
    """Colours of speed classes, darker for faster, and the norm that picks them."""
    count = len(boundaries) - 1
    shades = matplotlib.colormaps["viridis"](np.linspace(0.80, 0.02, count))
    return ListedColormap(shades), BoundaryNorm(boundaries, count)


def plot_workspace(ax: Axes, workspace: Mapping[str, Any] | None) -> Axes:
    """The workspace as a shaded outline; nothing for none or for a kind without an outline."""
    make = OUTLINES.get(workspace["kind"]) if workspace else None
    if make and workspace:
        patch = make(workspace)
        patch.set(facecolor="#f4f4f1", edgecolor=FAINT, linewidth=1.0, zorder=0)
        ax.add_patch(patch)
    return ax


def plot_beacons(ax: Axes, beacons: Any) -> Axes:
    """Beacons (n, 2) [m] that distances are measured to."""
    for x, y in beacons:
        ax.plot(x, y, **BEACON)
    return ax


BEACON: dict[str, Any] = {
    "marker": "^",
    "markersize": 7,
    "markerfacecolor": "#e6c229",
    "markeredgecolor": INK,
    "markeredgewidth": 0.9,
    "linestyle": "none",
    "zorder": 4,
}


def plot_path(ax: Axes, path: Path, boundaries: Sequence[float], scale: float = 1.0) -> Axes:
    """A path [m], coloured and widened by speed class, with start, end, direction and segments.

    `scale` shrinks lines and marks, for small panels.
    """
    colours, norm = speed_colours(boundaries)
    classes = norm(np.abs(path.speed))
    for first, last in _runs(classes):
        level = int(classes[first])
        width = scale * (1.3 + 1.9 * level / max(1, colours.N - 1))
        piece = slice(first, last + 1)
        ax.plot(path.x[piece], path.y[piece], color=colours(level), linewidth=width, zorder=2)
    _mark_segments(ax, path, scale)
    _mark_directions(ax, path, scale)
    for mark, end in ((START, 0), (END, -1)):
        ax.plot(path.x[end], path.y[end], **{**mark, "markersize": scale * mark["markersize"]})
    return ax


START: dict[str, Any] = {
    "marker": "o",
    "markersize": 9,
    "markerfacecolor": "white",
    "markeredgecolor": INK,
    "markeredgewidth": 1.6,
    "linestyle": "none",
    "zorder": 5,
}
END: dict[str, Any] = {
    **START,
    "marker": "s",
    "markersize": 5.5,
    "markerfacecolor": INK,
    "markeredgewidth": 0.8,
    "zorder": 6,
}


def _runs(classes: Any) -> list[tuple[int, int]]:
    # First and last vertex of every stretch of one class: few long lines instead of many short ones.
    changes = np.flatnonzero(np.diff(classes)) + 1
    return list(zip([0, *changes], [*changes, len(classes)], strict=True))


def _mark_segments(ax: Axes, path: Path, scale: float) -> None:
    if len(path.edges) >= MOST_TICKS:
        return
    x, y, across = path.x[path.edges], path.y[path.edges], path.heading[path.edges] + np.pi / 2
    for tick_x, tick_y, angle in zip(x, y, across, strict=True):
        marker = MarkerStyle(Outline([(-1, 0), (1, 0)])).rotated(rad=angle)
        ax.plot(
            tick_x,
            tick_y,
            marker=marker,
            markersize=9 * scale,
            color=INK,
            markeredgewidth=1.2 * scale,
            zorder=3,
        )


def _mark_directions(ax: Axes, path: Path, scale: float) -> None:
    steps = np.hypot(np.diff(path.x), np.diff(path.y))
    travelled = np.cumsum(steps)
    if travelled[-1] < NOWHERE:
        return
    low, high = ax.get_xlim()
    count = int(np.clip(travelled[-1] / (APART * (high - low)), 2, scale * ARROWS))
    wanted = (np.arange(count) + 0.5) / count * travelled[-1]
    for index in np.unique(np.searchsorted(travelled, wanted)):
        along = np.array([path.x[index + 1] - path.x[index], path.y[index + 1] - path.y[index]])
        marker = MarkerStyle(ARROW).rotated(rad=float(np.arctan2(along[1], along[0])))
        ax.plot(
            path.x[index] + along[0] / 2,
            path.y[index] + along[1] / 2,
            **arrow_style(bool(path.speed[index] >= 0), scale),
            marker=marker,
            zorder=4,
        )


def arrow_style(forward: bool, scale: float = 1.0) -> dict[str, Any]:
    """A direction arrow: filled where the robot drives forwards, hollow where backwards."""
    face = INK if forward else "white"
    return {
        "markersize": 7 * scale,
        "markerfacecolor": face,
        "markeredgecolor": INK,
        "markeredgewidth": 0.9,
        "linestyle": "none",
    }


def plot_series(ax: Axes, series: Series, bounds: tuple[float, float] | None, unit: str) -> Axes:
    """Inputs or their rates over time [s], one line each, and their bounds in `unit`, labelled."""
    style = {"drawstyle": "steps-post"} if series.steps else {}
    for column, line in zip(series.values.T, LINES, strict=False):
        ax.plot(series.times, column, **line, **style, zorder=3)
    for bound in bounds or ():
        ax.axhline(bound, color=INK, linewidth=0.9, zorder=2)
    if bounds is not None:
        _label_bounds(ax, bounds, unit)
    ax.set_xlim(0.0, float(series.times[-1]))
    return ax


def _label_bounds(ax: Axes, bounds: tuple[float, float], unit: str) -> None:
    for bound, offset, alignment in ((bounds[1], 3, "bottom"), (bounds[0], -3, "top")):
        ax.annotate(
            f"limit {bound:g} {unit_text(unit)}",
            (0.99, bound),
            xycoords=("axes fraction", "data"),
            xytext=(0, offset),
            textcoords="offset points",
            horizontalalignment="right",
            verticalalignment=alignment,
            fontsize="small",
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.6},
            zorder=4,
        )


def plot_convergence(ax: Axes, points: Sequence[tuple[float, float]], line: Mapping[str, Any]) -> Axes:
    """A search's shortfall [%] over its seconds, as steps between dots; both axes logarithmic."""
    seconds, shortfall = zip(*points, strict=True)
    ax.plot(seconds, shortfall, **line, drawstyle="steps-post", zorder=3)
    for point in (0, -1):
        ax.plot(seconds[point], shortfall[point], marker="o", markersize=5, color=line["color"], zorder=4)
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_formatter(lambda value, _: f"{value:g}")
        axis.set_minor_formatter(NullFormatter())
    return ax


def plot_cloud(ax: Axes, cloud: Cloud) -> Axes:
    """Simulated estimates of two parameters, the truth, and the promised and sampled 95 % ellipses."""
    ax.plot(*cloud.points.T, marker=".", markersize=3, color="#7a95ad", linestyle="none", zorder=2)
    for covariance, line in ((cloud.promised, ELLIPSES[0]), (cloud.sampled, ELLIPSES[1])):
        ax.plot(*ellipse(cloud.true, covariance), **line, zorder=3)
    ax.plot(*cloud.true, **TRUTH)
    ax.set_xlabel(cloud.labels[0])
    ax.set_ylabel(cloud.labels[1])
    return ax


ELLIPSES = (
    {"color": "#123f6d", "linestyle": "-", "linewidth": 1.6},
    {"color": "#e07b00", "linestyle": (0, (4, 1.6)), "linewidth": 1.6},
)
TRUTH: dict[str, Any] = {
    "marker": "+",
    "markersize": 11,
    "markeredgewidth": 1.8,
    "color": INK,
    "linestyle": "none",
    "zorder": 5,
}
RADIUS_95 = 2.447747
"""Mahalanobis radius that holds 95 % of a normal distribution in the plane: sqrt(-2 ln 0.05)."""


def ellipse(centre: Any, covariance: Any) -> Any:
    """Outline (2, 121) of the ellipse that holds 95 % of a normal distribution."""
    angle = np.linspace(0.0, 2 * np.pi, 121)
    circle = RADIUS_95 * np.array([np.cos(angle), np.sin(angle)])
    return np.asarray(centre)[:, None] + np.linalg.cholesky(covariance) @ circle


def plot_starts(ax: Axes, shortfalls: Sequence[float], failed: int) -> Axes:
    """Objectives of the starts below the best one [%], best first; crosses for starts without a design."""
    ranks = np.arange(1, len(shortfalls) + 1)
    lowest = min([*shortfalls, -1.0])
    ax.axhspan(-1.0, 0.0, color="#e6eef5", zorder=0)
    ax.plot(ranks, shortfalls, marker="o", markersize=6, color="#123f6d", linestyle="none", zorder=3)
    if failed:
        crosses = len(shortfalls) + 1 + np.arange(failed)
        ax.plot(crosses, np.full(failed, lowest), marker="x", color=INK, linestyle="none", zorder=3)
    ax.set_xlim(0.3, len(shortfalls) + failed + 0.7)
    ax.set_ylim(1.12 * lowest, -0.08 * lowest)
    return ax
