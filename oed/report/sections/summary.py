"""What was designed for, and what came of it, in plain words; and what computed it."""

from __future__ import annotations

import math

import numpy as np

from oed.foundation.text import words
from oed.records.record import Record
from oed.records.stored.result import Result
from oed.report.parts.judging import aim_of, judged, meaning, precision, repetitions_of, study_aim
from oed.report.parts.prose import Prose
from oed.report.parts.reading import (
    duration_text,
    in_place,
    measured_as,
    nuisance_text,
    prior_text,
    regression_of,
    runs_of,
)
from oed.report.parts.section import Section

SAY = Prose("summary")


def summary(record: Record) -> Section:
    """The study's question and its answer; what the record notes, first."""
    winner = record.best
    question = SAY(
        "question",
        record.study.robot.kind,
        f"{'in' if runs_of(record) > 1 else 'of'} {duration_text(record)}",
        [one.name for one in judged(record)],
        measured_as(record),
        meaning(record),
        [one.name for one in record.parameters if not one.judged],
        (nuisance_text(record), prior_text(record)),
    )
    if winner is None:
        failures = (f"{one.name}: {one.message}" for one in record.results)
        nothing = SAY("nothing", bool(record.results))
        return Section.of("Summary", question, nothing, notices=(*record.notes, *failures))
    return Section.of("Summary", question, *_answer(record, winner), notices=record.notes)


def _answer(record: Record, winner: Result) -> tuple[str, ...]:
    by = aim_of(record, winner).label
    return SAY.paragraphs(
        "answer",
        winner,
        "" if by == study_aim(record).label else by,
        len(record.results),
        _turns(winner) if in_place(winner) else None,
        None if regression_of(record) is not None else precision(record, winner),
        [one for one in record.parameters if one.name in winner.standard_deviations],
        _compared(record, winner),
        _simulated(record, winner),
    )


def _turns(result: Result) -> float:
    assert result.drive is not None
    return sum(float(np.abs(np.diff(run[:, 2])).sum()) for run in result.drive.by_run) / math.tau


def _share(deviation: float | None, nominal: float) -> float | None:
    return None if deviation is None else 100 * deviation / abs(nominal) if nominal else 0.0


def _compared(record: Record, winner: Result) -> str:
    usual, known = _usual(record), winner.standard_deviations
    parameters = [one for one in judged(record) if known.get(one.name) and one.nominal]
    if usual is None or usual.name == winner.name or not parameters:
        return ""
    last, aim = parameters[-1], study_aim(record)
    shares = [_share(one.standard_deviations.get(last.name), last.nominal) for one in (winner, usual)]
    duration = (
        f"drive in {duration_text(record)}" if runs_of(record) > 1 else f"{duration_text(record)} drive"
    )
    needed = repetitions_of(record, usual)
    return SAY("compared", record.study.prior, duration, last.name, shares, usual.name, needed, aim)


def _usual(record: Record) -> Result | None:
    # The square, which is what people drive to calibrate, or else the first from which all is identifiable.
    baselines = [
        one
        for one in record.results
        if one.origin == "baseline" and one.feasible and not one.name.startswith("random")
    ]
    return min(baselines, key=lambda one: (one.name != "square", one.useless), default=None)


def _simulated(record: Record, winner: Result) -> str:
    every = () if record.validation is None else record.validation.results
    own = [one for one in every if one.name == winner.name]
    if len(own) == 1:
        return own[0].verdict
    return " ".join(f"By {words(one.estimator)}: {one.verdict}" for one in own)
