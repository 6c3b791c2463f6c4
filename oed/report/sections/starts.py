"""How the searches went: whether many starts agree on the best objective, and what each stage gained."""

from __future__ import annotations

from functools import partial
from statistics import median
from typing import Any

from oed.record import Record
from oed.report.reading import Entry, solver_options
from oed.report.section import Picture, Section
from oed.report.tables import Cell, Column, Table, fixed, significant, whole
from oed.report.wording import count, listing, quantity, words

WITHIN = 1.0
"""Shortfall from the best start up to which a start counts as having found it [%]."""

STAGES = {
    "starts": "the starts reached",
    "perturbations": "kicking the best design and solving again gave",
    "second_stage": "settling among practically equal designs gave",
}
SECOND_STAGES = {
    "logdet": "it keeps {share} of the objective and then seeks the most information in all directions",
    "shortest_path": "it keeps {share} of the objective and then seeks the shortest path",
}


def starts(record: Record) -> Section | None:
    """Spread of the starts, per search, as dots and as a table; the stages in words."""
    searches = [entry for entry in record.results if entry["starts"]]
    if not searches:
        return None
    sentences = [_agreement(entry) for entry in searches]
    stages = [_stages(record, entry) for entry in searches if entry["stages"]]
    return Section(
        "Spread over the starts",
        paragraphs=(*sentences, *stages),
        figures=_figures(searches),
        tables=(_table(searches),),
    )


def _objectives(entry: Entry) -> list[float]:
    found = [start["objective"] for start in entry["starts"]]
    return sorted((value for value in found if value is not None), reverse=True)


def _shortfalls(entry: Entry) -> list[float]:
    # In percent of the best start's magnitude: 0 for the best, negative below it.
    found = _objectives(entry)
    return [100.0 * (value - found[0]) / (abs(found[0]) or 1.0) for value in found]


def _close(entry: Entry) -> int:
    return sum(shortfall >= -WITHIN for shortfall in _shortfalls(entry))


def _agreement(entry: Entry) -> str:
    number, found = len(entry["starts"]), len(_objectives(entry))
    if not found:
        return f"{entry['name']}: none of {count(number, 'start')} found a feasible design."
    lost = "" if found == number else f"; {number - found} found no feasible design"
    share = f"{_close(entry)} of {count(number, 'start')}"
    return f"{entry['name']}: {share} end within 1 % of the best one{lost}."


def _stages(record: Record, entry: Entry) -> str:
    phrases, before = [], None
    for name, objective in entry["stages"].items():
        phrases.append(f"{STAGES.get(name, words(name) + ' gave')} {_reached(objective, before)}")
        before = objective
    return f"Stages of {entry['name']}: {'; '.join(phrases)}{_purpose(record, entry)}."


def _reached(objective: float | None, before: float | None) -> str:
    if objective is None:
        return "nothing"
    text = quantity(objective, "", 6)
    if not before:
        return text
    change = 100.0 * (objective - before) / abs(before)
    return f"{text} ({'no change' if abs(change) < 0.0005 else f'{change:+.3g} %'})"


def _purpose(record: Record, entry: Entry) -> str:
    options = solver_options(record, entry)
    purpose = SECOND_STAGES.get(options.get("second_stage", ""), "")
    if "second_stage" not in entry["stages"] or not purpose:
        return ""
    share = f"{100 * options['second_stage_share']:g} %"
    return f": {purpose.format(share=share)}"


def _figures(searches: list[Entry]) -> tuple[Picture, ...]:
    spreads = [
        (str(entry["name"]), _shortfalls(entry), len(entry["starts"]) - len(_objectives(entry)))
        for entry in searches
        if len(_objectives(entry)) > 1
    ]
    if not spreads:
        return ()
    caption = (
        "Objective of every start, against the best start of its search. Dots in the band are within 1 %."
    )
    alt = f"Objectives of the starts, sorted, of {listing([title for title, _, _ in spreads])}"
    return (Picture("starts", alt, caption, partial(_draw, spreads)),)


def _draw(spreads: Any) -> Any:
    from oed.report import panels

    return panels.starts(spreads)


def _table(searches: list[Entry]) -> Table:
    six = significant(6)
    columns = (
        Column("result"),
        Column("starts", "", whole),
        Column("within 1 %", "", whole),
        Column("worst objective", "", six),
        Column("median objective", "", six),
        Column("best objective", "", six),
        Column("median iterations", "", whole),
        Column("most iterations", "", whole),
        Column("whole search", "s", fixed(1)),
    )
    caption = "Starts only; the time is that of the whole search, with all its stages."
    return Table(columns, tuple(_row(entry) for entry in searches), caption)


def _row(entry: Entry) -> tuple[Cell, ...]:
    found = _objectives(entry)
    spread: tuple[Cell, ...] = (found[-1], median(found), found[0]) if found else (None, None, None)
    iterations = [start["iterations"] for start in entry["starts"]]
    effort = (median(iterations), max(iterations), entry["wall_seconds"])
    return (str(entry["name"]), len(entry["starts"]), _close(entry), *spread, *effort)
