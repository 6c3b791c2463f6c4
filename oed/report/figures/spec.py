"""What a figure is, as plain data: panels with parts on axes, and a legend. `draw` makes pictures of it.

A look says how a part is drawn, by matplotlib's names. Its marker may be a `Glyph`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from oed.foundation.arrays import Array
from oed.foundation.text import unit_text
from oed.robots.limits.shapes import Outline

Look = Mapping[str, Any]
Values = npt.NDArray[Any] | Sequence[float]
Ends = tuple[float, float]

WIDTH = 11.0
"""Width of a report's column [inch]."""
INK, FAINT, FIRST = "#222222", "#767676", "#123f6d"
SECOND, THIRD = "#e07b00", "#5a9a3c"


def stroke(
    color: str, width: float, order: float | None = None, dashes: Sequence[float] = ()
) -> dict[str, Any]:
    """The look of a line of a width [points]; what is of a higher order covers it.

    Args:
        color: of the line.
        width: [points].
        order: what is of a higher one covers it.
        dashes: of the line.
    """
    drawn = {"color": color, "linewidth": width, "linestyle": (0, tuple(dashes)) if dashes else "-"}
    return drawn if order is None else {**drawn, "zorder": order}


def mark(
    shape: str | Glyph, size: float, face: str, edge: float, order: float = 2, rim: str = INK
) -> dict[str, Any]:
    """The look of a mark of a size with a rim of a width [points]; what is of a higher order covers it.

    Args:
        shape: of the mark.
        size: [points].
        face: its colour.
        edge: its rim's colour.
        order: what is of a higher one covers it.
        rim: width [points].
    """
    drawn = {"marker": shape, "markersize": size, "markerfacecolor": face, "linestyle": "none"}
    return {**drawn, "markeredgecolor": rim, "markeredgewidth": edge, "zorder": order}


LINES: tuple[Look, ...] = (
    stroke(FIRST, 1.7),
    stroke(SECOND, 1.7, dashes=(4, 1.6)),
    stroke(THIRD, 1.5, dashes=(6, 1.5, 1, 1.5)),
    stroke("#b0588f", 1.7, dashes=(1, 1.3)),
)
"""Of a panel's lines: told apart by dashes and by brightness, not by hue alone."""


def line_look(index: int) -> Look:
    """The look of a panel's line of that number, from 0."""
    return LINES[index % len(LINES)]


@dataclass(frozen=True)
class Glyph:
    """A marker of its own.

    Attributes:
        points: in a square from -1 to 1.
        moves: indices of points that a new stroke begins at.
        angle: by which it is turned [rad].
    """

    points: tuple[tuple[float, float], ...]
    moves: tuple[int, ...] = (0,)
    angle: float = 0.0


@dataclass(frozen=True)
class Line:
    """A line through points, or marks at them, as it looks."""

    x: Values
    y: Values
    look: Look

    @classmethod
    def through(cls, points: Array, look: Look) -> Line:
        """That of points (n, 2)."""
        return cls(points[:, 0], points[:, 1], look)


@dataclass(frozen=True)
class Dots:
    """Points by the hundred, far smaller than marks; their width is in points."""

    x: Array
    y: Array
    colour: str
    width: float = 1.6


@dataclass(frozen=True)
class Shades:
    """A path in classes of speed: darker and wider is faster.

    Attributes:
        x, y: of its points, (N + 1,).
        speeds: between them, (N,).
        scale: shrinks lines in small panels.
    """

    x: Array
    y: Array
    speeds: Array
    scale: float = 1.0


@dataclass(frozen=True)
class Call:
    """What matplotlib's axes draw by a method: bars, bands and lines across the panel.

    Attributes:
        method: its name.
        arguments: of the method.
        look: of what it draws.
    """

    method: Literal["axhline", "axhspan", "axvline", "bar", "fill_between", "hlines", "vlines"]
    arguments: tuple[Any, ...]
    look: Look


@dataclass(frozen=True)
class Cells:
    """A map of values (rows, columns), shaded and labelled, with a bar that says what they are."""

    values: Array
    label: str


@dataclass(frozen=True)
class Shape:
    """A polygon or a circle, on the scale of the axes."""

    outline: Outline
    look: Look


