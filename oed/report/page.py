"""The pages: sections rendered as Markdown with figures beside it, and as one self-contained HTML file."""

from __future__ import annotations

import base64
import json
import os
import re
from collections.abc import Iterable, Iterator, Sequence
from functools import cache
from html import escape
from pathlib import Path
from urllib.parse import quote

import jinja2
from markupsafe import Markup

from oed.foundation.arguments import typed
from oed.foundation.errors import UserMistake
from oed.foundation.shown import page_text, shown
from oed.foundation.vocabulary import speaking
from oed.foundation.work.folders import updated
from oed.foundation.work.parallel import run_tasks, waiting
from oed.records.record import FIGURE_FORMATS, REPORT, Record, pages
from oed.report.figures.spec import WIDTH, Plot
from oed.report.film.animation import with_film
from oed.report.parts.prose import environment
from oed.report.parts.section import Animation, Section
from oed.report.parts.spoken import in_words
from oed.report.sections import SECTIONS

NAME = REPORT
"""Of a report's files, without suffix."""
HTML, MARKDOWN = "report.html.jinja", "report.md.jinja"
FIGURES = "figures"
UNITS = "%|m|cm|mm|µm|s|ms|min|h|rad|deg|rad/s²?|rad²|deg/s"
"""Units that follow a number in a text."""
WIDE = 9
"""Columns beyond which a table is set smaller."""
POINTS = 72.0
"""In an inch."""
MOST_ROWS = 7
"""Rows of a table in sight; further ones are folded away."""


@typed
def write_report(record: Record, folder: str | Path, figures: Sequence[str] = ()) -> Path:
    """Write report.html, report.md and figures/*.svg into `folder`; returns report.html.

    A film of the drives that lies there, `drive.gif`, becomes part of it.

    Args:
        record: what is reported.
        folder: where to write.
        figures: formats in which figures are written beside the SVG of each: "pdf", "png".

    Raises:
        UserMistake: the folder cannot be written to.
    """
    target = Path(folder)
    sections = (with_film(section, record, target) for section in sections_of(record))
    return render(record.study.name, sections, target, figures=figures)


def render(
    title: str,
    parts: Iterable[Section | None],
    target: Path,
    name: str = NAME,
    figures: Sequence[str] = (),
) -> Path:
    """Write sections as an HTML page, as Markdown and as figures/*.svg into `target`; returns the page.

    Args:
        title: of the page.
        parts: its sections, in order; None is left out.
        target: folder.
        name: of the page's files, without suffix.
        figures: formats of figures beside the SVG of each.

    Raises:
        UserMistake: the folder cannot be written to, or there is no such format.
    """
    require_formats(figures)
    sections = [one for one in parts if one is not None]
    drawings = _drawings(sections)
    content = {"title": title, "sections": sections, "svg": drawings, "wide": WIDE, "most": MOST_ROWS}
    # Whatever a text comes from: pages steer neither a terminal that shows them nor the direction of writing.
    html, markdown = (
        page_text(templates().get_template(template).render(content)) for template in (HTML, MARKDOWN)
    )
    files: dict[str, str | bytes] = {f"{FIGURES}/{one}.svg": text for one, text in drawings.items()}
    files |= dict(_printed(sections, figures))
    with updated(target) as draft:
        draft.write({**files, f"{name}.md": markdown, f"{name}.html": html})
        draft.publish(pages(target, name))
    return target / f"{name}.html"


def address_of(page: str | Path, target: str | Path) -> str:
    """The address of a page as pages in the folder `target` link to it; "" where there is none."""
    return quote(Path(os.path.relpath(page, target)).as_posix()) if Path(page).is_file() else ""


def sections_of(record: Record) -> list[Section]:
    """The sections that the record has something for, in order, in its domain's words."""
    vocabulary = record.study.vocabulary
    with speaking(vocabulary):
        made = [section for make in SECTIONS[record.study.domain] if (section := make(record)) is not None]
    return [in_words(section, vocabulary) for section in made]


def _drawings(sections: list[Section]) -> dict[str, str]:
    # The drawing library is loaded here and in the pictures' own functions, only when there is one to draw.
    pictures = [picture for section in sections for picture in section.pictures]
    if not pictures:
        return {}
    drawn: dict[int, str] = {}
    # Processes that wait already share the drawing; for it alone none are started.
    run_tasks(_svg, [one.figure for one in pictures], waiting(), drawn.__setitem__)
    return {picture.name: drawn[index] for index, picture in enumerate(pictures)}


