"""Draws what figures are described as, with matplotlib, which is loaded here."""

from __future__ import annotations

import io
import math
import re
import warnings
from collections.abc import Callable, Sequence
from functools import singledispatch
from typing import Any

import matplotlib
import numpy as np
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.axis import Axis as DrawnAxis
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.markers import MarkerStyle
from matplotlib.patches import Circle, Patch, PathPatch, Polygon
from matplotlib.path import Path
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter, NullLocator

from oed.foundation.shown import page_text, shown_lines
from oed.report.figures import spec
from oed.report.figures.spec import FAINT, INK, legend_columns

STYLE = {
    "font.size": 9.5,
    "axes.titlesize": 10,
    "axes.titleweight": "bold",
    "axes.edgecolor": FAINT,
    "axes.linewidth": 0.8,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "xtick.color": INK,
    "ytick.color": INK,
    "legend.frameon": False,
    "svg.hashsalt": "oed",
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans", "Verdana", "Arial"],
}
PIXELS = 110
"""An inch, in notebooks."""
PNG_DPI = 200
"""Of figures as PNG [dots/inch]."""
BAR, SHORTEST_BAR = 3.6, 0.02
"""Height of a bar of colours at most, and its distance from the panels [inch, share]."""


def svg_text(figure: spec.Plot) -> str:
    """The SVG of a figure: the same text for the same data."""
    with style.context(["default", STYLE]), warnings.catch_warnings():
        # Letters that the font here has not: those of the viewer are drawn.
        warnings.filterwarnings("ignore", message="Glyph ", category=UserWarning)
        buffer = io.StringIO()
        nothing = dict.fromkeys(("Date", "Creator", "Format", "Type"))
        laid_out(drawn(figure)).savefig(buffer, format="svg", metadata=nothing)
    return page_text(_compact(buffer.getvalue()))


def laid_out(figure: Figure) -> Figure:
    """The figure with its layout done, as for SVG: savefig would draw all once more only to lay it out."""
    FigureCanvasSVG(figure)
    figure.dpi = FigureCanvasSVG.fixed_dpi
    # Titles of several lines make their panels smaller, which the first pass has not seen.
    for _ in range(2 if any("\n" in ax.get_title() for ax in figure.axes) else 1):
        figure.get_layout_engine().execute(figure)
    # Of what "none" leaves in its place savefig would draw all once more as well.
    figure.set_layout_engine(None)
    return figure


class Shown(Figure):  # type: ignore[misc]
    """A figure that notebooks show by itself, whether or not they know of matplotlib's."""

    def _repr_png_(self) -> bytes:
        buffer = io.BytesIO()
        self.savefig(buffer, format="png", dpi=PIXELS)
        return buffer.getvalue()


def shown_figure(plot: spec.Plot) -> Any:
    """The picture of a figure in the style of the reports, for notebooks and `savefig`."""
    with style.context(["default", STYLE]):
        return drawn(plot, Shown)


def picture_bytes(figure: spec.Plot, form: str) -> bytes:
    """A figure as a file of another format: the same bytes for the same data.

    Args:
        figure: what is drawn.
        form: "pdf" or "png".
    """
    with style.context(["default", STYLE]), warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph ", category=UserWarning)
        buffer = io.BytesIO()
        nothing = {"CreationDate": None} if form == "pdf" else {}
        laid_out(drawn(figure)).savefig(buffer, format=form, metadata=nothing, dpi=PNG_DPI)
    return buffer.getvalue()


def _compact(svg: str) -> str:
    # Coordinates to a hundredth of a point, far below what can be seen; no indentation, no idle names.
    def shorten(match: re.Match[str]) -> str:
        return re.sub(r"-?\d+\.\d{3,}", lambda number: f"{float(number[0]):.2f}", match[0])

    shortened = re.sub(r' (?:d|x|y)="[^"]*"|translate\([^)]*\)', shorten, svg)
    anonymous = re.sub(r'<g id="[^"]*"', "<g", shortened)
    return "\n".join(line.strip() for line in anonymous.splitlines() if line.strip()) + "\n"


def as_drawn(text: str) -> str:
    """Text as figures are given it: a dollar sign begins no formula, and nothing steers."""
    return shown_lines(text).replace("$", r"\$")


