"""The predicted precision against simulated experiments: tests, and estimates with their ellipses."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from oed.foundation.arrays import ROUNDING
from oed.foundation.text import Unit, fixed, significant, unit_text, words
from oed.records.record import Record
from oed.records.stored.simulation import Simulated
from oed.report.figures import spread
from oed.report.parts.prose import Prose
from oed.report.parts.reading import called_by, drivable, nuisance_names, regression_of
from oed.report.parts.section import Column, Picture, Section, Table

SAY = Prose("validation")
FOUR, THREE = significant(4), significant(3)
NEAR = 0.05
"""Deviation, as a share of the true value, below which a figure shows errors instead of estimates."""
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
    made = Section.of(
        "Validation by simulation",
        *(f"{_titled(record, one, several)}: {outcome.verdict(one)}" for one in chosen),
        SAY("intro", outcome, regression_of(record), estimators, names, prior),
        *_clouds(record, every, chosen, several),
        *(_checks(one, outcome.alpha, _titled(record, one, several)) for one in chosen),
        _side_by_side(record, every, outcome.replicates),
    )
    return replace(made, brief=(len(chosen), 0))


def _titled(record: Record, one: Simulated, several: bool) -> str:
    name = called_by(record, one.name)
    return f"{name} by {words(one.estimator)}" if several else name


def _checks(simulated: Simulated, alpha: float, title: str) -> Table:
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
    return Table.of(simulated.checks, columns, SAY("checks", title, alpha, lucky))


@dataclass(frozen=True)
class _Estimated:
    """A parameter in simulated experiments with a drive, and the unit in which it is shown."""

    drive: Simulated
    at: int
    unit: Unit

    def deviation(self, covariance: Sequence[Sequence[float]]) -> float:
        """The standard deviation of a covariance, as shown."""
        return self.unit[1] * math.sqrt(covariance[self.at][self.at])

    @property
    def predicted(self) -> float:
        """The predicted standard deviation, as shown."""
        return self.deviation(self.drive.predicted_covariance)

    def value(self, values: Sequence[float]) -> str:
        """One of all parameters' values, to as many digits as show a hundredth of a deviation."""
        hundredth = self.predicted / 100.0
        write = fixed(max(0, math.ceil(-math.log10(hundredth))) if hundredth > 0 else 4)
        return write(self.unit[1] * values[self.at])

    @property
    def near(self) -> bool:
        """Whether estimates differ from the true value in their last digits only."""
        true = self.unit[1] * self.drive.true[self.at]
        return self.predicted < NEAR * abs(true)


def _estimated(record: Record, one: Simulated, name: str) -> _Estimated:
    unit = next(parameter.unit for parameter in record.parameters if parameter.name == name)
    return _Estimated(one, one.parameters.index(name), record.shown_unit(name, unit))


def _side_by_side(record: Record, every: Sequence[Simulated], replicates: int) -> Table:
    several = len({one.estimator for one in every}) > 1
    items = [_estimated(record, one, name) for one in every for name in one.parameters]
    columns = (
        Column("drive", cell=lambda one: called_by(record, one.drive.name)),
        Column("estimator", cell=lambda one: words(one.drive.estimator)) if several else None,
        Column("parameter", cell=lambda one: words(one.drive.parameters[one.at])),
        Column("unit", cell=lambda one: unit_text(one.unit[0]) or "1"),
        Column("true", "", FOUR, lambda one: one.value(one.drive.true)),
        Column("mean estimate", "", FOUR, lambda one: one.value(one.drive.mean)),
        Column("predicted deviation", "", THREE, lambda one: one.predicted),
        Column("simulated deviation", "", THREE, lambda one: one.deviation(one.drive.sampled_covariance)),
        Column(
            "variance ratio on the same draws",
            "",
            fixed(3),
            lambda one: one.drive.paired_variance_ratio[one.at],
        ),
        Column("± (paired)", "", _error, lambda one: one.drive.paired_standard_error[one.at]),
        Column("all tests passed", cell=lambda one: one.drive.passed),
    )
    return Table.of(items, columns, SAY("every", 100 / math.sqrt(2 * replicates)))


def _error(size: float) -> str:
    # What rounding alone leaves is nothing.
    return significant(1)(size if size > ROUNDING else 0.0)


def _clouds(
    record: Record, every: Sequence[Simulated], chosen: Sequence[Simulated], several: bool
) -> Iterator[Picture]:
    # A figure for each pair of parameters: the design by every estimator first, then other drives.
    shown = [one.name for one in drivable(record)]
    others = [
        one
        for one in every
        if not any(one is other for other in chosen)
        and one.name in shown
        and one.estimator == chosen[0].estimator
    ]
    others.sort(key=lambda one: _worth(record, one), reverse=True)
    drawn, names = [*chosen, *others][:MOST_CLOUDS], chosen[0].parameters
    known = [pair for pair in COEFFICIENTS if set(pair) <= set(names)]
    for pair in known or list(pairwise(names))[:MOST_PAIRS]:
        yield _picture(record, drawn, pair, several)


def _worth(record: Record, one: Simulated) -> float:
    # The best drives are drawn.
    result = record.result(one.name)
    return -math.inf if result is None or result.worth is None else result.worth


def _picture(record: Record, drawn: Sequence[Simulated], pair: tuple[str, str], several: bool) -> Picture:
    axes = []
    for name in pair:
        one = _estimated(record, drawn[0], name)
        title = f"error of {words(name)}" if one.near else words(name)
        axes.append(spread.Estimated(name, title, *one.unit, errors=one.near))
    names = [called_by(record, one.name) for one in drawn]
    titles = [
        f"{name}\n{words(one.estimator)}" if several else name for name, one in zip(names, drawn, strict=True)
    ]
    caption = SAY("caption", pair, any(one.errors for one in axes))
    figure = spread.clouds(drawn, titles, axes)
    return Picture(f"estimates_{pair[0]}_{pair[1]}", SAY("alt", pair), caption, figure)
