"""How the searches went: whether many starts agree on the best objective, and what each stage gained."""

from __future__ import annotations

from functools import partial
from statistics import median
from typing import Any

from oed.foundation.text import count, fixed, listing, quantity, significant, whole, words
from oed.records.record import Record
from oed.report.parts.judging import Aim, aim_of, study_aim
from oed.report.parts.reading import Entry, solver_of
from oed.report.parts.section import Picture, Section
from oed.report.parts.tables import Cell, Column, Table

Search = tuple[Aim, Entry]

WITHIN = 1.0
"""Shortfall from the best start up to which a start counts as having found it [%]."""

STAGES = {
    "starts": "the starts reached",
    "perturbations": "kicking the best design and solving again gave",
    "second_stage": "settling among practically equal designs gave",
}
SECOND_STAGES = {
    "logdet": "it keeps {share} of the {what} and then seeks the most information in all directions",
    "shortest_path": "it keeps {share} of the {what} and then seeks the shortest path",
}


def starts(record: Record) -> Section | None:
    """Spread of the starts, per search, as dots and as a table; the stages in words."""
    searches: list[tuple[Aim, Entry]] = [
        (aim_of(record, entry), entry) for entry in record.results if entry["starts"]
    ]
    if not searches:
        return None
    own = study_aim(record).label
    apart = any(aim.label != own for aim, _ in searches)
    sentences = [_agreement(aim, entry, apart) for aim, entry in searches]
    stages = [_stages(record, aim, entry, apart) for aim, entry in searches if entry["stages"]]
    return Section(
        "Spread over the starts",
        paragraphs=(*sentences, *stages),
        figures=_figures(searches, apart),
        tables=(_table(searches, apart),),
    )


def _objectives(entry: Entry) -> list[float]:
    found = [start["objective"] for start in entry["starts"]]
    return sorted((value for value in found if value is not None), reverse=True)


def _shortfalls(aim: Aim, entry: Entry) -> list[float]:
    # In percent of the best start: 0 for the best, negative below it.
    found = _objectives(entry)
    return [aim.change(value, found[0]) for value in found]


def _close(aim: Aim, entry: Entry) -> int:
    return sum(shortfall >= -WITHIN for shortfall in _shortfalls(aim, entry))


def _agreement(aim: Aim, entry: Entry, apart: bool) -> str:
    number, found = len(entry["starts"]), len(_objectives(entry))
    name = f"{entry['name']}, by {aim.label}" if apart else str(entry["name"])
    if not found:
        return f"{name}: none of {count(number, 'start')} found a feasible design."
    lost = "" if found == number else f"; {number - found} found no feasible design"
    share = f"{_close(aim, entry)} of {count(number, 'start')}"
    return f"{name}: {share} end within 1 % of the best one{lost}."


def _stages(record: Record, aim: Aim, entry: Entry, apart: bool) -> str:
    phrases, before = [], None
    for name, objective in entry["stages"].items():
        phrases.append(f"{STAGES.get(name, words(name) + ' gave')} {_reached(aim, objective, before)}")
        before = objective
    numbers = f", in {aim.number}" if apart else ""
    return f"Stages of {entry['name']}{numbers}: {'; '.join(phrases)}{_purpose(record, aim, entry)}."


def _reached(aim: Aim, objective: float | None, before: float | None) -> str:
    if objective is None:
        return "nothing"
    text = quantity(objective, "", 6)
    if not before:
        return text
    change = aim.change(objective, before)
    of = "" if aim.criterion.conceded == "objective" else " in efficiency"
    return f"{text} ({'no change' if abs(change) < 0.0005 else f'{change:+.3g} %{of}'})"


def _purpose(record: Record, aim: Aim, entry: Entry) -> str:
    solver = solver_of(record, entry)
    purpose = SECOND_STAGES.get(getattr(solver, "second_stage", ""), "")
    if "second_stage" not in entry["stages"] or not purpose:
        return ""
    share = f"{100 * getattr(solver, 'second_stage_share', 1.0):g} %"
    return f": {purpose.format(share=share, what=aim.criterion.conceded)}"


def _figures(searches: list[Search], apart: bool) -> tuple[Picture, ...]:
    shown = [(aim, entry) for aim, entry in searches if len(_objectives(entry)) > 1]
    spreads = [
        (
            f"{entry['name']}\nby {aim.label}" if apart else str(entry["name"]),
            _shortfalls(aim, entry),
            len(entry["starts"]) - len(_objectives(entry)),
        )
        for aim, entry in shown
    ]
    if not spreads:
        return ()
    caption = (
        "Objective of every start, against the best start of its search. Dots in the band are within 1 %."
    )
    if any(aim.share and not aim.criterion.proportional for aim, _ in searches):
        caption += " Percentages are of efficiency by the criterion searched for."
    alt = f"Objectives of the starts, sorted, of {listing([str(entry['name']) for _, entry in shown])}"
    return (Picture("starts", alt, caption, partial(_draw, spreads)),)


def _draw(spreads: Any) -> Any:
    from oed.report.figures import panels

    return panels.starts(spreads)


def _table(searches: list[Search], apart: bool) -> Table:
    six = significant(6)
    columns = (
        Column("result"),
        *((Column("searched for"),) if apart else ()),
        Column("starts", "", whole),
        Column("within 1 %", "", whole),
        Column("worst objective", "", six),
        Column("median objective", "", six),
        Column("best objective", "", six),
        Column("median iterations", "", whole),
        Column("most iterations", "", whole),
        Column("whole search", "s", fixed(1)),
    )
    numbers = " Objectives are those of the criterion searched for." if apart else ""
    caption = f"Starts only; the time is that of the whole search, with all its stages.{numbers}"
    return Table(columns, tuple(_row(aim, entry, apart) for aim, entry in searches), caption)


def _row(aim: Aim, entry: Entry, apart: bool) -> tuple[Cell, ...]:
    found = _objectives(entry)
    spread: tuple[Cell, ...] = (found[-1], median(found), found[0]) if found else (None, None, None)
    iterations = [start["iterations"] for start in entry["starts"]]
    effort = (median(iterations), max(iterations), entry["wall_seconds"])
    named = (str(entry["name"]), *((aim.label,) if apart else ()))
    return (*named, len(entry["starts"]), _close(aim, entry), *spread, *effort)
