"""Plot functions of paths and the rooms around them; each draws on the axes it is given and returns them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.markers import MarkerStyle
from matplotlib.patches import Circle, Patch, Polygon
from matplotlib.path import Path as Shape

from oed.report.figures.driven import Array, Path, Run
from oed.report.figures.plots import FAINT, INK
from oed.report.parts.reading import NOWHERE
from oed.report.parts.rooms import Room
from oed.robots.limits.outline import Outline

ARROWS = 10
"""Direction arrows per path at most, at full size."""
APART = 0.11
"""Least distance between direction arrows, as a share of the panel's width."""
NUMBERS_APART = 0.08
"""Least distance between the numbers of two runs, as a share of the panel's width."""
MOST_TICKS = 40
"""Segments beyond which their boundaries are not marked."""
ARROW = Shape([(-0.9, -0.75), (1.0, 0.0), (-0.9, 0.75), (-0.9, -0.75)], closed=True)
POINTER = Shape(
    [(0, 0), (1.0, 0), (0.72, 0.17), (1.0, 0), (0.72, -0.17)],
    [Shape.MOVETO, Shape.LINETO, Shape.MOVETO, Shape.LINETO, Shape.LINETO],
)
"""A thin open arrow from the path to where the robot faces."""


def speed_colours(boundaries: Sequence[float]) -> tuple[ListedColormap, BoundaryNorm]:
    """Colours of speed classes, darker for faster, and the norm that picks them."""
    count = len(boundaries) - 1
    shades = matplotlib.colormaps["viridis"](np.linspace(0.80, 0.02, count))
    return ListedColormap(shades), BoundaryNorm(boundaries, count)


def plot_room(ax: Axes, room: Room) -> Axes:
    """Workspace, obstacles and beacons [m]; nothing of what has no outline."""
    if room.floor is not None:
        ax.add_patch(_patch(room.floor, FLOOR))
    for obstacle in room.hatched:
        ax.add_patch(_patch(obstacle, OBSTACLE))
    for x, y in room.beacons:
        ax.plot(x, y, **BEACON)
    return ax


def _patch(outline: Outline, look: Mapping[str, Any]) -> Patch:
    if outline.radius:
        return Circle(outline.points[0], outline.radius, **look)
    return Polygon(outline.points, closed=True, **look)


FLOOR: dict[str, Any] = {"facecolor": "#f4f4f1", "edgecolor": FAINT, "linewidth": 1.0, "zorder": 0}
OBSTACLE: dict[str, Any] = {
    "facecolor": "#c4c1ba",
    "edgecolor": "#4a4a4a",
    "hatch": "////",
    "linewidth": 1.1,
    "zorder": 1.4,
}
BEACON: dict[str, Any] = {
    "marker": "^",
    "markersize": 7,
    "markerfacecolor": "#e6c229",
    "markeredgecolor": INK,
    "markeredgewidth": 0.9,
    "linestyle": "none",
    "zorder": 4,
}


def plot_path(
    ax: Axes, path: Path, boundaries: Sequence[float], scale: float = 1.0, body_radius: float = 0.0
) -> Axes:
    """A path [m], coloured and widened by speed class, with start, end, direction and segments of each run.

    Args:
        ax: their limits are set already.
        path: of a drive.
        boundaries: of the speed classes [m/s].
        scale: shrinks lines and marks, for small panels.
        body_radius: of the circles around start and end [m]; 0 for none.
    """
    for run in path.runs:
        _plot_run(ax, run, boundaries, scale)
        _mark_segments(ax, run, scale, path.sideways)
        _mark_directions(ax, run, scale, path.sideways)
        for mark, end in ((START, 0), (END, -1)):
            ax.plot(run.x[end], run.y[end], **{**mark, "markersize": scale * mark["markersize"]})
            if body_radius:
                ax.add_patch(Circle((run.x[end], run.y[end]), body_radius, **BODY))
    if len(path.runs) > 1:
        _number(ax, path.runs, scale)
    return ax


def plot_bundle(
    ax: Axes, inside: Sequence[Array], outside: Sequence[Array], nominal: Sequence[Array]
) -> Axes:
    """Paths (n, 2) [m] that may happen: that keep the limits, that leave them, and the nominal one."""
    for lines, look in ((inside, INSIDE), (outside, OUTSIDE), (nominal, NOMINAL)):
        for line in lines:
            ax.plot(*np.asarray(line).T, **look)
    for line in nominal:
        for mark, end in ((START, 0), (END, -1)):
            ax.plot(*np.asarray(line)[end], **{**mark, "markersize": 0.8 * mark["markersize"]})
    return ax


INSIDE: dict[str, Any] = {"color": "#8fb4d9", "linewidth": 0.7, "zorder": 1.6}
OUTSIDE: dict[str, Any] = {"color": "#c2410c", "linewidth": 0.8, "linestyle": (0, (4, 1.6)), "zorder": 1.7}
NOMINAL: dict[str, Any] = {"color": INK, "linewidth": 1.6, "zorder": 3}


