"""How well one drive tells the parameters, as predicted from its regressor and the noise."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from oed.record import Record
from oed.report.reading import Entry, with_drive
from oed.report.section import Section
from oed.report.tables import Cell, Column, Table, significant
from oed.report.wording import listing, quantity, readable, unit_text

NORMAL_95 = 1.959964
"""Standard deviations on either side of the mean that hold 95 % of a normal distribution."""

NOISE_UNITS = {"position": ("cm", 100.0), "heading": ("deg", 180.0 / math.pi)}


def deviations(record: Record) -> Section | None:
    """The best drive parameter by parameter, then all drives side by side."""
    title = "Predicted standard deviations"
    noisy = [parameter for parameter in record.data["parameters"] if parameter["noise"] is not None]
    entries = [entry for entry in with_drive(record) if entry["standard_deviations"]]
    if not noisy:
        text = "The study gives no noise, so none are predicted; add `noise` to its `measurement`."
        return Section(title, paragraphs=(text,))
    if not entries:
        return None
    tables = [_by_parameter(noisy, record.best or entries[0])]
    tables += [_side_by_side(noisy, entries)] if len(entries) > 1 else []
    return Section(title, paragraphs=(_reading(noisy),), tables=tuple(tables))


def _reading(noisy: list[Mapping[str, Any]]) -> str:
    noises = {parameter["block"]: parameter["noise"] for parameter in noisy}
    phrases = [_noise(block, noise) for block, noise in noises.items()]
    return (
        "For one drive and one least-squares estimate, the square roots of the diagonal of σ²(W'W)⁻¹ "
        f"[Choi, eq. 18], with {listing(phrases)}. The interval assumes normal, independent noise."
    )


def _noise(block: str, noise: float) -> str:
    unit, factor = NOISE_UNITS.get(block, ("", 1.0))
    what = {"position": "per coordinate of a displacement", "heading": "per turn"}.get(block, f"({block})")
    return f"σ = {quantity(noise * factor, unit, 4)} {what}".replace(".000 ", " ").replace(".00 ", " ")


def _by_parameter(noisy: list[Mapping[str, Any]], entry: Entry) -> Table:
    four, three = significant(4), significant(3)
    columns = (
        Column("parameter"),
        Column("unit"),
        Column("nominal", "", four),
        Column("standard deviation", "", three),
        Column("share of nominal", "%", three),
        Column("95 % interval: ±", "", three),
    )
    return Table(columns, tuple(_row(parameter, entry) for parameter in noisy), f"Drive of {entry['name']}")


def _row(parameter: Mapping[str, Any], entry: Entry) -> tuple[Cell, ...]:
    nominal, unit = readable(parameter["nominal"], parameter["unit"])
    deviation = _shown(parameter, entry)
    share = 100.0 * deviation / abs(nominal) if nominal else None
    return (
        parameter["name"],
        unit_text(unit) or "1",
        nominal,
        deviation,
        share,
        NORMAL_95 * deviation,
    )


def _shown(parameter: Mapping[str, Any], entry: Entry) -> float:
    # A parameter that the drive cannot tell has an infinite deviation, which JSON holds as null.
    deviation = entry["standard_deviations"].get(parameter["name"])
    return math.inf if deviation is None else readable(deviation, parameter["unit"])[0]


def _side_by_side(noisy: list[Mapping[str, Any]], entries: list[Entry]) -> Table:
    columns = [Column("result")]
    columns += [
        Column(parameter["name"], readable(1.0, parameter["unit"])[1], significant(3)) for parameter in noisy
    ]
    return Table(tuple(columns), tuple(_line(noisy, entry) for entry in entries), "All drives")


def _line(noisy: list[Mapping[str, Any]], entry: Entry) -> tuple[Cell, ...]:
    return (str(entry["name"]), *(_shown(parameter, entry) for parameter in noisy))
