"""The predicted precision against simulated experiments: tests, and estimates with their ellipses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from oed.foundation.text import Unit, fixed, readable, significant, unit_text, words
from oed.records.record import Record
from oed.records.stored.simulation import Simulated
from oed.report.figures import spread
from oed.report.parts.prose import Prose
from oed.report.parts.reading import nuisance_names, regression_of, shown_units
from oed.report.parts.section import Picture, Section
from oed.report.parts.tables import Column, Table

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
        Column("test", cell=lambda one: one.name),
        Column("question", cell=lambda one: one.question),
        Column("found", "", FOUR, lambda one: one.statistic),
        Column("expected from", "", FOUR, lambda one: one.expected[0]),
        Column("to", "", FOUR, lambda one: one.expected[1]),
        Column("p-value", "", significant(2), lambda one: one.p_value),
        Column("passed", cell=lambda one: one.passed),
    )
    outside = [one for one in simulated.checks if not one.expected[0] <= one.statistic <= one.expected[1]]
    lucky = any(one.passed for one in outside)
    return Table.of(simulated.checks, columns, SAY("checks", _titled(simulated, several), alpha, lucky))


def _units(record: Record, simulated: Simulated) -> dict[str, Unit]:
    # In which deviations are shown: as suits one simulated drive.
    sizes = np.sqrt(np.diag(simulated.predicted_covariance)).tolist()
    return shown_units(record, dict(zip(simulated.parameters, sizes, strict=True)))


def _finer(record: Record, shown: dict[str, Unit], name: str) -> bool:
    # Whether a parameter's deviations are shown in another unit than itself.
    units = {one.name: one.unit for one in record.parameters}
    return shown[name][0] != readable(1.0, units[name])[1]


@dataclass(frozen=True)
class _Estimated:
    """A parameter in simulated experiments with a drive: its SI unit, and that of its deviations as shown."""

    drive: Simulated
    at: int
    unit: str
    shown: Unit

    @property
    def predicted(self) -> float:
        """Standard deviation [SI]."""
        return math.sqrt(self.drive.predicted_covariance[self.at][self.at])

    @property
    def sampled(self) -> float:
        """Standard deviation [SI]."""
        return math.sqrt(self.drive.sampled_covariance[self.at][self.at])

    def value(self, values: Sequence[float]) -> str:
        """One of all parameters' values, to as many digits as show a hundredth of a deviation."""
        scale, _ = readable(1.0, self.unit)
        hundredth = scale * self.predicted / 100.0
        write = fixed(max(0, math.ceil(-math.log10(hundredth))) if hundredth > 0 else 4)
        return write(scale * values[self.at])


def _side_by_side(record: Record, every: Sequence[Simulated], chosen: Simulated, several: bool) -> Table:
    shown, units = _units(record, chosen), {one.name: one.unit for one in record.parameters}
    finer = any(_finer(record, shown, name) for name in chosen.parameters)
    items = [
        _Estimated(one, at, units[name], shown[name])
        for one in every
        for at, name in enumerate(one.parameters)
    ]
    columns = (
        Column("result", cell=lambda one: one.drive.name),
        Column("estimator", cell=lambda one: words(one.drive.estimator)) if several else None,
        Column("parameter", cell=lambda one: words(one.drive.parameters[one.at])),
        Column("unit", cell=lambda one: unit_text(readable(1.0, one.unit)[1]) or "1"),
        Column("true", "", FOUR, lambda one: one.value(one.drive.true)),
        Column("mean estimate", "", FOUR, lambda one: one.value(one.drive.mean)),
        Column("deviations in", cell=lambda one: one.shown[0] or "1") if finer else None,
        Column("predicted deviation", "", THREE, lambda one: one.shown[1] * one.predicted),
        Column("simulated deviation", "", THREE, lambda one: one.shown[1] * one.sampled),
        Column(
            "variance, simulated/predicted", "", fixed(3), lambda one: one.drive.paired_variance_ratio[one.at]
        ),
        Column("± (paired)", "", _error, lambda one: one.drive.paired_standard_error[one.at]),
        Column("all tests passed", cell=lambda one: one.drive.passed),
    )
    return Table.of(items, columns, "All drives from which the parameters are identifiable")


def _error(size: float) -> str:
    # What rounding alone leaves is nothing.
    return significant(1)(size if size > ROUNDING else 0.0)


def clouds(
    record: Record, every: Sequence[Simulated], chosen: Sequence[Simulated], several: bool
) -> tuple[Picture, ...]:
    """A figure for each pair of parameters: the design by every estimator first, then other drives.

    All panels of a figure are on one scale.

    Args:
        record: that has the simulations.
        every: all simulations.
        chosen: those that are drawn.
        several: whether there are several estimators.
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
    axes = []
    for name in pair:
        # Errors are drawn instead of estimates where these differ in their last digits only.
        errors = _finer(record, shown, name)
        title = f"error of {words(name)}" if errors else words(name)
        axes.append(spread.Estimated(name, title, *shown[name], errors))
    titles = [f"{words(one.name)}\n{words(one.estimator)}" if several else words(one.name) for one in drawn]
    caption = SAY("caption", pair, any(one.errors for one in axes))
    figure = spread.clouds(drawn, titles, axes)
    return Picture(f"estimates_{pair[0]}_{pair[1]}", SAY("alt", pair), caption, figure)
