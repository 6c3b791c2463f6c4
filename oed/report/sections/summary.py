"""What was designed for, and what came of it, in plain words."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import pairwise
from typing import Any

from oed.foundation.text import Unit, deviation_text, listing, quantity, words
from oed.records.record import Record
from oed.report.figures.driven import poses_of
from oed.report.parts.judging import aim_of, judged, meaning, precision, study_aim, useless
from oed.report.parts.measured import along_text, measured_as, prior_text
from oed.report.parts.reading import (
    Entry,
    deviation_units,
    duration_text,
    is_regression,
    on_the_spot,
    runs_of,
)
from oed.report.parts.section import Section
from oed.report.sections.candidates import repetitions_of


def summary(record: Record) -> Section:
    """The study's question and its answer; what the record notes, first."""
    winner = record.best
    answer = _nothing(record) if winner is None else _answer(record, winner)
    failures = () if winner is not None else tuple(_failure(entry) for entry in record.results)
    notices = (*record.data["notes"], *failures)
    return Section("Summary", paragraphs=(_question(record), *answer), notices=notices)


def _question(record: Record) -> str:
    study = record.data["study"]
    which = f"in {duration_text(record)}" if runs_of(record) > 1 else f"of {duration_text(record)}"
    robot = words(study["robot"]["kind"])
    names = [words(parameter["name"]) for parameter in judged(record)]
    question = (
        f"Which drive {which} tells {listing(names)} of this {robot} robot best, measured as "
        f"{measured_as(record)}? The criterion is {meaning(record)}, where a larger objective is a "
        "better drive."
    )
    more = (_not_judged(record), along_text(record), prior_text(record))
    return " ".join(filter(None, [question, *more]))


def _not_judged(record: Record) -> str:
    names = [words(one["name"]) for one in record.data["parameters"] if not one.get("judged", True)]
    return f"{listing(names).capitalize()}: estimated too, but not judged." if names else ""


def _answer(record: Record, entry: Entry) -> tuple[str, ...]:
    of = "" if len(record.results) == 1 else f", the best of {len(record.results)} results,"
    text = (
        f"The result {entry['name']}{_found_by(record, entry)}{of} reaches an objective of "
        f"{_number(entry['objective'])} with a drive {_extent(entry)} that keeps every limit; "
        f"{listing(_numbers(record, entry))}. {_deviations(record, entry)}"
    )
    compared = " ".join(filter(None, [_everyday(record, entry), _simulated(record, entry)]))
    return tuple(filter(None, [text, compared, f"How the search ended: {entry['message']}"]))


def _found_by(record: Record, entry: Entry) -> str:
    label = aim_of(record, entry).label
    return "" if label == study_aim(record).label else f", found by searching for {label}"


def _extent(entry: Entry) -> str:
    if not on_the_spot(entry):
        return f"of {quantity(entry['path_length'], 'm')}"
    angles = [[pose[2] for pose in run] for run in poses_of(entry)]
    turns = sum(abs(after - before) for run in angles for before, after in pairwise(run)) / math.tau
    return f"on the spot ({quantity(turns, '', 2)} turns)"


def _numbers(record: Record, entry: Entry) -> list[str]:
    if is_regression(record):
        return [
            f"λ_min is {_number(entry['lambda_min'])}",
            f"the smallest singular value of W is {_number(entry['smallest_singular_value'])} rad",
        ]
    return precision(record, entry)


def _everyday(record: Record, entry: Entry) -> str:
    chosen = _usual(record)
    known = entry["standard_deviations"]
    parameters = [one for one in judged(record) if known.get(one["name"]) and one["nominal"]]
    if chosen is None or chosen["name"] == entry["name"] or not parameters:
        return ""
    parameter, duration = parameters[-1], duration_text(record)
    drive = f"drive in {duration}" if runs_of(record) > 1 else f"{duration} drive"
    name = parameter["name"]
    shares = [_percent(one["standard_deviations"].get(name), parameter["nominal"]) for one in (entry, chosen)]
    before = "With what was known beforehand, one" if record.data["study"].get("prior") else "One"
    everyday = words(chosen["name"])
    return (
        f"{before} {drive} gives {words(name)} to {shares[0]}; the {everyday} you would have "
        f"driven gives {shares[1]}.{_needed(record, chosen)}"
    )


def _usual(record: Record) -> Entry | None:
    # The square, which is what people drive to calibrate, or else the first everyday path that tells all.
    paths = [
        one
        for one in record.results
        if one["kind"] == "baseline" and one["feasible"] and not one["name"].startswith("random")
    ]
    order = sorted(paths, key=lambda one: (one["name"] != "square", useless(one)))
    return order[0] if order else None


def _needed(record: Record, chosen: Entry) -> str:
    repetitions, aim = repetitions_of(record, chosen), study_aim(record)
    if repetitions is None:
        return ""
    about = aim.criterion.asks_about
    told = f"tell {about} as well" if about else f"be worth as much by {aim.label}"
    if repetitions == math.inf:
        return f" No number of them would {told}."
    return f" {quantity(repetitions, '', 2)} of them would be needed to {told}."


def _percent(deviation: float | None, nominal: float) -> str:
    if deviation is None:
        return "nothing"
    return f"±{quantity(100 * deviation / abs(nominal), '%')}"


def _simulated(record: Record, entry: Entry) -> str:
    outcome = record.data["validation"] or {}
    own = [one for one in outcome.get("results", []) if one["name"] == entry["name"]]
    if len(own) == 1:
        return str(own[0]["verdict"])
    return " ".join(f"By {words(one['estimator'])}: {one['verdict']}" for one in own)


def _number(value: float | None) -> str:
    return "unbounded" if value is None else quantity(value, "", 4)


def _deviations(record: Record, entry: Entry) -> str:
    known, units = entry["standard_deviations"], deviation_units(record, entry)
    phrases = [
        _deviation(parameter, known[parameter["name"]], units[parameter["name"]])
        for parameter in record.data["parameters"]
        if parameter["name"] in known
    ]
    if not phrases:
        return "The study gives no noise, so no standard deviations are predicted."
    return f"Predicted standard deviations of one drive: {listing(phrases)}."


def _deviation(parameter: Mapping[str, Any], deviation: float | None, unit: Unit) -> str:
    name = words(parameter["name"])
    if deviation is None:
        return f"{name} cannot be told"
    size = deviation_text(deviation, parameter["unit"], unit)
    return f"{name} {size}{_share(deviation, parameter['nominal'])}"


def _share(deviation: float, nominal: float) -> str:
    return f" ({quantity(100 * deviation / abs(nominal), '%')} of nominal)" if nominal else ""


def _nothing(record: Record) -> tuple[str, ...]:
    if not record.results:
        return ("The study asked for no search and no baseline, so there is no drive to report.",)
    return ("No drive that keeps every limit was found, so there is no design to use.",)


def _failure(entry: Entry) -> str:
    return f"{entry['name']}: {entry['message']}"
