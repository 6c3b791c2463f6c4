"""What a report is made of: sections, each the same in every output format."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from oed.report.tables import Table


@dataclass(frozen=True)
class Picture:
    """A figure of a section.

    Attributes:
        name: of the file, without suffix; unique in the report.
        alt: what the figure shows, for those who cannot see it.
        caption: how to read it.
        draw: makes the matplotlib Figure.
    """

    name: str
    alt: str
    caption: str
    draw: Callable[[], Any]


@dataclass(frozen=True)
class Section:
    """A titled part of a report.

    Attributes:
        title: heading.
        notices: sentences that must not be overlooked, shown first.
        paragraphs: plain text; `backticks` mark code.
        figures: drawn below the paragraphs.
        tables: below the figures.
        code: verbatim text, last.
    """

    title: str
    paragraphs: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()
    figures: tuple[Picture, ...] = ()
    notices: tuple[str, ...] = ()
    code: str = ""
