"""How well one drive tells the parameters, as predicted from what is measured and its noise."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from oed.foundation.text import fixed, listing, quantity, readable, significant, unit_text, words
from oed.records.record import Record
from oed.report.parts.measured import along_text, prior_of, prior_text, readings_text
from oed.report.parts.reading import Entry, deviation_units, is_regression, with_drive
from oed.report.parts.section import Section
from oed.report.parts.tables import Cell, Column, Table

Parameter = Mapping[str, Any]

NORMAL_95 = 1.959964
"""Standard deviations on either side of the mean that hold 95 % of a normal distribution."""

NOISE_UNITS = {"position": ("cm", 100.0), "heading": ("deg", 180.0 / math.pi)}

PLACES = {
    "increments": {"position": "per coordinate of a displacement", "heading": "per turn"},
    "absolute": {"position": "per coordinate of a pose", "heading": "per heading"},
}
"""Noise model -> block -> what its noise is of."""


def deviations(record: Record) -> Section | None:
    """The best drive parameter by parameter with their correlations, then all drives side by side."""
    title = "Predicted standard deviations"
    noisy = [parameter for parameter in record.data["parameters"] if parameter["noise"] is not None]
    entries = [entry for entry in with_drive(record) if entry["standard_deviations"]]
    if not noisy:
        text = "The study gives no noise, so none are predicted; add `noise` to its `measurement`."
        return Section(title, paragraphs=(text,))
    if not entries:
        return None
    winner = record.best or entries[0]
    correlations = _correlations(winner)
    tables = [_by_parameter(record, noisy, winner), *correlations]
    tables += [_side_by_side(record, noisy, winner, entries)] if len(entries) > 1 else []
    reading = _regression_reading(record, noisy) if is_regression(record) else _sensor_reading()
    measured = "" if is_regression(record) else readings_text(record)
    known = " ".join(filter(None, [along_text(record), prior_text(record)]))
    correlated = _correlation_reading() if correlations else ""
    return Section(
        title, paragraphs=tuple(filter(None, [reading, measured, known, correlated])), tables=tuple(tables)
    )


def _regression_reading(record: Record, noisy: list[Parameter]) -> str:
    measurement = record.data["study"]["measurement"]
    model = measurement.get("noise_model", "increments")
    noises = {parameter["block"]: parameter["noise"] for parameter in noisy}
    sizes = listing([_noise(block, noise, model) for block, noise in noises.items()])
    if record.data["study"].get("prior"):
        sizes += ", and with what was known beforehand added to the information"
    if model == "increments":
        return (
            "For one drive and one least-squares estimate, the square roots of the diagonal of σ²(W'W)⁻¹ "
            f"[Choi, eq. 18], with {sizes}. The interval assumes normal, independent noise."
        )
    if measurement.get("estimator", "gls") == "gls":
        estimate, formula = "generalised least-squares", "σ²(W'K⁻¹W)⁻¹"
    else:
        estimate, formula = "ordinary least-squares", "σ²(W'W)⁻¹W'KW(W'W)⁻¹ (the sandwich)"
    return (
        f"For one drive and one {estimate} estimate, the square roots of the diagonal of {formula}, with "
        f"{sizes}. The poses between segments are measured, so neighbouring displacements share the error of "
        "the pose between them: σ²K is the displacements' covariance. The interval assumes normal noise."
    )


def _noise(block: str, noise: float, model: str) -> str:
    unit, factor = NOISE_UNITS.get(block, ("", 1.0))
    what = PLACES[model].get(block, f"({block})")
    return f"σ = {quantity(noise * factor, unit, 4)} {what}".replace(".000 ", " ").replace(".00 ", " ")


def _sensor_reading() -> str:
    return (
        "For one drive and one least-squares estimate from all readings together, the square roots of the "
        "diagonal of F⁻¹. F = Σ J'R⁻¹J adds up over the readings, with J a reading's derivatives by "
        "everything unknown and R its noise's covariance. The interval assumes normal noise."
    )


def _correlation_reading() -> str:
    return (
        "A correlation near 1 or -1 says that the drive tells one combination of the two parameters much "
        "better than each of them."
    )


def _by_parameter(record: Record, noisy: list[Parameter], entry: Entry) -> Table:
    four, three = significant(4), significant(3)
    known, units = prior_of(record), deviation_units(record, entry)
    finer = any(units[one["name"]][0] != readable(1.0, one["unit"])[1] for one in noisy)
    columns = (
        Column("parameter"),
        Column("unit"),
        Column("nominal", "", four),
        *((Column("known beforehand to"),) if known else ()),
        *((Column("deviations in"),) if finer else ()),
        Column("standard deviation", "", three),
        Column("share of nominal", "%", three),
        Column("95 % interval: ±", "", three),
    )
    rows = []
    for parameter in noisy:
        shown, factor = units[parameter["name"]]
        before = (known.get(parameter["name"]),) if known else ()
        between = (*before, *((shown or "1",) if finer else ()))
        rows.append((*_nominal(parameter), *between, *_sizes(parameter, entry, factor)))
    return Table(columns, tuple(rows), f"Drive of {entry['name']}")


def _nominal(parameter: Parameter) -> tuple[Cell, ...]:
    nominal, unit = readable(parameter["nominal"], parameter["unit"])
    return words(parameter["name"]), unit_text(unit) or "1", nominal


def _sizes(parameter: Parameter, entry: Entry, factor: float) -> tuple[Cell, ...]:
    size, nominal = _deviation(parameter, entry), abs(parameter["nominal"])
    return size * factor, 100.0 * size / nominal if nominal else None, NORMAL_95 * size * factor


def _deviation(parameter: Parameter, entry: Entry) -> float:
    # A parameter that the drive cannot tell has an infinite deviation, which JSON holds as null.
    deviation = entry["standard_deviations"].get(parameter["name"])
    return math.inf if deviation is None else float(deviation)


def _correlations(entry: Entry) -> list[Table]:
    return [_matrix(entry, one) for one in entry.get("covariances") or [] if len(one["parameters"]) > 1]


def _matrix(entry: Entry, one: Mapping[str, Any]) -> Table:
    names = [words(name) for name in one["parameters"]]
    columns = (Column("parameter"), *(Column(name, "", fixed(3)) for name in names))
    rows = tuple((name, *_correlation_row(one["covariance"], index)) for index, name in enumerate(names))
    return Table(columns, rows, f"Correlations, drive of {entry['name']}")


def _correlation_row(covariance: list[list[float | None]], index: int) -> list[Cell]:
    # – where a parameter is not told at all.
    cells: list[Cell] = []
    for other, shared in enumerate(covariance[index]):
        own, its = covariance[index][index], covariance[other][other]
        cells.append(shared / math.sqrt(own * its) if shared is not None and own and its else None)
    return cells


def _side_by_side(record: Record, noisy: list[Parameter], winner: Entry, entries: list[Entry]) -> Table:
    units = deviation_units(record, winner)
    shown = [(parameter, *units[parameter["name"]]) for parameter in noisy]
    columns = (
        Column("result"),
        *(Column(words(parameter["name"]), unit, significant(3)) for parameter, unit, _ in shown),
    )
    rows: list[tuple[Cell, ...]] = []
    for entry in entries:
        sizes = [_deviation(parameter, entry) * factor for parameter, _, factor in shown]
        rows.append((str(entry["name"]), *sizes))
    return Table(columns, tuple(rows), "All drives")
