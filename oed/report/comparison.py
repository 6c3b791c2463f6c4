"""Several saved records on one page: what each study asked for, and what its best drive gives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from oed.record import Record
from oed.report.page import render
from oed.report.reading import Path as DrivenPath
from oed.report.reading import path_of, value
from oed.report.section import Picture, Section
from oed.report.tables import Cell, Column, Table, fixed, significant
from oed.report.wording import count

Named = tuple[str, Record]

TOLD = ("robot", "trajectory", "measurement", "limits", "criterion")
"""Keys of a study that say what is designed for, rather than how it was searched."""


def write_comparison(records: Sequence[Named], folder: str | Path) -> Path:
    """Write report.html, report.md and figures/*.svg that compare named records; returns report.html.

    Raises:
        UserMistake: the folder cannot be written to.
    """
    sections = [_summary(records), _differences(records), _paths(records), _precision(records)]
    made = [section for section in sections if section is not None]
    return render("Comparison", made, Path(folder))


def _summary(records: Sequence[Named]) -> Section:
    columns = (
        Column("record"),
        Column("study"),
        Column("robot"),
        Column("criterion"),
        Column("best result"),
        Column("objective", "", significant(4)),
        Column("s_min(W)", "rad", significant(4)),
        Column("cond(W)", "", significant(4)),
        Column("duration", "s", significant(3)),
        Column("path length", "m", fixed(2)),
    )
    text = (
        f"The best drives of {count(len(records), 'record')}, side by side. Objectives compare only where "
        "criterion, scaling and measurement are the same; standard deviations, further down, always do."
    )
    missing = tuple(f"{name}: no feasible drive." for name, record in records if record.best is None)
    table = Table(columns, tuple(_summary_row(name, record) for name, record in records))
    return Section("Best drives", paragraphs=(text,), tables=(table,), notices=missing)


def _summary_row(name: str, record: Record) -> tuple[Cell, ...]:
    study, best = record.data["study"], record.best
    numbers: tuple[Cell, ...] = (None, None, None)
    if best is not None:
        numbers = tuple(
            value(best, key) for key in ("objective", "smallest_singular_value", "condition_number")
        )
    return (
        name,
        study["name"],
        study["robot"]["kind"],
        f"{study['criterion']['kind']}, scaling {study['criterion']['scaling']}",
        None if best is None else str(best["name"]),
        *numbers,
        float(study["trajectory"]["duration"]),
        None if best is None else value(best, "path_length"),
    )


def _differences(records: Sequence[Named]) -> Section:
    # Only the keys in which the studies differ: what else they say is the same for all.
    flat = [_flattened({key: record.data["study"][key] for key in TOLD}) for _, record in records]
    keys = sorted({key for study in flat for key in study})
    differing = [key for key in keys if len({study.get(key) for study in flat}) > 1]
    columns = (Column("key"), *(Column(name) for name, _ in records))
    rows = tuple((key, *(study.get(key) for study in flat)) for key in differing)
    if not rows:
        return Section("What differs", paragraphs=("The studies design for the same problem.",))
    return Section("What differs", tables=(Table(columns, rows, "Keys of the studies, in SI units"),))


def _flattened(value_: Any, prefix: str = "") -> dict[str, str]:
    if isinstance(value_, Mapping):
        pairs = ((f"{prefix}.{key}" if prefix else str(key), entry) for key, entry in value_.items())
        return {key: text for path, entry in pairs for key, text in _flattened(entry, path).items()}
    if isinstance(value_, list):
        return {prefix: ", ".join(_flattened(entry)[""] for entry in value_)}
    return {prefix: f"{value_:g}" if isinstance(value_, float) else str(value_)}


def _paths(records: Sequence[Named]) -> Section | None:
    drawn = [(name, record, record.best) for name, record in records if record.best is not None]
    if not drawn:
        return None
    pictures = tuple(
        _picture(index, name, path_of(record, best), record.data["study"]["limits"].get("workspace"))
        for index, (name, record, best) in enumerate(drawn)
        if best is not None
    )
    return Section("Best paths, each in its own workspace", figures=pictures)


def _picture(index: int, name: str, path: DrivenPath, workspace: Any) -> Picture:
    draw = partial(_draw, [path], workspace)
    return Picture(f"path_{index + 1}", f"Path of the best drive of {name}", name, draw)


def _draw(paths: Any, workspace: Any) -> Any:
    from oed.report import panels

    return panels.paths(paths, workspace)


def _precision(records: Sequence[Named]) -> Section | None:
    names = list(
        dict.fromkeys(parameter["name"] for _, record in records for parameter in record.data["parameters"])
    )
    rows = tuple(row for row in (_precision_row(name, record, names) for name, record in records) if row)
    if not rows:
        return None
    columns = (Column("record"), *(Column(name, "%", significant(3)) for name in names))
    text = "Predicted standard deviations of one best drive, as shares of the nominal values."
    return Section("Predicted precision", paragraphs=(text,), tables=(Table(columns, rows),))


def _precision_row(name: str, record: Record, names: Sequence[str]) -> tuple[Cell, ...] | None:
    best = record.best
    if best is None or not best["standard_deviations"]:
        return None
    nominal = {parameter["name"]: parameter["nominal"] for parameter in record.data["parameters"]}
    shares: list[Cell] = []
    for parameter in names:
        deviation = best["standard_deviations"].get(parameter)
        shares.append(None if deviation is None else 100.0 * deviation / abs(nominal[parameter]))
    return (name, *shares)
