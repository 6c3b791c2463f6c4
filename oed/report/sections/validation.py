"""The promised precision against simulated experiments: tests, and estimates with their ellipses."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from oed.foundation.text import Unit, fixed, readable, significant, unit_text, words
from oed.records.record import Record
from oed.records.stored.simulation import Simulated
from oed.report.figures.spec import Axis
from oed.report.figures.spread import Cloud
from oed.report.figures.spread import clouds as cloud_figure
from oed.report.parts.prose import Prose
from oed.report.parts.reading import nuisance_names, regression_of, shown_units
from oed.report.parts.section import Picture, Section
from oed.report.parts.tables import Cell, Column, Table

SAY = Prose("validation")
FOUR, THREE = significant(4), significant(3)
ROUNDING = 1e-9
"""Standard error of a ratio of variances below which it is that of rounding."""
MOST_CLOUDS = 4
"""Results whose estimates are drawn."""
MOST_PAIRS = 3
"""Pairs of parameters that are drawn."""
COEFFICIENTS = (("c21", "c22"), ("c11", "c12"))
"""Pairs of the coefficient matrix, whose rows are estimated together."""


def validation(record: Record) -> Section | None:
    """Verdict, tests of the best drive, estimates with their ellipses, and all drives side by side."""
    outcome = record.validation
    if outcome is None or not outcome.results:
        return None
    every, name = outcome.results, None if record.best is None else record.best.name
    chosen = [one for one in every if one.name == name] or every[:1]
    estimators = list(dict.fromkeys(one.estimator for one in every))
    several = len(estimators) > 1
    names, prior = nuisance_names(record), record.study.prior
    intro = SAY("intro", outcome, regression_of(record), estimators, names, prior)
    verdicts = [f"{_titled(one, several)}: {one.verdict}" for one in chosen]
    tables = [_checks(one, outcome.alpha, several) for one in chosen]
    return Section(
        "Validation by simulation",
        paragraphs=(intro, *verdicts),
        figures=clouds(record, every, chosen, several),
        tables=(*tables, _side_by_side(record, every, chosen[0], several)),
    )


def _titled(one: Simulated, several: bool) -> str:
    return f"{one.name} by {words(one.estimator)}" if several else one.name


def _checks(simulated: Simulated, alpha: float, several: bool) -> Table:
    columns = (
        Column("test"),
        Column("question"),
        Column("found", "", FOUR),
        Column("expected from", "", FOUR),
        Column("to", "", FOUR),
        Column("p-value", "", significant(2)),
        Column("passed"),
    )
    rows: tuple[tuple[Cell, ...], ...] = tuple(
        (one.name, one.question, one.statistic, *one.expected, one.p_value, one.passed)
        for one in simulated.checks
    )
    lucky = any(
        one.passed and not one.expected[0] <= one.statistic <= one.expected[1] for one in simulated.checks
    )
    return Table(columns, rows, SAY("checks", _titled(simulated, several), alpha, lucky))


def _units(record: Record, simulated: Simulated) -> dict[str, Unit]:
    # In which deviations are shown: as suits one simulated drive.
    sizes = np.sqrt(np.diag(simulated.promised_covariance)).tolist()
    return shown_units(record, dict(zip(simulated.parameters, sizes, strict=True)))


def _finer(record: Record, shown: dict[str, Unit], name: str) -> bool:
    # Whether a parameter's deviations are shown in another unit than itself.
    units = {one.name: one.unit for one in record.parameters}
    return shown[name][0] != readable(1.0, units[name])[1]


def _side_by_side(record: Record, every: Sequence[Simulated], chosen: Simulated, several: bool) -> Table:
    shown = _units(record, chosen)
    finer = any(_finer(record, shown, name) for name in chosen.parameters)
    columns = (
        Column("result"),
        *((Column("estimator"),) if several else ()),
        Column("parameter"),
        Column("unit"),
        Column("true", "", FOUR),
        Column("mean estimate", "", FOUR),
        *((Column("deviations in"),) if finer else ()),
        Column("promised deviation", "", THREE),
        Column("simulated deviation", "", THREE),
        Column("variance, simulated/promised", "", fixed(3)),
        # What rounding alone leaves is nothing.
        Column("± (paired)", "", lambda size: significant(1)(size if size > ROUNDING else 0.0)),
        Column("all tests passed"),
    )
    rows = tuple(row for one in every for row in _rows(record, one, shown, finer, several))
    return Table(columns, rows, "All drives that tell the parameters apart")


def _rows(
    record: Record, one: Simulated, shown: dict[str, Unit], finer: bool, several: bool
) -> Iterator[tuple[Cell, ...]]:
    units = {parameter.name: parameter.unit for parameter in record.parameters}
    for at, name in enumerate(one.parameters):
        unit, factor = shown[name]
        yield (
            one.name,
            *((words(one.estimator),) if several else ()),
            *_means(one, at, units[name]),
            *((unit or "1",) if finer else ()),
            factor * math.sqrt(one.promised_covariance[at][at]),
            factor * math.sqrt(one.sampled_covariance[at][at]),
            one.paired_variance_ratio[at],
            one.paired_standard_error[at],
            one.passed,
        )


def _means(one: Simulated, at: int, unit: str) -> tuple[Cell, ...]:
    # As many digits as show an estimate that is off by a hundredth of its deviation.
    scale, shown = readable(1.0, unit)
    hundredth = scale * math.sqrt(one.promised_covariance[at][at]) / 100.0
    write = fixed(max(0, math.ceil(-math.log10(hundredth))) if hundredth > 0 else 4)
    true, mean = write(scale * one.true[at]), write(scale * one.mean[at])
    return words(one.parameters[at]), unit_text(shown) or "1", true, mean


def clouds(
    record: Record, every: Sequence[Simulated], chosen: Sequence[Simulated], several: bool
) -> tuple[Picture, ...]:
    """A figure for each pair of parameters: the design by every estimator first, then other drives.

    All panels of a figure are on one scale.
    """
    others = [
        one
        for one in every
        if not any(one is other for other in chosen)
        and "same_length" not in one.name
        and one.estimator == chosen[0].estimator
    ]
    drawn, names = [*chosen, *others][:MOST_CLOUDS], chosen[0].parameters
    known = [pair for pair in COEFFICIENTS if set(pair) <= set(names)]
    pairs = known or list(pairwise(names))[:MOST_PAIRS]
    return tuple(_picture(record, drawn, pair, several) for pair in pairs)


def _picture(record: Record, drawn: Sequence[Simulated], pair: tuple[str, str], several: bool) -> Picture:
    shown = _units(record, drawn[0])
    # Errors are drawn instead of estimates where these differ in their last digits only.
    errors = [_finer(record, shown, name) for name in pair]
    axes = [
        Axis(f"error of {words(name)}" if error else words(name), shown[name][0])
        for name, error in zip(pair, errors, strict=True)
    ]
    factors = np.array([shown[name][1] for name in pair])
    made = [_cloud(one, pair, (axes[0], axes[1]), factors, np.array(errors), several) for one in drawn]
    alt, caption = SAY("alt", pair), SAY("caption", pair, any(errors))
    return Picture(f"estimates_{pair[0]}_{pair[1]}", alt, caption, cloud_figure(made))


def _cloud(
    one: Simulated,
    pair: tuple[str, str],
    axes: tuple[Axis, Axis],
    factors: np.ndarray,
    errors: np.ndarray,
    several: bool,
) -> Cloud:
    at = [one.parameters.index(name) for name in pair]
    scale = np.outer(factors, factors)
    true = np.array(one.true)[at]
    origin = np.where(errors, true, 0.0)
    return Cloud(
        title=f"{one.name}\n{words(one.estimator)}" if several else one.name,
        axes=axes,
        points=factors * (np.array(one.estimates)[:, at] - origin),
        true=factors * (true - origin),
        promised=scale * np.array(one.promised_covariance)[np.ix_(at, at)],
        sampled=scale * np.array(one.sampled_covariance)[np.ix_(at, at)],
        alike=axes[0].unit == axes[1].unit,
    )
