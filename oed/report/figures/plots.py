"""Plot functions: each draws plain data on the axes it is given and returns them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter

from oed.foundation.shown import shown_lines
from oed.foundation.text import unit_text
from oed.report.parts.inputs import Series
from oed.report.parts.reading import Cloud

INK = "#222222"
FAINT = "#767676"
LINES = (
    {"color": "#123f6d", "linestyle": "-", "linewidth": 1.7},
    {"color": "#e07b00", "linestyle": (0, (4, 1.6)), "linewidth": 1.7},
    {"color": "#5a9a3c", "linestyle": (0, (6, 1.5, 1, 1.5)), "linewidth": 1.5},
    {"color": "#b0588f", "linestyle": (0, (1, 1.3)), "linewidth": 1.7},
)
"""Styles of a drive's inputs: told apart by dashes and by brightness, not by hue alone."""


def as_drawn(text: str) -> str:
    """Text as figures are given it: a dollar sign begins no formula, and nothing steers."""
    return shown_lines(text).replace("$", r"\$")


def line_style(index: int) -> Mapping[str, Any]:
    """The style of a panel's line of that number, from 0."""
    return LINES[index % len(LINES)]


def plot_series(ax: Axes, series: Series, bounds: tuple[float, float] | None, unit: str) -> Axes:
    """Inputs or their rates over time [s], one line each, and their bounds in `unit`, labelled."""
    style = {"drawstyle": "steps-post"} if series.steps else {}
    for index, column in enumerate(series.values.T):
        ax.plot(series.times, column, **line_style(index), **style, zorder=3)
    for end in series.breaks:
        ax.axvline(end, color=FAINT, linewidth=0.8, zorder=1.5)
    for bound in bounds or ():
        ax.axhline(bound, color=INK, linewidth=0.9, zorder=2)
    if bounds is not None:
        _label_bounds(ax, bounds, unit)
    ax.set_xlim(0.0, float(series.times[-1]))
    return ax


def _label_bounds(ax: Axes, bounds: tuple[float, float], unit: str) -> None:
    for bound, offset, alignment in ((bounds[1], 3, "bottom"), (bounds[0], -3, "top")):
        ax.annotate(
            as_drawn(f"limit {bound:g} {unit_text(unit)}"),
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
    ax.set_xlabel(as_drawn(cloud.labels[0]))
    ax.set_ylabel(as_drawn(cloud.labels[1]))
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