def drawn(plot: spec.Plot, kind: type[Any] = Figure, **options: Any) -> Any:
    """The picture of a figure: matplotlib's Figure, or one of a `kind` of it; `options` are that class's."""
    figure = kind(figsize=(plot.width, plot.height), layout="constrained", **options)
    axes = _placed(figure, plot)
    shades = None if plot.fastest is None else Colours(plot.fastest)
    for ax, panel in zip(axes, plot.panels, strict=True):
        _fill(ax, panel, shades)
    _label(figure, axes, plot)
    if shades is not None:
        share = min(1.0, BAR / plot.height)
        bar = ScalarMappable(shades.norm, shades.colours)
        figure.colorbar(bar, ax=axes, label="speed [m/s]", shrink=share, aspect=22, pad=SHORTEST_BAR)
    if plot.legend.keys:
        _explain(figure, plot.legend, plot.width)
    return figure


def _placed(figure: Figure, plot: spec.Plot) -> list[Axes]:
    # One of each panel; places of the last row may stay empty (-1).
    count, columns = len(plot.panels), plot.columns
    rows = [[place] * columns for place in range(plot.wide)]
    for first in range(plot.wide, count, columns):
        rows.append([place if place < count else -1 for place in range(first, first + columns)])
    sharex, sharey = "x" in plot.share, "y" in plot.share
    found: dict[int, Axes] = figure.subplot_mosaic(
        rows, sharex=sharex, sharey=sharey, height_ratios=plot.heights, empty_sentinel=-1
    )
    return [found[place] for place in range(count)]


class Colours:
    """Classes of speed [m/s] up to the fastest, darker for faster."""

    def __init__(self, fastest: float) -> None:
        """At most 8 classes, of round numbers."""
        locator = MaxNLocator(nbins=8, steps=[1, 2, 2.5, 5, 10])
        levels = locator.tick_values(0.0, fastest if fastest > 0 else 1.0)
        self.count = len(levels) - 1
        self.colours = ListedColormap(matplotlib.colormaps["viridis"](np.linspace(0.80, 0.02, self.count)))
        self.norm = BoundaryNorm(levels, self.count)


def _fill(ax: Axes, panel: spec.Panel, shades: Colours | None) -> None:
    for part in panel.parts:
        if isinstance(part, spec.Shades):
            assert shades is not None
            _put_shades(part, ax, shades)
        else:
            put(part, ax)
    if panel.margin is not None:
        ax.margins(panel.margin)
    _set(ax.xaxis, panel.x, ax.set_xscale, ax.set_xlim)
    _set(ax.yaxis, panel.y, ax.set_yscale, ax.set_ylim)
    if panel.equal:
        ax.set_aspect("equal", adjustable="box" if panel.equal == "box" else "datalim")
    if panel.title:
        ax.set_title(as_drawn(panel.title), **({"fontsize": panel.size} if panel.size else {}))
    if panel.small:
        ax.tick_params(labelsize="x-small")


def _set(on: DrawnAxis, axis: spec.Axis, scale: Callable[..., Any], limit: Callable[..., Any]) -> None:
    if axis.logarithmic:
        scale("log")
        if axis.most:
            most = axis.most if axis.ends else None
            on.set_major_locator(LogLocator(subs=_parts_of_decade(axis), numticks=most))
        on.set_major_formatter(lambda value, _: f"{value:g}")
        on.set_minor_formatter(NullFormatter())
    elif axis.most:
        steps = None if axis.whole else [1, 2, 5, 10]
        on.set_major_locator(MaxNLocator(nbins=axis.most, integer=axis.whole, steps=steps))
    if axis.ticks:
        places, labels = zip(*axis.ticks, strict=True)
        on.set_ticks(places, [as_drawn(label) for label in labels])
        on.set_minor_locator(NullLocator())
    if axis.ends is not None:
        limit(*axis.ends)
    if not axis.grid:
        on.grid(visible=False)


def _parts_of_decade(axis: spec.Axis) -> tuple[float, ...]:
    # So many of each decade as leaves room for what is written at them.
    low, high = axis.ends or (1.0, 1.0)
    fine = ((1.0, 2.0, 5.0), (1.0, 3.0))
    return next((one for one in fine if len(one) * math.log10(high / low) <= axis.most), (1.0,))


