"""The promised precision against simulated experiments."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from oed.record import Record
from oed.report.reading import Cloud
from oed.report.section import Picture, Section
from oed.report.tables import Cell, Column, Table, fixed, significant
from oed.report.wording import readable

MOST_CLOUDS = 4
"""Results whose estimates are drawn."""

HEADINGS = {
    "known": "with the true headings, for which the formula is made",
    "predicted": "with the headings that the first stage predicts, as in the paper",
    "measured": "with a noisy heading measured at every sample and taken as it is",
    "corrected": "with a noisy heading measured at every sample, corrected for errors in variables",
}


def validation(record: Record) -> Section | None:
    """Verdict, tests of the best drive, estimates with their ellipses, and all drives side by side."""
    outcome = record.data["validation"]
    if outcome is None or not outcome["results"]:
        return None
    best = record.best
    entries = outcome["results"]
    chosen = next((one for one in entries if best is not None and one["name"] == best["name"]), entries[0])
    intro = (
        f"Each drive was simulated {outcome['replicates']} times with the study's noise; each time the "
        "coefficients were estimated by two-stage least squares [Choi, eqs 12, 16] "
        f"{HEADINGS[outcome['heading']]}. The promise is σ²(W'W)⁻¹ [Choi, eq. 18]."
    )
    return Section(
        "Validation by simulation",
        paragraphs=(intro, f"{chosen['name']}: {chosen['verdict']}"),
        figures=_figures(record, entries, chosen),
        tables=(_checks(chosen, outcome["alpha"]), _side_by_side(record, entries)),
    )


def _checks(entry: Mapping[str, Any], alpha: float) -> Table:
    columns = (
        Column("test"),
        Column("question"),
        Column("found", "", significant(4)),
        Column("expected from", "", significant(4)),
        Column("to", "", significant(4)),
        Column("p-value", "", significant(2)),
        Column("passed"),
    )
    rows = tuple(
        (
            check["name"],
            check["question"],
            float(check["statistic"]),
            float(check["expected"][0]),
            float(check["expected"][1]),
            float(check["p_value"]),
            bool(check["passed"]),
        )
        for check in entry["checks"]
    )
    caption = f"Tests of {entry['name']}, judged together: a right formula fails with probability {alpha:g}"
    return Table(columns, rows, caption)


def _side_by_side(record: Record, entries: list[Mapping[str, Any]]) -> Table:
    units = {parameter["name"]: parameter["unit"] for parameter in record.data["parameters"]}
    columns = (
        Column("result"),
        Column("parameter"),
        Column("unit"),
        Column("true", "", significant(4)),
        Column("mean estimate", "", significant(4)),
        Column("promised deviation", "", significant(3)),
        Column("simulated deviation", "", significant(3)),
        Column("variance, simulated/promised", "", fixed(3)),
        Column("± (paired)", "", significant(1)),
        Column("all tests passed"),
    )
    rows = [
        _row(entry, index, units[name]) for entry in entries for index, name in enumerate(entry["parameters"])
    ]
    return Table(columns, tuple(rows), "All drives that tell the parameters apart")


def _row(entry: Mapping[str, Any], index: int, unit: str) -> tuple[Cell, ...]:
    def shown(value: float) -> float:
        return readable(value, unit)[0]

    return (
        str(entry["name"]),
        str(entry["parameters"][index]),
        readable(1.0, unit)[1] or "1",
        shown(entry["true"][index]),
        shown(entry["mean"][index]),
        shown(entry["promised_covariance"][index][index] ** 0.5),
        shown(entry["sampled_covariance"][index][index] ** 0.5),
        float(entry["paired_variance_ratio"][index]),
        float(entry["paired_standard_error"][index]),
        bool(entry["passed"]),
    )


def _figures(
    record: Record, entries: list[Mapping[str, Any]], chosen: Mapping[str, Any]
) -> tuple[Picture, ...]:
    # The design first, then the others as they come, all on one scale per pair of parameters.
    others = [entry for entry in entries if entry is not chosen and "same_length" not in entry["name"]]
    drawn = [chosen, *others][:MOST_CLOUDS]
    pairs = [
        pair
        for pair in (("c21", "c22"), ("c11", "c12"))
        if all(name in chosen["parameters"] for name in pair)
    ]
    return tuple(_picture(record, drawn, pair) for pair in pairs)


def _picture(record: Record, drawn: list[Mapping[str, Any]], pair: tuple[str, str]) -> Picture:
    clouds = [_cloud(record, entry, pair) for entry in drawn]
    caption = (
        f"Estimates of {pair[0]} and {pair[1]} from the first simulated experiments (dots), the true values "
        "(cross), and the ellipses that should hold 95 %: promised (solid) and simulated (dashed)."
    )
    alt = f"Simulated estimates of {pair[0]} and {pair[1]} with 95 % ellipses"
    return Picture(f"estimates_{pair[0]}_{pair[1]}", alt, caption, partial(_draw, clouds))


def _cloud(record: Record, entry: Mapping[str, Any], pair: tuple[str, str]) -> Cloud:
    units = {parameter["name"]: parameter["unit"] for parameter in record.data["parameters"]}
    indices = [entry["parameters"].index(name) for name in pair]
    factor, unit = readable(1.0, units[pair[0]])
    picked = np.ix_(indices, indices)
    return Cloud(
        title=str(entry["name"]),
        labels=tuple(f"{name} [{unit}]" if unit else name for name in pair),
        points=factor * np.array(entry["estimates"])[:, indices],
        true=factor * np.array(entry["true"])[indices],
        promised=factor**2 * np.array(entry["promised_covariance"])[picked],
        sampled=factor**2 * np.array(entry["sampled_covariance"])[picked],
    )


def _draw(clouds: Any) -> Any:
    from oed.report import panels

    return panels.clouds(clouds)
