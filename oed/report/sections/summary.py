"""What was designed for, and what came of it, in plain words."""

from __future__ import annotations

from typing import Any

from oed.record import Record
from oed.report.reading import Entry, blocks, segments
from oed.report.section import Section
from oed.report.wording import count, listing, quantity, readable, words


def summary(record: Record) -> Section:
    """The study's question and its answer; what the record notes, first."""
    winner = record.best
    answer = _nothing(record) if winner is None else _answer(record, winner)
    failures = () if winner is not None else tuple(_failure(entry) for entry in record.results)
    notices = (*record.data["notes"], *failures)
    return Section("Summary", paragraphs=(_question(record), *answer), notices=notices)


def _question(record: Record) -> str:
    study = record.data["study"]
    duration = f"{study['trajectory']['duration']:g} s"
    robot = words(study["robot"]["kind"])
    names = [parameter["name"] for parameter in record.data["parameters"]]
    parts = segments(record, study["trajectory"]["samples"])
    how = f", measured as the {_regressor(record)} of {count(parts, 'segment')}" if parts else ""
    return (
        f"Which drive of {duration} tells {listing(names)} of this {robot} robot best{how}? The criterion is "
        f"{study['criterion']['kind']}, where a larger objective is a better drive."
    )


def _regressor(record: Record) -> str:
    return {"position": "displacements", "heading": "turns"}.get(
        "/".join(blocks(record)), "displacements and turns"
    )


def _answer(record: Record, entry: Entry) -> tuple[str, ...]:
    of = "" if len(record.results) == 1 else f", the best of {len(record.results)} results,"
    numbers = [
        f"λ_min is {_number(entry['lambda_min'])}",
        f"the smallest singular value of W is {_number(entry['smallest_singular_value'])} rad",
    ]
    text = (
        f"The result {entry['name']}{of} reaches an objective of {_number(entry['objective'])} with a "
        f"drive of {quantity(entry['path_length'], 'm')} that keeps every limit; {listing(numbers)}. "
        f"{_deviations(record, entry)}"
    )
    return text, f"How the search ended: {entry['message']}"


def _number(value: float | None) -> str:
    return "unbounded" if value is None else quantity(value, "", 4)


def _deviations(record: Record, entry: Entry) -> str:
    known = entry["standard_deviations"]
    phrases = [
        _deviation(parameter, known[parameter["name"]])
        for parameter in record.data["parameters"]
        if parameter["name"] in known
    ]
    if not phrases:
        return "The study gives no noise, so no standard deviations are predicted."
    return f"Predicted standard deviations of one drive: {listing(phrases)}."


def _deviation(parameter: dict[str, Any], deviation: float | None) -> str:
    if deviation is None:
        return f"{parameter['name']} cannot be told"
    shown, unit = readable(deviation, parameter["unit"])
    share = _share(deviation, parameter["nominal"])
    return f"{parameter['name']} {quantity(shown, unit)}{share}"


def _share(deviation: float, nominal: float) -> str:
    return f" ({quantity(100 * deviation / abs(nominal), '%')} of nominal)" if nominal else ""


def _nothing(record: Record) -> tuple[str, ...]:
    if not record.results:
        return ("The study asked for no search and no baseline, so there is no drive to report.",)
    return ("No drive that keeps every limit was found, so there is no design to use.",)


def _failure(entry: Entry) -> str:
    return f"{entry['name']}: {entry['message']}"
