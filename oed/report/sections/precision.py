"""How precise estimates from one drive are, as predicted from what is measured and its noise."""

from __future__ import annotations

import math
from collections.abc import Sequence

from oed.foundation.text import error_text, fixed, given_text, nominal_text, unit_text, words
from oed.records.record import Record
from oed.records.stored.result import Covariance, Result
from oed.records.stored.study_record import StoredParameter
from oed.report.parts.prose import Prose
from oed.report.parts.reading import (
    called,
    nuisance_text,
    prior_of,
    prior_text,
    readings_text,
    regression_of,
    with_drive,
)
from oed.report.parts.section import Column, Section, Table

SAY = Prose("precision")
NORMAL_95 = 1.959964
"""Standard deviations on either side of the mean that hold 95 % of a normal distribution."""


def precision(record: Record) -> Section | None:
    """The best drive parameter by parameter with their correlations, then all drives side by side."""
    title = "Predicted standard deviations"
    noisy = [one for one in record.parameters if one.noise is not None]
    results = [one for one in with_drive(record) if one.standard_deviations]
    if not noisy:
        return Section.of(title, SAY("no_noise"))
    if not any(one.feasible for one in results):
        return None
    winner = record.best or results[0]
    correlations = [
        _matrix(one, called(record, winner)) for one in winner.covariances if len(one.parameters) > 1
    ]
    said = SAY.paragraphs(
        "reading",
        regression_of(record),
        list({one.block: _noise(one) for one in noisy}.items()),
        record.study.prior,
        readings_text(record),
        (nuisance_text(record), prior_text(record)),
        bool(correlations),
    )
    every = _side_by_side(record, noisy, results) if len(results) > 1 else None
    return Section.of(title, *said, _by_parameter(record, noisy, winner), *correlations, every)


def _noise(parameter: StoredParameter) -> str:
    # Of the displacements: positions, or turns.
    unit = {"position": "m", "heading": "rad"}.get(parameter.block, "")
    return given_text(parameter.noise or 0.0, unit)


def _by_parameter(record: Record, noisy: Sequence[StoredParameter], result: Result) -> Table:
    known = prior_of(record)

    def factor(one: StoredParameter) -> float:
        return record.shown_unit(one.name, one.unit)[1]

    def size(one: StoredParameter) -> float:
        return _deviation(one, result) * factor(one)

    def share(one: StoredParameter) -> float | None:
        return 100.0 * _deviation(one, result) / abs(one.nominal) if one.nominal else None

    columns = (
        Column("parameter", cell=lambda one: words(one.name)),
        Column("unit", cell=lambda one: unit_text(record.shown_unit(one.name, one.unit)[0]) or "1"),
        Column("nominal", "", nominal_text, lambda one: one.nominal * factor(one)),
        Column("prior: ±", cell=lambda one: known.get(one.name)) if known else None,
        Column("standard deviation", "", error_text, size),
        Column("share of nominal", "%", error_text, share),
        Column("95 % interval: ±", "", error_text, lambda one: NORMAL_95 * size(one)),
    )
    return Table.of(noisy, columns, called(record, result))


def _deviation(parameter: StoredParameter, result: Result) -> float:
    # A parameter that is not identifiable has an infinite deviation, which JSON holds as null.
    deviation = result.standard_deviations.get(parameter.name)
    return math.inf if deviation is None else deviation


def _matrix(one: Covariance, drive: str) -> Table:
    def column(at: int, name: str) -> Column:
        # – where a parameter is not identifiable.
        def correlation(other: int) -> float | None:
            shared, own, its = (
                one.covariance[row][of] for row, of in ((other, at), (other, other), (at, at))
            )
            return shared / math.sqrt(own * its) if shared is not None and own and its else None

        return Column(words(name), "", fixed(3), correlation)

    first = Column("parameter", cell=lambda at: words(one.parameters[at]))
    columns = (first, *(column(at, name) for at, name in enumerate(one.parameters)))
    return Table.of(range(len(one.parameters)), columns, f"Correlations: {drive}")


def _side_by_side(record: Record, noisy: Sequence[StoredParameter], results: Sequence[Result]) -> Table:
    def column(one: StoredParameter) -> Column:
        unit, factor = record.shown_unit(one.name, one.unit)
        return Column(words(one.name), unit, error_text, lambda result: _deviation(one, result) * factor)

    columns = (Column("drive", cell=lambda result: called(record, result)), *map(column, noisy))
    return Table.of(results, columns, "All drives")
