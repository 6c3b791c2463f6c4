"""All candidates side by side: what a drive is worth, in repetitions of it."""

from __future__ import annotations

import math

from oed.foundation.text import fixed, significant, whole
from oed.records.record import Record
from oed.report.parts.judging import Aim, objective_of, repeatable, study_aim, useless
from oed.report.parts.reading import Entry, value, with_drive
from oed.report.parts.section import Section
from oed.report.parts.tables import Cell, Column, Table

NOTHING = 1e-6
"""Efficiency below which a drive is worth nothing: no number of repetitions makes up for it."""


def candidates(record: Record) -> Section | None:
    """One row per result: objective, efficiency, effort."""
    if not with_drive(record):
        return None
    shares = repeatable(record)
    columns = (*IDENTITY, *(WORTH if shares else ()), *EFFORT)
    rows = tuple(_row(record, entry, shares) for entry in record.results)
    return Section("Candidates", paragraphs=_reading(record), tables=(Table(columns, rows),))


IDENTITY = (Column("result"), Column("objective", "", significant(4)))
WORTH = (Column("efficiency", "%", fixed(1)), Column("repetitions for the same", "", fixed(1)))
EFFORT = (
    Column("path length", "m", fixed(2)),
    Column("search time", "s", fixed(1)),
    Column("evaluations", "", whole),
    Column("keeps every limit"),
)


def _row(record: Record, entry: Entry, shares: bool) -> tuple[Cell, ...]:
    repetitions = repetitions_of(record, entry)
    efficiency = None if repetitions is None else 100.0 / repetitions
    searched = bool(entry.get("history"))
    # What is 0 or infinite but for rounding is shown so.
    nothing = 0.0 if study_aim(record).criterion.proportional else -math.inf
    return (
        str(entry["name"]),
        nothing if useless(entry) else objective_of(entry),
        *((efficiency, repetitions) if shares else ()),
        value(entry, "path_length"),
        float(entry["wall_seconds"]) if searched else None,
        int(entry["history"][-1]["evaluations"]) if searched else None,
        bool(entry["feasible"]),
    )


def repetitions_of(record: Record, entry: Entry) -> float | None:
    """How many drives of a result are worth one best drive, by the study's criterion.

    Information adds up over repetitions, so this is the inverse of an efficiency; None where that is not so.
    """
    best, objective = record.best, objective_of(entry)
    if best is None or objective is None or not repeatable(record):
        return None
    # An objective within rounding of 0 is one: no number of repetitions tells what a drive leaves out.
    if useless(entry):
        return math.inf
    share = study_aim(record).efficiency(objective, float(best["objective"]))
    return None if share is None else 1.0 / share if share > NOTHING else math.inf


def _reading(record: Record) -> tuple[str, ...]:
    if len(record.results) == 1:
        return ()
    worth = _worth(record, study_aim(record)) if repeatable(record) else _not_repeatable(record)
    everyday = (
        "Everyday paths are as large as the limits allow and last as long as the design; those named "
        "`same_length` go as far as the design, in as many laps as that takes."
    )
    baselines = any(entry["kind"] == "baseline" for entry in record.results)
    return (f"{worth} {everyday}" if baselines else worth,)


def _worth(record: Record, aim: Aim) -> str:
    best = record.best
    against = f"`{best['name']}`" if best is not None else "the best drive"
    share, about = f"{aim.share}, against {against}", aim.criterion.asks_about
    if aim.criterion.proportional:
        share = f"the objective as a share of that of {against}"
    tells = f"tell {about} as well as one such drive" if about else "are worth one such drive"
    apart = ", each evaluated with unknowns of its own," if record.data.get("nuisances") else ""
    return (
        f"Efficiency is {share}. Information adds up over repetitions{apart or ','} so its inverse is how "
        f"many drives of that path {tells}; ∞ means never."
    )


def _not_repeatable(record: Record) -> str:
    if record.data["study"].get("prior"):
        return (
            "What was known beforehand is part of every objective and does not grow with repetitions of a "
            "drive; so objectives rank the drives, but do not say how many of one are worth another."
        )
    return "Repeating a drive changes nothing in this objective, so it ranks the drives and no more."
