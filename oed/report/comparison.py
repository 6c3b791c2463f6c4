"""Several saved records on one page: which is the most precise, how the studies differ, what each drives."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from oed.foundation.text import fixed, significant, words
from oed.records.record import Record
from oed.records.stored.result import Result
from oed.report.contenders import (
    Contender,
    best_paths,
    dots,
    error_columns,
    finding,
    of_robots,
    vocabulary_of,
)
from oed.report.page import NAME, address_of, render
from oed.report.parts.prose import Prose
from oed.report.parts.reading import chosen_text, duration_text, or_infinite, regression_of
from oed.report.parts.section import Cell, Column, Section, Table
from oed.report.parts.spoken import in_words

SAY = Prose("comparison")
RUN = Column("run", cell=lambda one: one.link)

ASKED = {
    "robot",
    "system",
    "trajectory",
    "experiment",
    "measurement",
    "weights",
    "estimate",
    "prior",
    "limits",
    "criterion",
}
"""Keys of a study that say what is designed for, rather than how it was searched."""


def write_comparison(
    records: Sequence[tuple[str, Record]],
    folder: str | Path,
    figures: Sequence[str] = (),
    sources: Mapping[str, str | Path] | None = None,
) -> Path:
    """Write report.html, report.md and figures/*.svg that compare named records; returns report.html.

    Args:
        records: that are compared, by name.
        folder: where to write.
        figures: formats in which figures are written beside the SVG of each: "pdf", "png".
        sources: folders of the records, by their names: the reports that are there are linked.

    Raises:
        UserMistake: the folder cannot be written to.
    """
    where = {
        name: address_of(Path(source) / f"{NAME}.html", folder) for name, source in (sources or {}).items()
    }
    some = [Contender(name, record, where.get(name, "")) for name, record in records]
    made = (_summary(some), _differences(some), best_paths(some), _searches(some))
    sections = (in_words(one, vocabulary_of(some)) for one in made)
    title = SAY("title", sorted({one.record.study.name for one in some}), len(some))
    return render(title, sections, Path(folder), figures=figures)


def _summary(some: Sequence[Contender]) -> Section:
    title, said = finding(some)
    duration = (
        Column("duration", "s", significant(3), _duration)
        if of_robots(some)
        else Column("experiment", cell=_experiment)
    )
    columns = (
        RUN,
        _where_different("study", lambda one: one.record.study.name, some),
        _where_different("robot", lambda one: words(one.record.study.called), some),
        duration,
        *error_columns(some, lambda one: one),
    )
    table = Table.of(some, columns, SAY("errors"), sortable=True)
    missing = (f"{one.name}: no feasible drive." for one in some if one.record.best is None)
    return Section.of(title, said, dots(some), table, notices=missing)


def _where_different(
    title: str, cell: Callable[[Contender], str], some: Sequence[Contender]
) -> Column | None:
    return Column(title, cell=cell) if len(set(map(cell, some))) > 1 else None


def _duration(one: Contender) -> float:
    asked = one.record.study.space
    return asked.runs * asked.duration


def _experiment(one: Contender) -> str:
    # Its runs are called as its own page calls them.
    return one.record.study.vocabulary.said(chosen_text(one.record) or duration_text(one.record))


def _searches(some: Sequence[Contender]) -> Section:
    def condition(best: Result) -> float | None:
        return or_infinite(best, best.condition_number)

    robots = of_robots(some)
    columns = (
        RUN,
        Column("criterion", cell=lambda one: SAY("criterion", one.record.study.criterion)),
        Column("best result", cell=_of_best(lambda best: best.name)),
        Column("objective", "", significant(4), _of_best(lambda best: best.objective)),
        Column("s_min(W)", "rad", significant(4), _of_best(lambda best: best.smallest_singular_value, True))
        if robots
        else None,
        Column("cond(W)", "", significant(4), _of_best(condition, True)) if robots else None,
        Column("path length", "m", fixed(2), _of_best(lambda best: best.path_length)) if robots else None,
    )
    found = Section.of("What the searches found", SAY("objectives"), Table.of(some, columns))
    return replace(found, folded=True)


def _of_best(cell: Callable[[Result], Cell], regressor: bool = False) -> Callable[[Contender], Cell]:
    # Of the best result; what is of the regressor W is not of sensors, which have none.
    def found(one: Contender) -> Cell:
        record = one.record
        if record.best is None or (regressor and regression_of(record) is None):
            return None
        return cell(record.best)

    return found


def _differences(some: Sequence[Contender]) -> Section:
    # Only the keys in which the studies differ: what else they say is the same for all.
    asked = [one.record.study.model_dump(mode="json", exclude_none=True, include=ASKED) for one in some]
    flat = [_flattened(study) for study in asked]
    keys = sorted({key for study in flat for key in study})
    differing = [key for key in keys if len({study.get(key) for study in flat}) > 1]
    columns = (
        Column("key"),
        *(Column(one.name, cell=study.get) for one, study in zip(some, flat, strict=True)),
    )
    table = Table.of(differing, columns, SAY("keys", of_robots(some)))
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