def _svg(figure: Plot) -> str:
    from oed.report.figures.draw import svg_text

    return svg_text(figure)


def require_formats(figures: Sequence[str]) -> None:
    """Make sure that figures can be had in these formats.

    Raises:
        UserMistake: in one of them they cannot.
    """
    unknown = [one for one in figures if one not in FIGURE_FORMATS]
    if unknown or isinstance(figures, str):
        expected = " or ".join(FIGURE_FORMATS)
        raise UserMistake(f"figures: expected a list of {expected}, got {shown(', '.join(figures))}")


def _printed(sections: list[Section], figures: Sequence[str]) -> Iterator[tuple[str, bytes]]:
    # The figures once more, in the formats asked for.
    if not figures:
        return
    from oed.report.figures.draw import picture_bytes

    for picture in (one for section in sections for one in section.pictures):
        for form in figures:
            yield f"{FIGURES}/{picture.name}.{form}", picture_bytes(picture.figure, form)


def html_text(text: str) -> Markup:
    """Plain text with `backticks`, as HTML; numbers and units stay on one line, as do `2 m x 3 m`, `± 3`."""
    together = re.sub(rf"(?<=\d) (?=(?:{UNITS})(?!\w))", "\u00a0", escape(text))
    together = re.sub(r"(?<=[a-zµ]) x (?=\d)", "\u00a0x\u00a0", together)
    together = re.sub(r"± (?=\d)", "±\u00a0", together)
    return Markup(re.sub(r"`([^`]+)`", r"<code>\1</code>", together))  # noqa: S704 - escaped above


def markdown_text(text: str) -> str:
    """Plain text with `backticks`, as Markdown: everything outside of the backticks means itself."""
    parts = re.split(r"(`[^`]+`)", " ".join(text.split()))
    return "".join(part if part.startswith("`") else _escaped(part) for part in parts)


def _escaped(text: str) -> str:
    return re.sub(r"([\\`*_\[\]<>#~|$])", r"\\\1", text)


def fence(code: str) -> str:
    """The fence that encloses a code block: longer than any run of backticks in it."""
    longest = max((len(run) for run in re.findall(r"`+", code)), default=0)
    return "`" * max(3, longest + 1)


def code_span(text: str) -> str:
    """A text as a code span in Markdown, which no backtick in it ends."""
    text = " ".join(text.splitlines())
    longest = max((len(run) for run in re.findall(r"`+", text)), default=0)
    mark, gap = "`" * (longest + 1), " " if longest else ""
    return f"{mark}{gap}{text}{gap}{mark}"


def script_data(animation: Animation) -> Markup:
    """An animation as JSON that may stand inside a script element."""
    text = json.dumps(vars(animation), separators=(",", ":"), allow_nan=False)
    return Markup(text.replace("<", "\\u003c"))  # noqa: S704 - no element can begin or end in it


def data_address(text: str) -> str:
    """A text as an address that holds it."""
    return f"data:text/plain;charset=utf-8;base64,{base64.b64encode(text.encode()).decode('ascii')}"


def embedded(gif: Path) -> str:
    """A GIF as an address that holds it."""
    return f"data:image/gif;base64,{base64.b64encode(gif.read_bytes()).decode('ascii')}"


def _inline_svg(svg: str, name: str, alt: str) -> Markup:
    # An SVG file's text as an element of a page, its ids made unique to the figure; narrow ones stay narrow.
    element = svg[svg.index("<svg") :]
    element = re.sub(r'(\bid="|href="#|url\(#)', rf"\g<1>{name}-", element)
    width = re.match(r'<svg [^>]*?\bwidth="([\d.]+)pt"', element)
    share = float(width[1]) / (POINTS * WIDTH) if width else 1.0
    label = f'<svg role="img" style="--share: {min(share, 1.0):.3g}" aria-label="{escape(alt)}"'
    return Markup(element.replace("<svg", label, 1))  # noqa: S704 - the package's own drawing


FILTERS = {
    "html": html_text,
    "markdown": markdown_text,
    "cell": lambda text: _escaped(" ".join(text.split())),
    "code_span": code_span,
    "data": script_data,
    "data_address": data_address,
    "embedded": embedded,
    "fence": fence,
    "inline": _inline_svg,
}
"""Of the templates of pages."""


@cache
def templates() -> jinja2.Environment:
    """The templates of pages, each compiled once."""
    made = environment().overlay()
    made.filters = {**made.filters, **FILTERS}
    return made
