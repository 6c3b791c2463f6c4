"""What the splines cost: objectives with more and more coefficients, beside the starts and the bound."""

from __future__ import annotations

from dataclasses import dataclass

from oed.foundation.text import fixed, significant, whole
from oed.records.record import Record
from oed.records.stored.result import Level, Result
from oed.report.parts.judging import Aim, aim_of, study_aim
from oed.report.parts.prose import Prose
from oed.report.parts.reading import called, with_method
from oed.report.parts.section import Column, Section, Table
from oed.report.sections.searches import SIX

SAY = Prose("refinement")


@dataclass(frozen=True)
class _Step:
    """A level of a search, beside the others.

    Attributes:
        name: of the search.
        level: itself.
        gain: by how much it is more than the level before [%].
        gap: by how much the bound is more [%].
    """

    name: str
    level: Level
    gain: float | None
    gap: float | None


@dataclass(frozen=True)
class _Cost:
    """What the splines of a search cost.

    Attributes:
        name: of its design.
        first, last: coefficients.
        whole: gain from the first to the best level [%].
        step: gain of the last doubling [%].
        worst: how far the worst start on the first spline is below the best one [%].
        gap, rest: to the bound, of the first level and of the best one [%]; None without a bound.
    """

    name: str
    first: int
    last: int
    whole: float
    step: float
    worst: float | None
    gap: float | None
    rest: float | None


def refinement(record: Record) -> Section | None:
    """What splines of more coefficients gained; None where no search refined its spline."""
    refined = [one for one in record.results if len(_known(one)) > 1]
    if not refined:
        return None
    said = [SAY("cost", _cost(record, one)) for one in refined]
    return Section.of("What the spline costs", *said, _table(record, refined))


def _known(result: Result) -> list[tuple[Level, float]]:
    return [(one, one.objective) for one in result.levels if one.objective is not None]


def _bound(record: Record, aim: Aim) -> float | None:
    # On the objective that a search maximised.
    found = record.certificate
    if found is None or aim.label != study_aim(record).label:
        return None
    return found.gap_to or found.upper_bound


def _cost(record: Record, result: Result) -> _Cost:
    aim, levels = aim_of(record, result), _known(result)
    bound = _bound(record, aim)
    (first, begun), (_, before), (last, ended) = levels[0], levels[-2], levels[-1]
    best = max(value for _, value in levels)
    starts = [one.objective for one in result.starts if one.objective is not None]
    return _Cost(
        called(record, result),
        first.coefficients,
        last.coefficients,
        aim.change(best, begun),
        aim.change(ended, before),
        -aim.change(min(starts), max(starts)) if len(starts) > 1 else None,
        None if bound is None else aim.change(bound, begun),
        None if bound is None else aim.change(bound, best),
    )


def _steps(record: Record, result: Result) -> list[_Step]:
    aim, levels = aim_of(record, result), _known(result)
    bound, name = _bound(record, aim), with_method(record, result)
    before = [None, *(value for _, value in levels)]
    return [
        _Step(
            name,
            level,
            None if last is None else aim.change(value, last),
            None if bound is None else aim.change(bound, value),
        )
        for (level, value), last in zip(levels, before, strict=False)
    ]


def _table(record: Record, refined: list[Result]) -> Table:
    steps = [step for one in refined for step in _steps(record, one)]
    bounded = any(step.gap is not None for step in steps)
    columns = (
        Column("drive", cell=lambda step: step.name) if len(refined) > 1 else None,
        Column("coefficients", "", whole, lambda step: step.level.coefficients),
        Column("objective", "", SIX, lambda step: step.level.objective),
        Column("gain", "%", significant(3), lambda step: step.gain),
        Column("gap to the bound", "%", fixed(1), lambda step: step.gap) if bounded else None,
        Column("iterations", "", whole, lambda step: step.level.iterations),
    )
    return Table.of(steps, columns, SAY("levels"))
