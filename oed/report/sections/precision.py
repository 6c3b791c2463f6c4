"""How well one drive tells the parameters, as predicted from what is measured and its noise."""

from __future__ import annotations

import math
from collections.abc import Sequence

from oed.foundation.text import DEGREES, fixed, readable, significant, unit_text, words
from oed.records.record import Record
from oed.records.stored.result import Covariance, Result
from oed.records.stored.study_record import StoredParameter
from oed.report.parts.prose import Prose
from oed.report.parts.reading import (
    nuisance_text,
    prior_of,
    prior_text,
    readings_text,
    regression_of,
    shown_units,
    with_drive,
)
from oed.report.parts.section import Section
from oed.report.parts.tables import Cell, Column, Table

SAY = Prose("precision")
THREE, FOUR = significant(3), significant(4)
NORMAL_95 = 1.959964
"""Standard deviations on either side of the mean that hold 95 % of a normal distribution."""


def precision(record: Record) -> Section | None:
    """The best drive parameter by parameter with their correlations, then all drives side by side."""
    title = "Predicted standard deviations"
    noisy = [one for one in record.parameters if one.noise is not None]
    results = [one for one in with_drive(record) if one.standard_deviations]
    if not noisy:
        return Section(title, paragraphs=(SAY("no_noise"),))
    if not results:
        return None
    winner = record.best or results[0]
    correlations = [_matrix(winner, one) for one in winner.covariances if len(one.parameters) > 1]
    tables = [_by_parameter(record, noisy, winner), *correlations]
    tables += [_side_by_side(record, noisy, winner, results)] if len(results) > 1 else []
    paragraphs = SAY.paragraphs(
        "reading",
        regression_of(record),
        list({one.block: _noise(one) for one in noisy}.items()),
        record.study.prior,
        readings_text(record),
        (nuisance_text(record), prior_text(record)),
        bool(correlations),
    )
    return Section(title, paragraphs=paragraphs, tables=tuple(tables))


def _noise(parameter: StoredParameter) -> tuple[float, str]:
    # Of the displacements: positions in cm, turns in deg.
    noise = parameter.noise or 0.0
    shown = {"position": (100 * noise, "cm"), "heading": (DEGREES * noise, "deg")}
    return shown.get(parameter.block, (noise, ""))


def _by_parameter(record: Record, noisy: Sequence[StoredParameter], result: Result) -> Table:
    known, units = prior_of(record), shown_units(record, result.standard_deviations)
    finer = any(units[one.name][0] != readable(1.0, one.unit)[1] for one in noisy)
    columns = (
        Column("parameter"),
        Column("unit"),
        Column("nominal", "", FOUR),
        *((Column("known beforehand to"),) if known else ()),
        *((Column("deviations in"),) if finer else ()),
        Column("standard deviation", "", THREE),
        Column("share of nominal", "%", THREE),
        Column("95 % interval: ±", "", THREE),
    )
    rows: list[tuple[Cell, ...]] = []
    for one in noisy:
        (nominal, unit), (shown, factor) = readable(one.nominal, one.unit), units[one.name]
        size = _deviation(one, result)
        rows.append(
            (
                words(one.name),
                unit_text(unit) or "1",
                nominal,
                *((known.get(one.name),) if known else ()),
                *((shown or "1",) if finer else ()),
                size * factor,
                100.0 * size / abs(one.nominal) if one.nominal else None,
                NORMAL_95 * size * factor,
            )
        )
    return Table(columns, tuple(rows), f"Drive of {result.name}")


def _deviation(parameter: StoredParameter, result: Result) -> float:
    # A parameter that the drive cannot tell has an infinite deviation, which JSON holds as null.
    deviation = result.standard_deviations.get(parameter.name)
    return math.inf if deviation is None else deviation


def _matrix(result: Result, one: Covariance) -> Table:
    names = [words(name) for name in one.parameters]
    columns = (Column("parameter"), *(Column(name, "", fixed(3)) for name in names))
    rows = tuple((name, *_correlations(one.covariance, index)) for index, name in enumerate(names))
    return Table(columns, rows, f"Correlations, drive of {result.name}")


def _correlations(covariance: Sequence[Sequence[float | None]], index: int) -> list[Cell]:
    # – where a parameter is not told at all.
    cells: list[Cell] = []
    for other, shared in enumerate(covariance[index]):
        own, its = covariance[index][index], covariance[other][other]
        cells.append(shared / math.sqrt(own * its) if shared is not None and own and its else None)
    return cells


def _side_by_side(
    record: Record, noisy: Sequence[StoredParameter], winner: Result, results: Sequence[Result]
) -> Table:
    units = shown_units(record, winner.standard_deviations)
    columns = (Column("result"), *(Column(words(one.name), units[one.name][0], THREE) for one in noisy))
    rows: tuple[tuple[Cell, ...], ...] = tuple(
        (result.name, *(_deviation(one, result) * units[one.name][1] for one in noisy)) for result in results
    )
    return Table(columns, rows, "All drives")
