"""Several saved records on one page: what each study asked for, and what its best drive gives."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from oed.foundation.text import fixed, significant, words
from oed.kernel.criteria import Criterion
from oed.records.record import Record
from oed.report.figures import paths
from oed.report.figures.driven import path_of, room_of
from oed.report.page import render
from oed.report.parts.prose import Prose
from oed.report.parts.reading import or_infinite, regression_of, whole_duration
from oed.report.parts.section import Cell, Column, Picture, Section, Table

SAY = Prose("comparison")
Named = tuple[str, Record]

ASKED = {"robot", "trajectory", "measurement", "estimate", "prior", "limits", "criterion"}
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
    missing = tuple(f"{name}: no feasible drive." for name, record in records if record.best is None)
    table = Table(columns, tuple(_summary_row(name, record) for name, record in records))
    return Section("Best drives", paragraphs=(SAY("best", len(records)),), tables=(table,), notices=missing)


def _summary_row(name: str, record: Record) -> tuple[Cell, ...]:
    study, best = record.study, record.best
    asked = (name, study.name, study.robot.kind, _criterion(study.criterion))
    if best is None:
        return (*asked, None, None, None, None, whole_duration(record), None)
    # Sensors have no regressor W.
    known = regression_of(record) is not None
    own = (best.smallest_singular_value, or_infinite(best, best.condition_number)) if known else (None, None)
    return (*asked, best.name, best.objective, *own, whole_duration(record), best.path_length)


def _criterion(criterion: Criterion) -> str:
    scaling = criterion.scaling if isinstance(criterion.scaling, str) else "given"
    return f"{words(criterion.kind)}, scaling {scaling}"


def _differences(records: Sequence[Named]) -> Section:
    # Only the keys in which the studies differ: what else they say is the same for all.
    asked = [record.study.model_dump(mode="json", exclude_none=True, include=ASKED) for _, record in records]
    flat = [_flattened(study) for study in asked]
    keys = sorted({key for study in flat for key in study})
    differing = [key for key in keys if len({study.get(key) for study in flat}) > 1]
    columns = (Column("key"), *(Column(name) for name, _ in records))
    rows = tuple((key, *(study.get(key) for study in flat)) for key in differing)
    if not rows:
        return Section("What differs", paragraphs=("The studies design for the same problem.",))
    return Section("What differs", tables=(Table(columns, rows, "Keys of the studies, in SI units"),))


def _flattened(part: Any, prefix: str = "") -> dict[str, str]:
    # `limits.wheel_speed.bounds`, `measurement.2.kind` -> what stands there.
    if isinstance(part, list) and any(isinstance(one, Mapping) for one in part):
        part = dict(enumerate(part, 1))
    if not isinstance(part, Mapping):
        return {prefix: _text(part)}
    found: dict[str, str] = {}
    for key, one in part.items():
        found |= _flattened(one, f"{prefix}.{key}" if prefix else str(key))
    return found


def _text(value: Any) -> str:
    if isinstance(value, list):
        # Brackets only where lists are in a list.
        return ", ".join(f"({_text(one)})" if isinstance(one, list) else _text(one) for one in value)
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:g}" if isinstance(value, float) else str(value)


def _paths(records: Sequence[Named]) -> Section | None:
    drawn = [(name, record, record.best) for name, record in records if record.best is not None]
    pictures = tuple(
        Picture(
            f"path_{number}",
            f"Path of the best drive of {name}",
            name,
            paths.paths([path_of(record, best)], room_of(record)),
        )
        for number, (name, record, best) in enumerate(drawn, 1)
    )
    return Section("Best paths, each in its own workspace", figures=pictures) if pictures else None


def _precision(records: Sequence[Named]) -> Section | None:
    names = list(dict.fromkeys(one.name for _, record in records for one in record.parameters))
    known = [(name, relative_deviations(record)) for name, record in records]
    rows = tuple((name, *(sizes.get(one) for one in names)) for name, sizes in known if sizes)
    if not rows:
        return None
    columns = (Column("record"), *(Column(words(name), "%", significant(3)) for name in names))
    return Section("Predicted precision", paragraphs=(SAY("precision"),), tables=(Table(columns, rows),))


def relative_deviations(record: Record) -> dict[str, float | None]:
    """Predicted standard deviations of the best drive, shares of the nominal values [%]; {} without any."""
    best = record.best
    known = {} if best is None else best.standard_deviations
    nominal = {one.name: one.nominal for one in record.parameters}
    return {name: _share(deviation, nominal[name]) for name, deviation in known.items()}


def _share(deviation: float | None, nominal: float) -> float | None:
    # A parameter that is not identifiable has an infinite deviation, one that is nominally 0 no share.
    if deviation is None:
        return math.inf
    return 100.0 * deviation / abs(nominal) if nominal else None
