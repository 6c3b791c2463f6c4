"""What was designed for, and what came of it, in plain words."""

from __future__ import annotations

import math
from typing import Any

from oed.record import Record
from oed.report.reading import Entry, blocks, segments
from oed.report.section import Section
from oed.report.sections.candidates import repetitions_of
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
    compared = " ".join(filter(None, [_everyday(record, entry), _simulated(record, entry)]))
    return tuple(filter(None, [text, compared, f"How the search ended: {entry['message']}"]))


def _everyday(record: Record, entry: Entry) -> str:
    # Against the square, which is what people drive to calibrate, or else the first everyday path.
    paths = [one for one in record.results if one["kind"] == "baseline" and one["feasible"]]
    chosen = next((one for one in paths if one["name"] == "square"), paths[0] if paths else None)
    parameters = [one for one in record.data["parameters"] if entry["standard_deviations"].get(one["name"])]
    if chosen is None or not parameters:
        return ""
    parameter, duration = parameters[-1], record.data["study"]["trajectory"]["duration"]
    name = parameter["name"]
    shares = [_percent(one["standard_deviations"].get(name), parameter["nominal"]) for one in (entry, chosen)]
    repetitions = repetitions_of(record, chosen)
    needed = (
        "No number of them" if repetitions == math.inf else f"{quantity(repetitions or 0.0, '', 2)} of them"
    )
    return (
        f"One {duration:g} s drive gives {name} to {shares[0]}; the {words(chosen['name'])} you would have "
        f"driven gives {shares[1]}. {needed} would be needed to tell the worst-determined combination of "
        "parameters as well."
    )


def _percent(deviation: float | None, nominal: float) -> str:
    if deviation is None:
        return "nothing"
    return f"±{quantity(100 * deviation / abs(nominal), '%')}"


def _simulated(record: Record, entry: Entry) -> str:
    outcome = record.data["validation"]
    verdicts = {one["name"]: one["verdict"] for one in (outcome or {}).get("results", [])}
    return str(verdicts.get(entry["name"], ""))


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
