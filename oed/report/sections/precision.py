"""How precise estimates from one drive are, as predicted from what is measured and its noise."""

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

    def size(one: StoredParameter) -> float:
        return _deviation(one, result) * units[one.name][1]

    def share(one: StoredParameter) -> float | None:
        return 100.0 * _deviation(one, result) / abs(one.nominal) if one.nominal else None

    columns = (
        Column("parameter", cell=lambda one: words(one.name)),
        Column("unit", cell=lambda one: unit_text(readable(1.0, one.unit)[1]) or "1"),
        Column("nominal", "", FOUR, lambda one: readable(one.nominal, one.unit)[0]),
        Column("prior: ±", cell=lambda one: known.get(one.name)) if known else None,
        Column("deviations in", cell=lambda one: units[one.name][0] or "1") if finer else None,
        Column("standard deviation", "", THREE, size),
        Column("share of nominal", "%", THREE, share),
        Column("95 % interval: ±", "", THREE, lambda one: NORMAL_95 * size(one)),
    )
    return Table.of(noisy, columns, f"Drive of {result.name}")


def _deviation(parameter: StoredParameter, result: Result) -> float:
    # A parameter that is not identifiable has an infinite deviation, which JSON holds as null.
    deviation = result.standard_deviations.get(parameter.name)
    return math.inf if deviation is None else deviation


def _matrix(result: Result, one: Covariance) -> Table:
    names = [words(name) for name in one.parameters]
    columns = (Column("parameter"), *(Column(name, "", fixed(3)) for name in names))
    rows = tuple((name, *_correlations(one.covariance, index)) for index, name in enumerate(names))
    return Table(columns, rows, f"Correlations, drive of {result.name}")


def _correlations(covariance: Sequence[Sequence[float | None]], index: int) -> list[Cell]:
    # – where a parameter is not identifiable.
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
