"""How the searches went: whether starts agree, and how fast they were."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from statistics import median

from oed.foundation.text import fixed, listing, significant, whole
from oed.records.record import Record
from oed.records.stored.result import Progress, Result
from oed.report.figures import chart
from oed.report.parts.judging import Aim, aim_of, by_aim, study_aim
from oed.report.parts.prose import Prose
from oed.report.parts.reading import called, found_by, solver_of, with_method
from oed.report.parts.section import Column, Picture, Section, Table

SAY = Prose("searches")
SIX = significant(6)
WITHIN = 1.0
"""Shortfall from the best start up to which a start counts as having found it [%]."""
NO_CHANGE = 0.0005
"""Change of an objective [%] that counts as none."""
TARGETS = (0.9, 0.99, 0.999)
"""Shares of the best objective whose times are listed."""
FLOOR = 1e-4
"""Shortfall [%] below which a search counts as level with the best."""


@dataclass(frozen=True)
class _Search:
    """A search from many starts: what it was for, its result, and what that is called."""

    aim: Aim
    result: Result
    name: str

    @property
    def found(self) -> list[float]:
        """Objectives that starts reached, the best first."""
        every = (one.objective for one in self.result.starts)
        return sorted((value for value in every if value is not None), reverse=True)

    @property
    def failed(self) -> int:
        """Starts without a design."""
        return len(self.result.starts) - len(self.found)

    @property
    def iterations(self) -> list[int]:
        """Of every start."""
        return [one.iterations for one in self.result.starts]

    @property
    def shortfalls(self) -> list[float]:
        """In percent of the best start: 0 for the best, negative below it."""
        found = self.found
        return [self.aim.change(value, found[0]) for value in found]

    @property
    def close(self) -> int:
        """Starts that found the best one."""
        return sum(shortfall >= -WITHIN for shortfall in self.shortfalls)

    @property
    def stages(self) -> Iterator[tuple[str, float | None, float | None]]:
        """Name, objective and change [%] of every stage; None where there is none."""
        before: float | None = None
        for name, objective in self.result.stages.items():
            change = None
            if objective is not None and before:
                change = self.aim.change(objective, before)
            yield name, objective, 0.0 if change is not None and abs(change) < NO_CHANGE else change
            before = objective


def starts(record: Record) -> Section | None:
    """Spread of the starts, per search, and the stages in words."""
    searches = [
        _Search(aim_of(record, one), one, with_method(record, one)) for one in record.results if one.starts
    ]
    if not searches:
        return None
    own = study_aim(record).label
    apart = any(one.aim.label != own for one in searches)
    return Section.of(
        "Spread over the starts",
        *(SAY("agreement", one, apart) for one in searches),
        *(SAY("stages", one, solver_of(record, one.result), apart) for one in searches if one.result.stages),
        _starts(searches, apart),
    )


def _starts(searches: Sequence[_Search], apart: bool) -> Table:
    columns = (
        Column("drive", cell=lambda one: one.name),
        Column("searched for", cell=lambda one: one.aim.label) if apart else None,
        Column("starts", "", whole, lambda one: len(one.result.starts)),
        Column("within 1 %", "", whole, lambda one: one.close),
        Column("worst objective", "", SIX, lambda one: min(one.found, default=None)),
        Column("median objective", "", SIX, lambda one: median(one.found) if one.found else None),
        Column("best objective", "", SIX, lambda one: max(one.found, default=None)),
        Column("median iterations", "", whole, lambda one: median(one.iterations)),
        Column("most iterations", "", whole, lambda one: max(one.iterations)),
        Column("whole search", "s", fixed(1), lambda one: one.result.wall_seconds),
    )
    return Table.of(searches, columns, SAY("starts", apart))


def convergence(record: Record) -> Section | None:
    """Best objective so far against time, and the time each search took to given targets.

    Searches by different criteria apart, for their objectives do not compare.
    """
    every = [one for one in record.results if _points(one)]
    # A design that cannot be driven is no measure of one that can.
    searches = [one for one in every if one.feasible] or every
    if not searches:
        return None
    undriven = [called(record, one) for one in every if one not in searches]
    groups = by_aim(record, searches)
    apart = len(groups) > 1
    lines = [line for aim, results in groups for line in _lines(record, aim, results, apart)]
    alt = f"Convergence of {listing([with_method(record, one) for one in searches])} over time"
    picture = Picture("convergence", alt, SAY("convergence", apart, FLOOR), chart.convergence(lines, apart))
    races = (sentence for _, results in groups for sentence in _races(record, results))
    return Section.of("Convergence", *races, SAY("undriven", undriven), picture, _times(record, groups))


def _points(result: Result) -> list[tuple[Progress, float]]:
    # A design that leaves something undetermined has no finite number by most criteria.
    return [(one, one.objective) for one in result.history if one.objective is not None]


def _reached(result: Result) -> float:
    return max(objective for _, objective in _points(result))


def time_to(result: Result, objective: float) -> tuple[float, int] | None:
    """Seconds and evaluations after which a search had reached `objective`; None if it never did."""
    hits = ((one.seconds, one.evaluations) for one, value in _points(result) if value >= objective)
    return next(hits, None)


def _lines(record: Record, aim: Aim, searches: Sequence[Result], apart: bool) -> Iterator[chart.Search]:
    # (seconds, shortfall in percent), one point each time the objective rose, and at the end.
    best = max(map(_reached, searches))
    for one in searches:
        points = [(at.seconds, max(FLOOR, -aim.change(value, best))) for at, value in _points(one)]
        end = max(points[-1][0], one.wall_seconds)
        name = with_method(record, one)
        yield f"{name}, by {aim.label}" if apart else name, [*points, (end, points[-1][1])]


def _races(record: Record, searches: Sequence[Result]) -> Iterator[str]:
    # How long a search by gradients took to what another search ended with.
    gradient = [one for one in searches if one.by_gradient]
    for one in searches if gradient else ():
        if one.by_gradient:
            continue
        target, own = _reached(one), time_to(one, _reached(one))
        hits = [
            (found_by(other), hit[0]) for other in gradient if (hit := time_to(other, target)) is not None
        ]
        first = min(hits, key=lambda hit: hit[1], default=None)
        yield SAY("race", found_by(one), one.wall_seconds, target, None if own is None else own[0], first)


def _times(record: Record, groups: Sequence[tuple[Aim, Sequence[Result]]]) -> Table:
    several = len(groups) > 1
    best = {aim.label: max(map(_reached, searches)) for aim, searches in groups}
    items = [(aim, one) for aim, searches in groups for one in searches]
    columns = (
        Column("drive", cell=lambda item: with_method(record, item[1])),
        Column("searched for", cell=lambda item: item[0].label) if several else None,
        Column("best objective", "", SIX, lambda item: _reached(item[1])),
        *(_time_to_share(best, share) for share in TARGETS),
        Column("whole search", "s", significant(3), lambda item: item[1].wall_seconds),
        Column("evaluations", "", whole, lambda item: item[1].history[-1].evaluations),
    )
    return Table.of(items, columns, SAY("times", several))


def _time_to_share(best: Mapping[str, float], share: float) -> Column:
    near = 100.0 * (share - 1.0)

    def seconds(item: tuple[Aim, Result]) -> float | None:
        aim, one = item
        hits = (at.seconds for at, value in _points(one) if aim.change(value, best[aim.label]) >= near)
        return next(hits, None)

    return Column(f"time to {100 * share:g} %", "s", significant(3), seconds)
