"""All candidates side by side: what a drive is worth, in repetitions of it."""

from __future__ import annotations

import math

from oed.record import Record
from oed.report.reading import Entry, value, with_drive
from oed.report.section import Section
from oed.report.tables import Cell, Column, Table, fixed, significant, whole

ADDITIVE = ("E",)
"""Criteria whose value is proportional to the number of repetitions of a drive."""


def candidates(record: Record) -> Section | None:
    """One row per result: objective, efficiency, effort."""
    if not with_drive(record):
        return None
    rows = tuple(_row(record, entry) for entry in record.results)
    return Section("Candidates", paragraphs=_reading(record), tables=(Table(COLUMNS, rows),))


COLUMNS = (
    Column("result"),
    Column("objective", "", significant(4)),
    Column("efficiency", "%", fixed(1)),
    Column("repetitions for the same", "", fixed(1)),
    Column("path length", "m", fixed(2)),
    Column("search time", "s", fixed(1)),
    Column("evaluations", "", whole),
    Column("keeps every limit"),
)


def _row(record: Record, entry: Entry) -> tuple[Cell, ...]:
    repetitions = repetitions_of(record, entry)
    efficiency = None if repetitions is None else 100.0 / repetitions
    searched = bool(entry.get("history"))
    return (
        str(entry["name"]),
        0.0 if repetitions == math.inf else value(entry, "objective"),
        efficiency,
        repetitions,
        value(entry, "path_length"),
        float(entry["wall_seconds"]) if searched else None,
        int(entry["history"][-1]["evaluations"]) if searched else None,
        bool(entry["feasible"]),
    )


def repetitions_of(record: Record, entry: Entry) -> float | None:
    """How many drives of a result tell the worst-determined combination as well as one best drive.

    Information adds up over repetitions, so this is the ratio of objectives; None where that is not so.
    """
    best = record.best
    if (
        best is None
        or record.data["study"]["criterion"]["kind"] not in ADDITIVE
        or entry["objective"] is None
    ):
        return None
    # An objective within rounding of 0 is one: no number of repetitions tells what a drive leaves out.
    tells = entry["objective"] > 1e-9 * (entry["lambda_max"] or 0.0)
    return float(best["objective"] / entry["objective"]) if tells else math.inf


def _reading(record: Record) -> tuple[str, ...]:
    if record.data["study"]["criterion"]["kind"] not in ADDITIVE:
        return ()
    best = record.best
    if len(record.results) == 1:
        return ()
    against = f"`{best['name']}`" if best is not None else "the best drive"
    return (
        f"Efficiency is the objective as a share of that of {against}. Information adds up over repetitions, "
        "so its inverse is how many drives of that path tell the worst-determined combination of parameters "
        "as well as one such drive; ∞ means never. Everyday paths are as large as the limits allow and last "
        "as long as the design; those named `same_length` go as far as the design, in as many laps as that "
        "takes.",
    )
