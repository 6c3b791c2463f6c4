"""How far every drive stays inside every limit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from oed.record import Record
from oed.report.reading import Entry, with_drive
from oed.report.section import Section
from oed.report.tables import Cell, Column, Table, fixed
from oed.report.wording import quantity, unit_text, words

CONDITIONS = ("duration", "start", "rest_to_rest")
"""What holds exactly or not at all: there is no room to speak of."""


def limits(record: Record) -> Section | None:
    """The best drive limit by limit, then all drives side by side."""
    entries = [entry for entry in with_drive(record) if entry["margins"]]
    if not entries:
        return None
    winner = record.best or entries[0]
    tables = [_by_limit(winner)] + ([_side_by_side(entries)] if len(entries) > 1 else [])
    text = (
        "Margins are the distance to the limit where the drive comes closest, checked on a grid ten times "
        "finer than the samples. A limit is active where the drive touches it, within 0.1 % of its size, and "
        "kept unless it is exceeded by more than that."
    )
    return Section("Limits", paragraphs=(text,), tables=tuple(tables))


def _by_limit(entry: Entry) -> Table:
    titles = ("limit", "margin", "size of the limit", "unit", "state")
    columns = tuple(Column(title) for title in titles)
    rows = tuple(_row(margin) for margin in entry["margins"])
    return Table(columns, rows, f"Limits of {entry['name']}")


def _row(margin: Mapping[str, Any]) -> tuple[Cell, ...]:
    size = f"{margin['size']:g}" if margin["limit"] not in ("start", "rest_to_rest") else None
    return words(margin["limit"]), _amount(margin), size, unit_text(margin["unit"]), _state(margin)


def _side_by_side(entries: list[Entry]) -> Table:
    names = list(dict.fromkeys(margin["limit"] for entry in entries for margin in entry["margins"]))
    columns = (Column("result"), *(Column(words(name)) for name in names))
    rows = tuple((str(entry["name"]), *_states(entry, names)) for entry in entries)
    return Table(columns, rows, "All drives")


def _states(entry: Entry, names: list[str]) -> list[Cell]:
    by_name = {margin["limit"]: margin for margin in entry["margins"]}
    return [_brief(by_name[name]) if name in by_name else None for name in names]


def _brief(margin: Mapping[str, Any]) -> str:
    if not margin["kept"]:
        return f"exceeded by {quantity(-margin['margin'], margin['unit'])}"
    if margin["active"]:
        return "met" if margin["limit"] in CONDITIONS else "active"
    return f"{quantity(margin['margin'], margin['unit'])} spare"


def _state(margin: Mapping[str, Any]) -> str:
    if not margin["kept"]:
        return "exceeded"
    if margin["limit"] in CONDITIONS and margin["active"]:
        return "met"
    return "active" if margin["active"] else "kept with room"


def _amount(margin: Mapping[str, Any]) -> str:
    # As fine as the tolerance by which a limit is judged, and one digit more.
    decimals = 4 if margin["size"] <= 1 else 3
    return fixed(decimals)(margin["margin"])
