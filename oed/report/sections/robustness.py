"""What becomes of drives when the robot is another than the nominal one, and what keeping limits costs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from oed.foundation.text import fixed, given_text, listing, quantity, significant, whole, words
from oed.kernel.solution import NOMINAL
from oed.records.record import Record
from oed.report.figures.driven import Bundle, poses_of
from oed.report.parts.judging import study_aim
from oed.report.parts.rooms import Room, room_of
from oed.report.parts.section import Picture, Section
from oed.report.parts.tables import Cell, Column, Table
from oed.robots.limits import EndHeading, EndPosition

Entry = Mapping[str, Any]

KINDS = {
    "chance": "every limit on the path is kept with some standard deviations of its distance in reserve",
    "tube": "every limit on the path is kept with the farthest in reserve that its distance moves, to first "
    "order, within all ranges together",
    "scenarios": "every limit on the path is kept by the robots at the corners of the ranges as well",
}
OBJECTIVES = {
    "nominal": "",
    "mean": " The objective is the criterion's mean over robots of this uncertainty.",
    "worst": " The objective is the criterion of the worst of the robots at the ends of these ranges.",
}


def robustness(record: Record) -> Section | None:
    """How likely a robot is to leave the limits on each drive, by simulation, and the price of that."""
    data = record.data.get("robustness")
    if not data or not data["results"]:
        return None
    sentences = filter(None, [_uncertain(data), _ends(record), _verdict(data), _cost(record, data)])
    return Section(
        "Robots other than the nominal one",
        paragraphs=tuple(sentences),
        figures=_figures(record, data),
        tables=(_table(record, data),),
    )


def _uncertain(data: Entry) -> str:
    ranges = listing([_range(entry) for entry in data["uncertain"]])
    return (
        f"The robot may differ: {ranges}. So {KINDS[data['kind']]}, and a drive counts only if at most "
        f"{_percent(1 - data['confidence'])} of simulated robots, all given the same commands, leave any of "
        f"these limits ({listing([words(name) for name in data['limits']])}) at any time."
        f"{OBJECTIVES[data['objective']]}"
    )


def _ends(record: Record) -> str:
    # Where every robot ends cannot be asked for: nothing corrects it on its way.
    given = record.study.limits
    ends = [words(name) for name in (EndPosition.name, EndHeading.name) if getattr(given, name, None)]
    return f"The {listing(ends)} asked for is that of the nominal robot." if ends else ""


def _percent(share: float) -> str:
    return f"{100 * share:.3g} %"


def _amount(value: float, unit: str) -> str:
    return given_text(value, unit) if unit else f"{value:.3g}"


def _range(entry: Entry) -> str:
    name, unit = words(entry["name"]), entry["unit"]
    below, above = entry["nominal"] - entry["low"], entry["high"] - entry["nominal"]
    if abs(above - below) > 1e-9 * (above + below):
        return f"{name} {_amount(entry['low'], unit)} to {_amount(entry['high'], unit)}"
    share = f" ({100 * above / abs(entry['nominal']):.3g} % of nominal)" if entry["nominal"] else ""
    spread = "" if entry["uniform"] else " (standard deviation)"
    return f"{name} ± {_amount(above, unit)}{share}{spread}"


def _verdict(data: Entry) -> str:
    kept = [entry for entry in data["results"] if entry["reserve"] is not None]
    if not kept:
        return "No search ended with a drive that enough robots keep to the limits."
    return " ".join(_outcome(data, entry) for entry in kept)


def _outcome(data: Entry, entry: Entry) -> str:
    low, high = entry["interval"]
    reserve = f"{entry['reserve']:.2f} standard deviations in reserve" if data["kind"] == "chance" else ""
    added = f"{entry['kept']} of the worst robots added" if entry["kept"] else ""
    how = listing([part for part in (reserve, added) if part])
    return (
        f"On {entry['name']}{f', with {how},' if how else ''} {entry['probability']:.2%} of {entry['draws']} "
        f"robots leave the limits (95 % interval {low:.2%} to {high:.2%}).{_points(entry)}"
    )


def _points(entry: Entry) -> str:
    # Limits that other robots were not checked against at all times.
    points = listing([words(name) for name in entry.get("checked_at_points") or ()])
    return f" Of {points} this was checked at points only: between them more may leave." if points else ""


def _cost(record: Record, data: Entry) -> str:
    plain = next((entry for entry in data["results"] if entry["name"] == NOMINAL), None)
    best = record.best
    if plain is None or best is None or plain["objective"] is None or best["objective"] is None:
        return ""
    share = study_aim(record).efficiency(float(best["objective"]), float(plain["objective"]))
    if share is None:
        return ""
    return (
        f"What it costs: {best['name']} is worth {share:.1%} of {NOMINAL}, the design found with nothing in "
        f"reserve. On that one {plain['probability']:.1%} of the robots leave the limits; the worst "
        f"{_beyond(plain)}."
    )


def _beyond(entry: Entry) -> str:
    if entry["farthest"] is None:
        return "has no finite path"
    return f"is beyond by {entry['farthest']:.2g} times the limit's size"


def _table(record: Record, data: Entry) -> Table:
    aim = study_aim(record)
    columns = (
        Column("result"),
        Column(f"objective, {aim.number}", form=significant(4)),
        Column("robots that leave", "%", fixed(2)),
        Column("95 % interval", "%"),
        Column("farthest beyond", "% of the limit", fixed(1)),
        Column("draws", form=whole),
    )
    return Table(columns, tuple(_row(entry) for entry in data["results"]), "Robots that leave the limits")


def _row(entry: Entry) -> tuple[Cell, ...]:
    low, high = (f"{100 * end:.2f}" for end in entry["interval"])
    share = 100 * entry["probability"]
    return (
        entry["name"],
        entry["objective"],
        share,
        f"{low} to {high}",
        None if entry["farthest"] is None else 100 * entry["farthest"],
        entry["draws"],
    )


def _figures(record: Record, data: Entry) -> tuple[Picture, ...]:
    cases = [_bundle(record, data, one) for one in data["bundles"]]
    if not cases:
        return ()
    count = len(data["bundles"][0]["leaves"])
    caption = (
        f"Where {count} robots drawn from the uncertainty go when they are given the same commands; dashed "
        "are those that leave the limits."
    )
    alt = "Bundles of the paths that may happen, " + listing([case.title for case in cases])
    return (Picture("bundles", alt, caption, partial(_draw, cases, room_of(record))),)


def _bundle(record: Record, data: Entry, bundle: Entry) -> Bundle:
    entry = next(one for one in data["results"] if one["name"] == bundle["name"])
    result = record.result(bundle["name"])
    assert result is not None
    inside, outside = list[Any](), list[Any]()
    for runs, leaves in zip(bundle["paths"], bundle["leaves"], strict=True):
        (outside if leaves else inside).extend(np.array(path) for path in runs)
    return Bundle(
        f"{bundle['name']}: {_share(entry)} leave",
        tuple(inside),
        tuple(outside),
        tuple(poses[:, :2] for poses in poses_of(result)),
    )


def _share(entry: Entry) -> str:
    # None of so many is no proof that there is none.
    if not entry["probability"]:
        return f"less than {quantity(100 * entry['interval'][1], '%', 1)}"
    return quantity(100 * entry["probability"], "%", 2)


def _draw(cases: Sequence[Bundle], room: Room) -> Any:
    from oed.report.figures import path_panels

    return path_panels.bundles(cases, room)
