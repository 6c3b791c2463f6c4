"""What a report is made of: sections, each the same in every output format."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from oed.report.figures.spec import Plot
from oed.report.parts.tables import Table


@dataclass(frozen=True)
class Picture:
    """A figure of a section.

    Attributes:
        name: of the file, without suffix; unique in the report.
        alt: what the figure shows, for those who cannot see it.
        caption: how to read it.
        figure: what is drawn.
    """

    name: str
    alt: str
    caption: str
    figure: Plot


@dataclass(frozen=True)
class Animation:
    """Drives to be played in the HTML page; lengths in m.

    Attributes:
        drives: each a run with name, duration [s], and x, y, heading at even times, of a tractor the
            trailer's angle, too.
        view: x_min, x_max, y_min, y_max of what is shown.
        workspace: its outline, a circle (x, y, radius) or a polygon (points).
        obstacles: outlines alike.
        width: of the robot; 0 where it is not known.
        body_radius: of the circle around it, 0 for none.
        trailer: how far behind the robot's origin it is hitched, and from there to its axle.
    """

    drives: tuple[Mapping[str, Any], ...]
    view: tuple[float, float, float, float]
    workspace: Mapping[str, Any] | None
    width: float
    obstacles: tuple[Mapping[str, Any], ...] = ()
    body_radius: float = 0.0
    trailer: tuple[float, float] | None = None


@dataclass(frozen=True)
class Film:
    """A GIF that lies beside the report.

    Attributes:
        file: it.
        alt: what it shows, for those who cannot see it.
        caption: how to read it.
    """

    file: Path
    alt: str
    caption: str


@dataclass(frozen=True)
class Section:
    """A titled part of a report.

    Attributes:
        title: heading.
        notices: sentences that must not be overlooked, shown first.
        paragraphs: plain text; `backticks` mark code.
        figures: drawn below the paragraphs.
        tables: below the figures.
        animation: played in the HTML page, left out elsewhere.
        film: below the animation; part of the HTML page.
        links: text and address of pages beside the report.
        code: verbatim text, last.
    """

    title: str
    paragraphs: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()
    figures: tuple[Picture, ...] = ()
    notices: tuple[str, ...] = ()
    animation: Animation | None = None
    film: Film | None = None
    links: tuple[tuple[str, str], ...] = ()
    code: str = ""
