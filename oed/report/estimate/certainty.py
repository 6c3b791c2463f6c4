"""What the error bars rest on: the ways to a standard error, the segments, and how estimates are tied."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from oed.foundation.text import fixed, listing, significant, unit_text, words
from oed.report.estimate.numbers import error_text, known, own_unit, scaled, sized
from oed.report.estimate.reading import Data, asked, by_windows, entries, segment_text
from oed.report.parts.section import Section
from oed.report.parts.tables import Cell, Column, Table

KINDS = ("information", "sandwich", "bootstrap")
"""Ways to a covariance, the most trusting first."""
MEANINGS = {
    "information": "F⁻¹ of the fit's information F, right where the noise is white and nothing drifts",
    "sandwich": "F⁻¹MF⁻¹ with the covariance M that successive parts of the logs show",
    "bootstrap": "the spread of estimates from blocks of the logs, drawn again and again",
}
"""Way to a covariance -> what it is."""
UNEQUAL = 1.1
"""Ratio of standard errors from which on they are worth comparing in words."""


def certainty(data: Data) -> Section:
    """Standard errors side by side, segments, correlations."""
    tables = (_side_by_side(data), _segments(data), _correlations(data))
    return Section(
        "What the error bars rest on",
        paragraphs=tuple(
            filter(None, (_drift(data), " ".join(filter(None, (_used(data), _compared(data))))))
        ),
        tables=tuple(table for table in tables if table is not None),
    )


def _used(data: Data) -> str:
    kind = str(data.get("covariance_kind"))
    width = known(data.get("half_width"))
    interval = f" A 95 % interval reaches {width:.3g} of them to either side." if width else ""
    return (
        f"Standard errors are {_name(kind)}: {MEANINGS.get(kind, words(kind))}.{_why(data, kind)}{interval}"
    )


def _name(kind: str) -> str:
    return {"bootstrap": "the bootstrap's", "sandwich": "the sandwich's"}.get(
        kind, "those of the information"
    )


def _why(data: Data, kind: str) -> str:
    drifts = (data.get("segments") or {}).get("drifts")
    if asked(data, "covariance") == kind:
        return " The study asks for these."
    if kind != "information":
        return " They are taken because the logs drift, or may."
    if len(_kinds(data)) == 1:
        larger = ": take them for too small" if drifts else ""
        return f" The logs are too short for a judgement by how much their parts disagree{larger}."
    return " They are taken because the logs do not drift." if drifts is False else ""


def _drift(data: Data) -> str:
    segments = data.get("segments") or {}
    if not segments:
        return ""
    if not segments.get("chosen"):
        own = ", as the study asks" if asked(data, "segment") != "auto" else ""
        if by_windows(data):
            return f"What is fitted is the motion from end to end of {segment_text(data)}{own}."
        return f"The poses are fitted over {segment_text(data)}{own}."
    if segments.get("drifts"):
        return (
            f"The poses are fitted over {segment_text(data)}, each with a start of its own: over longer ones "
            "dead reckoning drifts, by slip or an uneven floor, beyond what the pose sensor's noise explains."
        )
    return (
        f"The poses are fitted over {segment_text(data)}: no drift shows beside the pose sensor's noise, "
        "however long the segments are."
    )


def _compared(data: Data) -> str:
    kind = str(data.get("covariance_kind"))
    pairs = [(_error(one, kind), _error(one, "information")) for one in entries(data, "parameters")]
    ratios = [own / other for own, other in pairs if own and other and math.isfinite(own / other)]
    if kind == "information" or not ratios or max(ratios) < UNEQUAL:
        return ""
    low, high = f"{min(ratios):.2g}", f"{max(ratios):.2g}"
    times = low if low == high else f"{low} to {high}"
    return f"They are {times} times those that F⁻¹ would promise."


def _error(one: Mapping[str, Any], kind: str) -> float | None:
    return known((one.get("standard_errors") or {}).get(kind))


def _kinds(data: Data) -> list[str]:
    told = {kind for one in entries(data, "parameters") for kind in one.get("standard_errors") or {}}
    return [kind for kind in KINDS if kind in told] + sorted(told - set(KINDS))


def _side_by_side(data: Data) -> Table | None:
    kinds, used = _kinds(data), data.get("covariance_kind")
    if len(kinds) < 2:
        return None
    titles = [f"{kind} (used)" if kind == used else kind for kind in kinds]
    columns = (
        Column("parameter"),
        Column("unit"),
        *(Column(title, "", significant(2)) for title in titles),
    )
    rows = tuple(_errors(one, kinds) for one in entries(data, "parameters"))
    return Table(columns, rows, "Standard errors")


def _errors(one: Mapping[str, Any], kinds: list[str]) -> tuple[Cell, ...]:
    unit, factor = own_unit(str(one.get("unit") or ""))
    sizes = [error_text(_error(one, kind), factor) for kind in kinds]
    return words(str(one["name"])), unit_text(unit) or "1", *sizes


def _segments(data: Data) -> Table | None:
    segments = data.get("segments") or {}
    tried = list(segments.get("tried") or [])
    if len(tried) < 2:
        return None
    abouts = [key for key in tried[0] if key != "seconds"]
    measures = [_measured(about, tried) for about in abouts]
    columns = (
        Column("segments"),
        *(column for column, _ in measures),
        Column("variance over the shortest's", "", fixed(2)),
        Column("chosen"),
    )
    rows = tuple(
        (
            _length(one),
            *(scaled(known(one.get(about)), measures[place][1]) for place, about in enumerate(abouts)),
            _growth(one, tried[0], abouts),
            "chosen" if known(one["seconds"]) == known(segments.get("seconds")) else "",
        )
        for one in tried
    )
    return Table(columns, rows, "Size of the residuals (RMS) by the length of the segments")


def _measured(about: str, tried: list[Mapping[str, Any]]) -> tuple[Column, float]:
    unit = "m" if about == "position" else "rad"
    return sized(words(about), [known(one.get(about)) for one in tried], unit)


def _length(one: Mapping[str, Any]) -> str:
    seconds = known(one["seconds"])
    return "whole logs" if seconds is None or math.isinf(seconds) else f"{seconds:.3g} s"


def _growth(one: Mapping[str, Any], first: Mapping[str, Any], abouts: list[str]) -> float | None:
    pairs = [(known(one.get(about)), known(first.get(about))) for about in abouts]
    ratios = [(size / shortest) ** 2 for size, shortest in pairs if size is not None and shortest]
    return max(ratios, default=None)


def _correlations(data: Data) -> Table | None:
    names = [words(str(one["name"])) for one in entries(data, "parameters")]
    matrix = data.get("correlation") or []
    if len(names) < 2 or len(matrix) < len(names):
        return None
    columns = (Column(""), *(Column(name, "", fixed(2)) for name in names[:-1]))
    rows = tuple(
        (name, *(known(matrix[row][column]) if column < row else "" for column in range(len(names) - 1)))
        for row, name in enumerate(names)
        if row
    )
    strongest = _strongest(names, matrix)
    return Table(columns, rows, f"Correlations{strongest}")


def _strongest(names: list[str], matrix: Any) -> str:
    pairs = [(row, column) for row in range(len(names)) for column in range(row)]
    sizes = {pair: abs(known(matrix[pair[0]][pair[1]]) or 0.0) for pair in pairs}
    row, column = max(pairs, key=lambda pair: sizes[pair])
    if len(pairs) == 1 or sizes[row, column] < 0.5:
        return ""
    return f", strongest between {listing([names[column], names[row]])}"
