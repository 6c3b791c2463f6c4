"""The answer that a study found: what its drive teaches, beside the best baseline, and what that rests on."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from oed.foundation.text import deviation_text, given_text, nominal_text, own_unit, unit_text, words
from oed.records.record import Record
from oed.records.stored.result import Result
from oed.records.stored.study_record import StoredParameter
from oed.report.parts.judging import judged, repetitions_of, study_aim
from oed.report.parts.prose import Prose
from oed.report.parts.reading import VARIANT, duration_text, in_place

SAY = Prose("answer")
EQUAL = 0.05
"""Share of a drive by which two count as equally good."""
MANY = 100.0
"""Drives beyond which their number says nothing to a reader: standard errors are compared instead."""


@dataclass(frozen=True)
class Estimated:
    """A parameter that the study estimates, in words.

    Attributes:
        name: of the parameter.
        value: nominal, with its unit.
        designed: standard error from the designed drive.
        baseline: the same from the best baseline; "" without one.
    """

    name: str
    value: str
    designed: str
    baseline: str


@dataclass(frozen=True)
class Answer:
    """What a study found, in words.

    Attributes:
        title: the drive.
        rows: what is estimated.
        baseline: name of the best baseline that can be driven; "" for none.
        sentences: how it compares, what is proved, what simulations say.
    """

    title: str
    rows: tuple[Estimated, ...]
    baseline: str
    sentences: tuple[str, ...]


def answer_of(record: Record) -> Answer | None:
    """The answer that a record holds; None where no drive satisfies every limit."""
    winner = record.best
    if winner is None:
        return None
    baseline = best_baseline(record)
    beside = baseline if baseline is not None and baseline.name != winner.name else None
    rows = tuple(_row(one, winner, beside) for one in record.parameters) if winner.standard_deviations else ()
    said = (_compared(record, winner, baseline), _proved(record, winner), _holds(record, winner))
    return Answer(
        _title(record, winner),
        rows,
        "" if beside is None else _pattern(beside),
        tuple(filter(None, said if rows else (SAY("noiseless"), *said))),
    )


def best_baseline(record: Record) -> Result | None:
    """The baseline of the largest objective among those that satisfy every limit; None without any."""
    driven = [one for one in record.results if one.origin == "baseline" and one.feasible]
    return max(driven, key=lambda one: (not one.useless, one.worth or -math.inf), default=None)


def _pattern(baseline: Result) -> str:
    # What is driven, of whichever length.
    return words(baseline.name.removesuffix(VARIANT))


def _title(record: Record, winner: Result) -> str:
    room = getattr(record.study.limits, "workspace", None)
    size = None
    if room is not None:
        x_min, x_max, y_min, y_max = room.extent
        size = given_text(x_max - x_min, "m"), given_text(y_max - y_min, "m")
    return SAY("title", record.study.name, duration_text(record), size, in_place(winner))


def _row(parameter: StoredParameter, winner: Result, baseline: Result | None) -> Estimated:
    unit, factor = own_unit(parameter.unit)
    value = f"{nominal_text(parameter.nominal * factor)} {unit_text(unit)}".strip()
    other = "" if baseline is None else _error(parameter, baseline)
    return Estimated(words(parameter.name), value, _error(parameter, winner), other)


def _error(parameter: StoredParameter, result: Result) -> str:
    size = result.standard_deviations.get(parameter.name)
    return SAY("open") if size is None else deviation_text(size, parameter.unit)


def _compared(record: Record, winner: Result, baseline: Result | None) -> str:
    if baseline is None:
        why = {words(one.name): list(one.violations) for one in record.results if one.origin == "baseline"}
        return SAY("undriven", why) if why else ""
    name = _pattern(baseline)
    if baseline.name == winner.name:
        return SAY("baseline", name)
    if baseline.useless:
        known = baseline.standard_deviations
        return SAY("useless", name, [one.name for one in judged(record) if known.get(one.name) is None])
    needed = repetitions_of(record, baseline)
    if needed is None or MANY < needed < math.inf:
        return SAY("smaller", name, sorted(_ratios(record, winner, baseline)))
    return SAY("repetitions", name, needed, EQUAL)


def _ratios(record: Record, winner: Result, baseline: Result) -> Iterator[float]:
    # How many times the designed drive's standard error the baseline's is.
    for one in judged(record):
        own, other = (result.standard_deviations.get(one.name) for result in (winner, baseline))
        if own and other:
            yield other / own


def _proved(record: Record, winner: Result) -> str:
    certificate = record.certificate
    if certificate is None:
        return ""
    bound, aim = certificate.gap_to or certificate.upper_bound, study_aim(record)
    share = None if winner.worth is None else aim.efficiency(winner.worth, bound)
    gap = certificate.gap if not share else 1 / share - 1
    return SAY("proved", None if gap is None else max(gap, 0.0))


def _holds(record: Record, winner: Result) -> str:
    simulated = [] if record.validation is None else record.validation.results
    own = [one for one in simulated if one.name == winner.name]
    replicates = record.validation.replicates if record.validation is not None and own else 0
    failed = [check.question for one in own for check in one.checks if not check.passed]
    tried = [] if record.robustness is None else record.robustness.results
    violating = next((one.interval[1] for one in tried if one.name == winner.name), None)
    return SAY("holds", replicates, failed, violating)