@dataclass(frozen=True)
class Note:
    """A word beside a point.

    Attributes:
        text: it.
        place: the point.
        offset: of the text from there, both ways [points].
        look: of the text.
    """

    text: str
    place: tuple[float, float]
    offset: float | tuple[float, float]
    look: Look


Part = Line | Dots | Shades | Call | Cells | Shape | Note


@dataclass(frozen=True)
class Axis:
    """A panel's axis.

    Attributes:
        title, unit: of what it shows.
        ends: where it begins and ends; None for what suits the parts.
        logarithmic: whether it is.
        ticks: places and their labels; matplotlib's choice if none are given.
        most: ticks at most; 0 for matplotlib's choice.
        whole: whether ticks are whole numbers.
        grid: whether lines are drawn at the ticks.
    """

    title: str = ""
    unit: str = ""
    ends: Ends | None = None
    logarithmic: bool = False
    ticks: Sequence[tuple[float, str]] = ()
    most: int = 0
    whole: bool = False
    grid: bool = True

    @property
    def label(self) -> str:
        """`title [unit]`; the unit on a line of its own where the title ends with a line."""
        gap = "" if self.title.endswith("\n") else " "
        return f"{self.title}{gap}[{unit_text(self.unit)}]" if self.unit else self.title


@dataclass(frozen=True)
class Panel:
    """Parts on a pair of axes.

    Attributes:
        parts: from the bottom up where their looks do not say otherwise.
        x, y: the axes.
        title: above it.
        equal: whether a length is as long on either axis: in a panel of the shape of its ends ("box"), or
            with ends that suit its shape ("ends").
        size: of its title's letters; 0 for the usual one.
        small: whether the numbers along its axes are small.
        margin: room around the parts where the ends are not given, as a share of their extent.
    """

    parts: Sequence[Part]
    x: Axis = field(default_factory=Axis)
    y: Axis = field(default_factory=Axis)
    title: str = ""
    equal: Literal["", "box", "ends"] = ""
    size: float = 0.0
    small: bool = False
    margin: float | None = None


@dataclass(frozen=True)
class Key:
    """An entry of a legend: a line or mark that looks so, or a patch."""

    label: str
    look: Look
    patch: bool = False


@dataclass(frozen=True)
class Legend:
    """Entries outside of the panels.

    Attributes:
        keys: its entries.
        most: entries side by side at most.
        place: above or below the panels.
        handle: room that each entry takes beside its text [inch].
        options: of matplotlib's legend.
    """

    keys: Sequence[Key] = ()
    most: int = 6
    place: Literal["upper", "lower"] = "upper"
    handle: float = 0.75
    options: Look = field(default_factory=dict)


@dataclass(frozen=True)
class Plot:
    """A figure.

    Attributes:
        panels: row by row.
        columns: of panels.
        width, height: of the figure [inch].
        labels: on outer panels only, beside all of them ("figure"), or on outer panels whose ticks are all
            labelled ("outer ticks"), or on each, whose ticks are labelled where its x axis has a title.
        share: axes that all panels have in common ("x", "y", "xy").
        legend: of all panels.
        fastest: largest speed [m/s], of a bar of the colours of speeds; None for no bar.
        wide: how many of the first panels have a row each.
        heights: of the rows, relative to each other; all alike if none are given.
    """

    panels: Sequence[Panel]
    columns: int = 1
    width: float = WIDTH
    height: float = 3.0
    labels: Literal["outer", "outer ticks", "figure", "each"] = "outer"
    share: Literal["", "x", "y", "xy"] = ""
    legend: Legend = field(default_factory=Legend)
    fastest: float | None = None
    wide: int = 0
    heights: Sequence[float] | None = None


LETTER = 0.072
"""Width of a letter of a legend [inch]."""


def legend_columns(labels: Sequence[str], width: float, handle: float) -> int:
    """How many entries of a legend fit side by side, at most 6.

    Args:
        labels: of the entries, which fill column by column.
        width: of the figure [inch].
        handle: room that each entry takes beside its text [inch].
    """
    for rows in range(-(-len(labels) // 6), len(labels)):
        columns = -(-len(labels) // rows)
        filled = np.array_split([len(label) for label in labels], columns)
        if LETTER * sum(int(letters.max()) for letters in filled) + handle * columns <= width:
            return columns
    return 1
