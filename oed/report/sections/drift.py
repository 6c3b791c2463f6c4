"""What drift does to precision: every drive with it, and as it would be without."""

from __future__ import annotations

import numpy as np

from oed.foundation.text import error_text, fixed, significant, words
from oed.kernel.measurement.measurement import sensors_of
from oed.kernel.measurement.sensor import process_noise_of
from oed.records.record import Record
from oed.records.stored.parts import Column as Numbers
from oed.records.stored.result import Result
from oed.records.stored.study_record import StoredParameter
from oed.report.figures.chart import Chart, panels
from oed.report.parts.judging import study_aim
from oed.report.parts.prose import Prose
from oed.report.parts.reading import called, with_drive
from oed.report.parts.section import Column, Picture, Section, Table

SAY = Prose("drift")


def drift(record: Record) -> Section | None:
    """Standard errors with drift and without, drive by drive, and what a search costs that leaves it out;
    None where nothing drifts.
    """
    noise = process_noise_of(sensors_of(record.study.measurement))
    results = [one for one in with_drive(record) if _ratios(one)]
    winner = record.best
    if noise is None or winner is None or not _ratios(winner):
        return None
    blind = {solver.label for solver in record.study.solvers if solver.without_drift}
    lost = [(called(record, one), _times(one), _share(record, one)) for one in results if one.name in blind]
    said = SAY.paragraphs("drift", noise.text, noise.walks, called(record, winner), _times(winner), lost)
    picture = _over_time(record, winner, [one for one in results if one.name in blind])
    return Section.of("What drift does", *said, picture, _table(record, results))


def _over_time(record: Record, winner: Result, blind: list[Result]) -> Picture | None:
    # How precise the best drive has been so far, with drift and without; and the best one without, with it.
    course = winner.over_time
    if course is None:
        return None
    charts = []
    for one in record.parameters:
        unit, factor = record.shown_unit(one.name, one.unit)

        def sizes(
            of: dict[str, Numbers], name: str = one.name, factor: float = factor
        ) -> tuple[float | None, ...]:
            column = of.get(name, [None] * len(course.t))
            return tuple(None if size is None else factor * size for size in column)

        lines = [
            ("with drift", sizes(course.standard_deviations)),
            ("without drift", sizes(course.steady_deviations)),
        ]
        lines += [
            (called(record, other), sizes(other.over_time.standard_deviations))
            for other in blind
            if other is not winner and other.over_time is not None and other.over_time.t == course.t
        ]
        places = tuple(float(time) for time in course.t)
        charts.append(Chart("time [s]", places, tuple(lines), f"standard error [{unit}]", words(one.name)))
    alt = f"Standard errors of {called(record, winner)} over time, with drift and without"
    note = SAY("over_time", called(record, winner), [called(record, one) for one in blind])
    return Picture("precision_over_time", alt, note, panels(charts))


def _share(record: Record, result: Result) -> float | None:
    # How efficient a drive is beside the best one.
    best = record.best
    if best is None or best.objective is None or result.objective is None:
        return None
    return study_aim(record).efficiency(result.objective, best.objective)


def _times(result: Result) -> float:
    # How many times larger standard errors are with drift: of the parameter that it does most to.
    return max(_ratios(result))


def _ratios(result: Result) -> list[float]:
    # Standard errors with drift over those without, of parameters that have both.
    return [
        size / without
        for name, size in result.standard_deviations.items()
        if size is not None and (without := result.steady_deviations.get(name))
    ]


def _table(record: Record, results: list[Result]) -> Table:
    def columns(one: StoredParameter) -> tuple[Column, Column]:
        unit, factor = record.shown_unit(one.name, one.unit)

        def size(of: dict[str, float | None]) -> float | None:
            found = of.get(one.name)
            return None if found is None else factor * found

        return (
            Column(words(one.name), unit, error_text, lambda result: size(result.standard_deviations)),
            Column("without drift", unit, error_text, lambda result: size(result.steady_deviations)),
        )

    each = [column for one in record.parameters for column in columns(one)]
    drives = Column("drive", cell=lambda result: called(record, result))
    driven = (
        Column("path", "m", significant(3), lambda result: result.path_length),
        Column("turned", "rad", fixed(1), _turned),
    )
    leading = (drives, *driven) if record.study.domain == "robots" else (drives,)
    return Table.of(results, (*leading, *each), "Standard errors with drift and without")


def _turned(result: Result) -> float | None:
    # All turns, left and right, of all runs [rad].
    if result.drive is None:
        return None
    return float(sum(np.abs(np.diff(own[:, 2])).sum() for own in result.drive.by_run))
