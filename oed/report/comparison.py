"""Several saved records on one page: what each study asked for, and what its best drive gives."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from oed.foundation.text import fixed, significant, words
from oed.records.record import Record
from oed.records.stored.result import Result
from oed.report.figures import paths
from oed.report.figures.driven import path_of, room_of
from oed.report.page import render
from oed.report.parts.prose import Prose
from oed.report.parts.reading import or_infinite, regression_of
from oed.report.parts.section import Cell, Column, Picture, Section, Table

SAY = Prose("comparison")
Named = tuple[str, Record]
NAME = Column("record", cell=lambda item: item[0])

ASKED = {"robot", "trajectory", "measurement", "estimate", "prior", "limits", "criterion"}
"""Keys of a study that say what is designed for, rather than how it was searched."""


def write_comparison(records: Sequence[Named], folder: str | Path, figures: Sequence[str] = ()) -> Path:
    """Write report.html, report.md and figures/*.svg that compare named records; returns report.html.

    Args:
        records: that are compared, by name.
        folder: where to write.
        figures: formats in which figures are written beside the SVG of each: "pdf", "png".

    Raises:
        UserMistake: the folder cannot be written to.
    """
    sections = (_summary(records), _differences(records), _paths(records), _precision(records))
    return render("Comparison", sections, Path(folder), figures=figures)


def _summary(records: Sequence[Named]) -> Section:
    def condition(best: Result) -> float | None:
        return or_infinite(best, best.condition_number)

    def duration(item: Named) -> float:
        asked = item[1].study.trajectory
        return asked.runs * asked.duration

    columns = (
        NAME,
        Column("study", cell=lambda item: item[1].study.name),
        Column("robot", cell=lambda item: item[1].study.robot.kind),
        Column("criterion", cell=lambda item: SAY("criterion", item[1].study.criterion)),
        Column("best result", cell=_of_best(lambda best: best.name)),
        Column("objective", "", significant(4), _of_best(lambda best: best.objective)),
        Column("s_min(W)", "rad", significant(4), _of_best(lambda best: best.smallest_singular_value, True)),
        Column("cond(W)", "", significant(4), _of_best(condition, True)),
        Column("duration", "s", significant(3), duration),
        Column("path length", "m", fixed(2), _of_best(lambda best: best.path_length)),
    )
    missing = (f"{name}: no feasible drive." for name, record in records if record.best is None)
    said = SAY("best", len(records))
    return Section.of("Best drives", said, Table.of(records, columns), notices=missing)


def _of_best(cell: Callable[[Result], Cell], regressor: bool = False) -> Callable[[Named], Cell]:
    # Of the best result; what is of the regressor W is not of sensors, which have none.
    def found(item: Named) -> Cell:
        _, record = item
        if record.best is None or (regressor and regression_of(record) is None):
            return None
        return cell(record.best)

    return found


def _differences(records: Sequence[Named]) -> Section:
    # Only the keys in which the studies differ: what else they say is the same for all.
    asked = [record.study.model_dump(mode="json", exclude_none=True, include=ASKED) for _, record in records]
    flat = [_flattened(study) for study in asked]
    keys = sorted({key for study in flat for key in study})
    differing = [key for key in keys if len({study.get(key) for study in flat}) > 1]
    columns = (
        Column("key"),
        *(Column(name, cell=study.get) for (name, _), study in zip(records, flat, strict=True)),
    )
    table = Table.of(differing, columns, "Keys of the studies, in SI units")
    return Section.of("What differs", table if differing else SAY("alike"))


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
    pictures: list[Picture] = []
    for name, record in records:
        if record.best is not None:
            figure = paths.paths([path_of(record, record.best)], room_of(record))
            alt = f"Path of the best drive of {name}"
            pictures.append(Picture(f"path_{len(pictures) + 1}", alt, name, figure))
    return Section.of("Best paths, each in its own workspace", *pictures) if pictures else None


def _precision(records: Sequence[Named]) -> Section | None:
    names = dict.fromkeys(one.name for _, record in records for one in record.parameters)
    known = [(name, sizes) for name, record in records if (sizes := relative_deviations(record))]
    table = Table.of(known, (NAME, *deviation_columns(names, lambda item: item[1])))
    return Section.of("Predicted precision", SAY("precision"), table) if known else None


def deviation_columns(
    names: Iterable[str], sizes: Callable[[Any], Mapping[str, float | None]]
) -> Iterator[Column]:
    """A column for each parameter, of what an item has for relative deviations [%]."""
    return (_deviation(name, sizes) for name in names)


def _deviation(name: str, sizes: Callable[[Any], Mapping[str, float | None]]) -> Column:
    return Column(words(name), "%", significant(3), lambda item: sizes(item).get(name))


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
