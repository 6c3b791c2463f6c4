"""The page of a loop: whether it is enough, and the precision after every drive."""

from __future__ import annotations

from collections.abc import Sequence
from operator import attrgetter
from pathlib import Path

from oed.foundation.text import deviation_text, error_text, fixed, own_unit, shown_unit, to_error, words
from oed.records.stored.loop import KnownParameter, LoopRound, StoredLoop
from oed.report.figures import chart as charts
from oed.report.figures.chart import Chart
from oed.report.page import render
from oed.report.parts.prose import Prose
from oed.report.parts.section import Column, Link, Picture, Section, Table

SAY = Prose("loop")
REPORT, ESTIMATE = "report.html", "estimate.html"


def write_loop(found: StoredLoop, folder: str | Path, figures: Sequence[str] = ()) -> Path:
    """Write report.html, report.md and figures/*.svg of a loop into `folder`; returns report.html.

    Args:
        found: the loop.
        folder: where to write.
        figures: formats in which figures are written beside the SVG of each: "pdf", "png".

    Raises:
        UserMistake: the folder cannot be written to.
    """
    target = Path(folder)
    sections = (_summary(found), _parameters(found, target), _rounds(found, target))
    return render(f"{found.name}: drive until it is known", sections, target, figures=figures)


def _summary(found: StoredLoop) -> Section:
    last = found.driven[-1].known if found.driven else []
    wanted = [(words(one.name), deviation_text(one.wanted, one.unit or "")) for one in last if one.wanted]
    title = SAY("title", len(found.driven), found.reached, found.finished, bool(wanted))
    paragraphs = [SAY("reason", found.reason), SAY("wanted", wanted) if wanted else ""]
    drawn = _chart(found)
    figure = None
    if drawn is not None:
        caption = SAY("caption", bool(wanted))
        figure = Picture("precision", SAY("alt"), caption, charts.panels([drawn]))
    return Section.of(title, *filter(None, paragraphs), figure)


def _chart(found: StoredLoop) -> Chart | None:
    rounds = found.driven
    if len(rounds) < 2:
        return None
    known = rounds[-1].known
    # What is wanted; of all where nothing is.
    aimed = [one for one in known if one.wanted is not None] or known
    first, single = aimed[0], len(aimed) == 1
    factor, wanted = own_unit(first.unit)[1], first.wanted is not None
    series = []
    for one in aimed:
        errors = [_error(each, one.name) for each in rounds]
        size = 1 / factor if single else one.wanted if wanted else errors[0]
        series.append(
            (words(one.name), tuple(error / size if error is not None and size else None for error in errors))
        )
    level = None if first.wanted is None else first.wanted * factor if single else 1.0
    places = tuple(float(number) for number in range(1, len(rounds) + 1))
    quantity = SAY("quantity", single, wanted, shown_unit(first.unit))
    return Chart(SAY("across"), places, tuple(series), quantity, level=level)


def _error(one: LoopRound, name: str) -> float | None:
    return next((each.now for each in one.known if each.name == name), None)


def _parameters(found: StoredLoop, target: Path) -> Section | None:
    if not found.driven:
        return None
    page = (target / ESTIMATE).is_file()
    known = found.driven[-1].known

    def error(name: str) -> Column | None:
        # None of what no parameter has.
        title = {"now": "standard error", "wanted": "wanted", "next": "after another drive"}[name]
        cell = attrgetter(name)
        shown = Column(title, cell=lambda one: error_text(cell(one), own_unit(one.unit)[1]))
        return shown if any(cell(one) is not None for one in known) else None

    columns = (
        Column("parameter", cell=lambda one: Link(words(one.name), ESTIMATE) if page else words(one.name)),
        Column("unit", cell=lambda one: shown_unit(one.unit)),
        Column("estimate", cell=lambda one: to_error(one.value, one.now, own_unit(one.unit)[1])),
        *map(error, ("now", "wanted", "next")),
    )
    return Section.of(SAY("known"), Table.of(known, columns))


def _rounds(found: StoredLoop, target: Path) -> Section | None:
    if not found.rounds:
        return None
    numbered = list(enumerate(found.rounds, start=1))
    last = found.driven[-1].known if found.driven else []
    columns = (
        Column("drive", "", fixed(0), lambda pair: float(pair[0])),
        Column("design", cell=lambda pair: _link(pair[1].folder, target)),
        Column("logs", cell=lambda pair: ", ".join(pair[1].logs) or SAY("not_yet")),
        *(_error_column(one) for one in last),
    )
    return Section.of(SAY("drives"), Table.of(numbered, columns))


def _link(folder: str, target: Path) -> Link | str:
    return Link(folder, f"{folder}/{REPORT}") if (target / folder / REPORT).is_file() else folder


def _error_column(parameter: KnownParameter) -> Column:
    factor = own_unit(parameter.unit)[1]

    def error(pair: tuple[int, LoopRound]) -> float | None:
        found = _error(pair[1], parameter.name)
        return None if found is None else found * factor

    title = f"standard error of {words(parameter.name)}"
    return Column(title, shown_unit(parameter.unit), error_text, error)