def _plot_run(ax: Axes, run: Run, boundaries: Sequence[float], scale: float) -> None:
    if run.trailer is not None:
        ax.plot(*run.trailer.T, **{**TRAILER, "linewidth": scale * TRAILER["linewidth"]})
    colours, norm = speed_colours(boundaries)
    classes = norm(np.abs(run.speed))
    for first, last in _stretches(classes):
        level = int(classes[first])
        width = scale * (1.3 + 1.9 * level / max(1, colours.N - 1))
        piece = slice(first, last + 1)
        ax.plot(run.x[piece], run.y[piece], color=colours(level), linewidth=width, zorder=2)


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
BODY: dict[str, Any] = {"fill": False, "edgecolor": INK, "linewidth": 0.7, "zorder": 1.6}
TRAILER: dict[str, Any] = {"color": "#4a4a4a", "linestyle": (0, (1, 1.5)), "linewidth": 1.5, "zorder": 1.8}


def _stretches(classes: Any) -> list[tuple[int, int]]:
    # First and last vertex of every stretch of one class: few long lines instead of many short ones.
    changes = np.flatnonzero(np.diff(classes)) + 1
    return list(zip([0, *changes], [*changes, len(classes)], strict=True))


def _mark_segments(ax: Axes, run: Run, scale: float, sideways: bool) -> None:
    if len(run.edges) >= MOST_TICKS:
        return
    along = _motion(run)[run.edges] if sideways else run.heading[run.edges]
    x, y, across = run.x[run.edges], run.y[run.edges], along + np.pi / 2
    for tick_x, tick_y, angle in zip(x, y, across, strict=True):
        marker = MarkerStyle(Shape([(-1, 0), (1, 0)])).rotated(rad=angle)
        ax.plot(
            tick_x,
            tick_y,
            marker=marker,
            markersize=9 * scale,
            color=INK,
            markeredgewidth=1.2 * scale,
            zorder=3,
        )


def _motion(run: Run) -> Array:
    # Direction in which the robot moves after each sample but the last, (N,) [rad].
    return np.asarray(np.arctan2(np.diff(run.y), np.diff(run.x)))


def _mark_directions(ax: Axes, run: Run, scale: float, sideways: bool) -> None:
    travelled = np.cumsum(run.steps)
    if travelled[-1] < NOWHERE:
        return
    low, high = ax.get_xlim()
    count = int(np.clip(travelled[-1] / (APART * (high - low)), 2, scale * ARROWS))
    places = np.arange(count) + 0.5
    for index in np.unique(np.searchsorted(travelled, places / count * travelled[-1])):
        along = np.array([run.x[index + 1] - run.x[index], run.y[index + 1] - run.y[index]])
        marker = MarkerStyle(ARROW).rotated(rad=float(np.arctan2(along[1], along[0])))
        ax.plot(
            run.x[index] + along[0] / 2,
            run.y[index] + along[1] / 2,
            **arrow_style(bool(run.speed[index] >= 0), scale),
            marker=marker,
            zorder=4,
        )
    if sideways:
        # Between the arrows, from the start on.
        _mark_headings(ax, run, np.searchsorted(travelled, np.arange(count) / count * travelled[-1]), scale)


def _mark_headings(ax: Axes, run: Run, indices: Any, scale: float) -> None:
    for index in np.unique(indices):
        marker = MarkerStyle(POINTER).rotated(rad=float(run.heading[index]))
        ax.plot(run.x[index], run.y[index], marker=marker, **pointer_style(scale))


def pointer_style(scale: float = 1.0) -> dict[str, Any]:
    """A thin open arrow towards the robot's heading."""
    return {
        "markersize": 32 * scale,
        "markerfacecolor": "none",
        "markeredgecolor": "#8a2d10",
        "markeredgewidth": 1.1 * scale,
        "linestyle": "none",
        "zorder": 4.5,
    }


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


def _number(ax: Axes, runs: Sequence[Run], scale: float) -> None:
    low, high = ax.get_xlim()
    for number, place in enumerate(number_places(runs, NUMBERS_APART * (high - low)), 1):
        ax.annotate(
            str(number),
            place,
            xytext=(6 * scale, 6 * scale),
            textcoords="offset points",
            fontsize=10.5 * scale,
            fontweight="bold",
            color=INK,
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.6, "pad": 0.4},
            zorder=7,
        )


def number_places(runs: Sequence[Run], apart: float) -> list[tuple[float, float]]:
    """Where the number of each run is set [m]: at its start, or as far along it as keeps numbers apart."""
    places: list[tuple[float, float]] = []
    for run in runs:
        points = np.column_stack([run.x, run.y])
        gaps = [np.hypot(*(points - np.array(place)).T) for place in places]
        nearest = np.min(gaps, axis=0) if gaps else np.full(len(points), np.inf)
        free = np.flatnonzero(nearest >= apart)
        x, y = points[free[0] if len(free) else int(np.argmax(nearest))]
        places.append((float(x), float(y)))
    return places
