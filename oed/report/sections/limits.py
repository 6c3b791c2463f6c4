"""How far every drive stays inside every limit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from oed.foundation.text import Unit, fixed, in_degrees, quantity, unit_text, words
from oed.records.record import Record
from oed.report.parts.reading import Entry, with_drive
from oed.report.parts.section import Section
from oed.report.parts.tables import Cell, Column, Table
from oed.robots.limits import LIMITS

CONDITIONS = ("duration", "start", "rest_to_rest")
"""What holds exactly or not at all: there is no room to speak of."""
MOST_COLUMNS = 7
"""Limits beyond which a table of all drives names only those that a drive touches."""


def limits(record: Record) -> Section | None:
    """The best drive limit by limit, then all drives side by side."""
    entries = [entry for entry in with_drive(record) if entry["margins"]]
    if not entries:
        return None
    winner = record.best or entries[0]
    tables = [_by_limit(winner)] + ([_side_by_side(entries)] if len(entries) > 1 else [])
    text = (
        f"Margins are the distance to the limit where the drive comes closest, {_looked_at(entries)}. "
        "A limit is active where the drive touches it, within 0.1 % of its size, and kept unless it is "
        "exceeded by more than that."
    )
    return Section("Limits", paragraphs=(text,), tables=tuple(tables))


def _looked_at(entries: list[Entry]) -> str:
    # When; records of before say nothing of it.
    margins = [margin for entry in entries for margin in entry["margins"]]
    if any(margin.get("certain") is None for margin in margins):
        return "checked on a grid ten times finer than the samples"
    points = list(dict.fromkeys(words(one["limit"]) for one in margins if not one["certain"]))
    return "at all times" + (f" (of {', '.join(points)} at the points checked only)" if points else "")


def _by_limit(entry: Entry) -> Table:
    titles = ("limit", "margin", "size of the limit", "unit", "state")
    columns = tuple(Column(title) for title in titles)
    rows = tuple(_row(margin) for margin in entry["margins"])
    return Table(columns, rows, f"Limits of {entry['name']}")


def _row(margin: Mapping[str, Any]) -> tuple[Cell, ...]:
    unit, factor = _unit(margin)
    return (
        words(margin["limit"]),
        _amount(margin, factor),
        _size(margin, factor),
        unit_text(unit),
        _state(margin),
    )


def _unit(margin: Mapping[str, Any]) -> Unit:
    # As shown, and its factor from SI.
    unit = str(margin["unit"])
    degrees = getattr(LIMITS.get(margin["limit"]), "in_degrees", False)
    return in_degrees(unit) if degrees else (unit, 1.0)


def _size(margin: Mapping[str, Any], factor: float) -> str | None:
    if margin["limit"] in ("start", "rest_to_rest"):
        return None
    return f"{factor * margin['size']:g}"


def _side_by_side(entries: list[Entry]) -> Table:
    names = list(dict.fromkeys(margin["limit"] for entry in entries for margin in entry["margins"]))
    if len(names) > MOST_COLUMNS:
        return _touched(entries)
    columns = (Column("result"), *(Column(words(name)) for name in names))
    rows = tuple((str(entry["name"]), *_states(entry, names)) for entry in entries)
    return Table(columns, rows, "All drives")


def _touched(entries: list[Entry]) -> Table:
    titles = ("result", "exceeded", "active or met", "kept with room")
    columns = tuple(Column(title) for title in titles)
    return Table(columns, tuple(_touched_row(entry) for entry in entries), "All drives")


def _touched_row(entry: Entry) -> tuple[Cell, ...]:
    broken = [margin for margin in entry["margins"] if not margin["kept"]]
    touched = [margin for margin in entry["margins"] if margin["kept"] and margin["active"]]
    exceeded = [f"{words(margin['limit'])} by {_quantity(-margin['margin'], margin)}" for margin in broken]
    rest = len(entry["margins"]) - len(broken) - len(touched)
    met = ", ".join(words(margin["limit"]) for margin in touched)
    return str(entry["name"]), ", ".join(exceeded) or None, met or None, str(rest)


def _states(entry: Entry, names: list[str]) -> list[Cell]:
    by_name = {margin["limit"]: margin for margin in entry["margins"]}
    return [_brief(by_name[name]) if name in by_name else None for name in names]


def _brief(margin: Mapping[str, Any]) -> str:
    if not margin["kept"]:
        return f"exceeded by {_quantity(-margin['margin'], margin)}"
    if margin["active"]:
        return "met" if margin["limit"] in CONDITIONS else "active"
    return f"{_quantity(margin['margin'], margin)} spare"


def _quantity(amount: float, margin: Mapping[str, Any]) -> str:
    unit, factor = _unit(margin)
    return quantity(factor * amount, unit)


def _state(margin: Mapping[str, Any]) -> str:
    if not margin["kept"]:
        return "exceeded"
    if margin["limit"] in CONDITIONS and margin["active"]:
        return "met"
    state = "active" if margin["active"] else "kept with room"
    return f"{state} (checked at points only)" if margin.get("certain") is False else state


def _amount(margin: Mapping[str, Any], factor: float) -> str:
    # As fine as the tolerance by which a limit is judged, and one digit more.
    decimals = 4 if factor * margin["size"] <= 1 else 3
    return fixed(decimals)(factor * margin["margin"])
