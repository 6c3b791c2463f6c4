"""What was designed for, and what came of it, in plain words; and what computed it."""

from __future__ import annotations

import math

import numpy as np

from oed.foundation.text import words
from oed.records.record import Record
from oed.records.stored.result import Result
from oed.report.answer import answer_of
from oed.report.parts.judging import aim_of, judged, meaning, precision, study_aim
from oed.report.parts.prose import Prose
from oed.report.parts.reading import (
    called,
    duration_text,
    in_place,
    measured_as,
    nuisance_text,
    prior_text,
    regression_of,
    runs_of,
)
from oed.report.parts.section import Column, Section, Table
from oed.report.refusal import refusal_of

SAY = Prose("summary")


def summary(record: Record) -> Section:
    """The answer, each parameter beside the best baseline's, or why there is none; before it, the notes."""
    found = answer_of(record)
    if found is None:
        return Section.of("Summary", *refusal_of(record)[1:], notices=[*record.failures, *record.notes])
    columns = (
        Column("parameter", cell=lambda one: one.name),
        Column("value", cell=lambda one: one.value),
        Column("standard error, designed drive", cell=lambda one: one.designed),
        Column(f"best baseline ({found.baseline})", cell=lambda one: one.baseline)
        if found.baseline
        else None,
    )
    table = Table.of(found.rows, columns) if found.rows else None
    notices = [*filter(None, [found.warning]), *record.failures, *record.notes]
    return Section.of("Summary", found.title + ".", *found.sentences, table, notices=notices)


def question(record: Record) -> Section:
    """What was asked for, and what the search for it came to, in the criterion's terms."""
    winner = record.best
    asked = SAY(
        "question",
        record.study.called if record.study.domain == "robots" else "",
        f"{'in' if runs_of(record) > 1 else 'of'} {duration_text(record)}",
        [one.name for one in judged(record)],
        measured_as(record),
        meaning(record),
        [one.name for one in record.parameters if not one.judged],
        (nuisance_text(record), prior_text(record)),
    )
    return Section.of("Question and search", asked, *(() if winner is None else _answer(record, winner)))


def _answer(record: Record, winner: Result) -> tuple[str, ...]:
    by, ahead = aim_of(record, winner).label, _ahead(record, winner)
    return SAY.paragraphs(
        "answer",
        called(record, winner),
        winner,
        "" if by == study_aim(record).label else by,
        len(record.results),
        None if ahead is None else (called(record, ahead), ahead.objective),
        0.0 if ahead is None else study_aim(record).change(ahead.worth or 0.0, winner.worth or 0.0),
        _turns(winner) if in_place(winner) else None,
        None if regression_of(record) is not None else precision(record, winner),
        [
            (one, record.shown_unit(one.name, one.unit))
            for one in record.parameters
            if one.name in winner.standard_deviations
        ],
        _simulated(record, winner),
    )


def _turns(result: Result) -> float:
    assert result.drive is not None
    return sum(float(np.abs(np.diff(run[:, 2])).sum()) for run in result.drive.by_run) / math.tau


def _ahead(record: Record, winner: Result) -> Result | None:
    # The result of largest objective, where that is not the one that counts as the best.
    rivals = [
        one
        for one in record.results
        if one.feasible and (one.worth or -math.inf) > (winner.worth or -math.inf)
    ]
    return max(rivals, key=lambda one: one.worth or -math.inf, default=None)


def _simulated(record: Record, winner: Result) -> str:
    found = record.validation
    if found is None:
        return ""
    said = {one.estimator: found.verdict(one) for one in found.results if one.name == winner.name}
    if len(said) == 1:
        return next(iter(said.values()))
    return " ".join(f"By {words(estimator)}: {verdict}" for estimator, verdict in said.items())