def _label(figure: Figure, axes: Sequence[Axes], plot: spec.Plot) -> None:
    first = plot.panels[0]
    if plot.labels == "figure":
        figure.supxlabel(as_drawn(first.x.label), fontsize="medium")
        figure.supylabel(as_drawn(first.y.label), fontsize="medium")
        return
    ticks, each = plot.labels == "outer ticks", plot.labels == "each"
    for index, (ax, panel) in enumerate(zip(axes, plot.panels, strict=True)):
        below, beside = index + plot.columns >= len(axes), index % plot.columns == 0
        if each:
            below, beside = bool(panel.x.title), True
        ax.tick_params(labelbottom=below or ticks, labelleft=beside or ticks)
        ax.set_xlabel(as_drawn(panel.x.label) if below else "")
        ax.set_ylabel(as_drawn(panel.y.label) if beside else "")


def _explain(figure: Figure, legend: spec.Legend, width: float) -> None:
    handles = [
        Patch(**key.look, label=as_drawn(key.label))
        if key.patch
        else Line2D([], [], **_look(key.look), label=as_drawn(key.label))
        for key in legend.keys
    ]
    ncols = min(legend.most, legend_columns([key.label for key in legend.keys], width, legend.handle))
    figure.legend(handles=handles, loc=f"outside {legend.place} center", ncols=ncols, **legend.options)


def _look(look: spec.Look) -> dict[str, Any]:
    glyph = look.get("marker")
    if not isinstance(glyph, spec.Glyph):
        return dict(look)
    codes = [Path.MOVETO if index in glyph.moves else Path.LINETO for index in range(len(glyph.points))]
    if glyph.points[0] == glyph.points[-1]:
        codes[-1] = Path.CLOSEPOLY
    marker = MarkerStyle(Path(list(glyph.points), codes))
    return {**look, "marker": marker.rotated(rad=glyph.angle) if glyph.angle else marker}


@singledispatch
def put(part: object, ax: Axes) -> None:
    """Draw a part on axes."""
    raise TypeError(f"expected a part of a figure, got {part!r}")


@put.register
def _(part: spec.Line, ax: Axes) -> None:
    ax.plot(part.x, part.y, **_look(part.look))


@put.register
def _(part: spec.Dots, ax: Axes) -> None:
    # One path of lines without length and with round ends: far smaller than a marker each.
    points = np.repeat(np.column_stack([part.x, part.y]), 2, axis=0)
    path = Path(points, np.tile([Path.MOVETO, Path.LINETO], len(part.x)))
    path.should_simplify = False
    look = {"facecolor": "none", "edgecolor": part.colour, "linewidth": part.width, "zorder": 2}
    ax.add_patch(PathPatch(path, capstyle="round", **look))


def _put_shades(part: spec.Shades, ax: Axes, shades: Colours) -> None:
    # A stretch of one class after the other: few long lines instead of many short ones.
    classes = shades.norm(np.abs(part.speeds))
    changes = np.flatnonzero(np.diff(classes)) + 1
    for first, last in zip([0, *changes], [*changes, len(classes)], strict=True):
        level, piece = int(classes[first]), slice(first, last + 1)
        width = part.scale * (1.3 + 1.9 * level / max(1, shades.count - 1))
        ax.plot(part.x[piece], part.y[piece], color=shades.colours(level), linewidth=width, zorder=2)


@put.register
def _(part: spec.Call, ax: Axes) -> None:
    getattr(ax, part.method)(*part.arguments, **part.look)


@put.register
def _(part: spec.Cells, ax: Axes) -> None:
    image = ax.imshow(part.values, cmap="Greys", aspect="auto", origin="lower")
    low, high = np.nanmin(part.values), np.nanmax(part.values)
    for (row, column), value in np.ndenumerate(part.values):
        dark = np.isfinite(value) and value - low > 0.55 * (high - low)
        text = f"{value:.3g}" if np.isfinite(value) else "–"
        ax.text(column, row, text, ha="center", va="center", color="white" if dark else INK, fontsize=8)
    ax.figure.colorbar(image, ax=ax, label=as_drawn(part.label))


@put.register
def _(part: spec.Shape, ax: Axes) -> None:
    outline = part.outline
    if outline.radius:
        ax.add_patch(Circle(outline.points[0], outline.radius, **part.look))
    else:
        ax.add_patch(Polygon(outline.points, closed=True, **part.look))


@put.register
def _(part: spec.Note, ax: Axes) -> None:
    ax.annotate(
        as_drawn(part.text),
        part.place,
        xytext=part.offset if isinstance(part.offset, tuple) else (part.offset, part.offset),
        textcoords="offset points",
        **part.look,
    )
