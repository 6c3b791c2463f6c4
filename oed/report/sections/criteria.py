"""All drives judged by all criteria: what a drive that is best by one is worth by the others."""

from __future__ import annotations

import math

from oed.foundation.text import fixed, listing, quantity, significant
from oed.kernel.measurement.information import scaling_text
from oed.records.record import Record
from oed.report.parts.judging import (
    Aim,
    aim_of,
    plain_aim,
    rounded,
    study_aim,
)
from oed.report.parts.reading import Entry, with_drive
from oed.report.parts.section import Section
from oed.report.parts.tables import Cell, Column, Table

LEVEL = 99.95
"""Share [%] from which a drive counts as the best."""


def criteria(record: Record) -> Section | None:
    """One row per drive: its efficiency by every criterion, against the best drive by that criterion.

    None for records that hold no such numbers, or a single drive.
    """
    entries = [entry for entry in with_drive(record) if entry.get("criteria")]
    kinds = list(dict.fromkeys(kind for entry in entries for kind in entry["criteria"]))
    if not kinds or len(entries) < 2:
        return None
    aims = [plain_aim(record, kind) for kind in kinds]
    best = {aim.label: _best(entries, aim) for aim in aims}
    columns = (
        Column("result"),
        Column("searched for"),
        *(_column(aim, best[aim.label]) for aim in aims),
        Column("keeps every limit"),
    )
    rows = tuple(_row(record, entry, aims, best) for entry in entries)
    paragraphs = (_reading(record, aims, best), _verdict(record, aims, best), _practically_equal(record))
    return Section("Criteria", paragraphs=tuple(filter(None, paragraphs)), tables=(Table(columns, rows),))


def _value(entry: Entry, aim: Aim) -> float | None:
    # JSON holds no infinite number: null is that of a drive that leaves something undetermined.
    if aim.criterion.kind not in entry["criteria"]:
        return None
    number, zero = entry["criteria"][aim.criterion.kind], aim.criterion.proportional
    return -math.inf if number is None or (rounded(entry) and not zero) else float(number)


def _best(entries: list[Entry], aim: Aim) -> float | None:
    # Of the drives that keep every limit; of all where none does.
    kept = [entry for entry in entries if entry["feasible"]] or entries
    found = [number for entry in kept if (number := _value(entry, aim)) is not None]
    largest = max(found, default=-math.inf)
    return largest if math.isfinite(largest) else None


def _share(entry: Entry, aim: Aim, best: float | None) -> float | None:
    number = _value(entry, aim)
    if number is None or best is None:
        return None
    share = aim.efficiency(number, best)
    return None if share is None else 0.0 if rounded(entry) else 100.0 * share


def _has_share(aim: Aim, best: float | None) -> bool:
    return best is not None and aim.efficiency(best, best) is not None


def _column(aim: Aim, best: float | None) -> Column:
    if _has_share(aim, best):
        return Column(f"{aim.label}-efficiency", "%", fixed(1))
    return Column(aim.label, "", significant(4))


def _row(record: Record, entry: Entry, aims: list[Aim], best: dict[str, float | None]) -> tuple[Cell, ...]:
    searched = None if entry["kind"] in ("baseline", "path") else aim_of(record, entry).label
    numbers = [
        _share(entry, aim, best[aim.label]) if _has_share(aim, best[aim.label]) else _value(entry, aim)
        for aim in aims
    ]
    return (str(entry["name"]), searched, *numbers, bool(entry["feasible"]))


def _reading(record: Record, aims: list[Aim], best: dict[str, float | None]) -> str:
    shares = [
        f"{aim.label}-efficiency is {aim.share}"
        for aim in aims
        if aim.share and _has_share(aim, best[aim.label])
    ]
    plain = [
        f"{aim.label} is {aim.criterion.number}, larger is better"
        for aim in aims
        if aim.criterion.number and not _has_share(aim, best[aim.label])
    ]
    scaling = scaling_text(record.study.criterion.scaling)
    prior = bool(record.data["study"].get("prior"))
    repeated = (
        "F holds what was known beforehand, so a share is not one of repetitions."
        if prior
        else "A drive of 50 % has to be driven twice for what the best one tells."
    )
    return (
        "Every drive by every criterion, in percent of the best drive here by that criterion that keeps "
        f"every limit: {'; '.join([*shares, *plain])}. The parameters are taken {scaling}. {repeated}"
    )


def _verdict(record: Record, aims: list[Aim], best: dict[str, float | None]) -> str:
    winner = record.best
    if winner is None or not winner.get("criteria"):
        return ""
    found = [(aim, _share(winner, aim, best[aim.label])) for aim in aims]
    shares = [(aim, share) for aim, share in found if share is not None]
    if shares and all(share > LEVEL for _, share in shares):
        return f"The design {winner['name']} is the best here by {listing([aim.label for aim, _ in shares])}."
    told = [f"{quantity(share, '%')} by {aim.label}" for aim, share in shares]
    return f"The design {winner['name']} has {listing(told)}." if told else ""


def _practically_equal(record: Record) -> str:
    # The best result need not have the largest objective; say why.
    winner, aim = record.best, study_aim(record)
    kept = [entry for entry in record.results if entry["feasible"] and entry["objective"] is not None]
    if winner is None or not kept:
        return ""
    largest = max(kept, key=lambda entry: float(entry["objective"]))
    more = aim.change(float(largest["objective"]), float(winner["objective"]))
    if more < 1e-3:
        return ""
    return (
        f"{largest['name']} is {quantity(more, '%', 2)} better by {aim.label} than {winner['name']}, which "
        "counts as equal; among equals, the best is the one with the most information in all directions (D)."
    )
