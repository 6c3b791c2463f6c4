"""How sure it is that the best drive is the best: the bound that is proved, and where every start ended."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from oed.foundation.text import significant
from oed.records.record import Record
from oed.records.stored.result import Result
from oed.records.stored.study_record import StoredCertificate
from oed.report.figures import spread
from oed.report.figures.spec import Axis
from oed.report.parts.judging import Aim, aim_of, study_aim
from oed.report.parts.prose import Prose
from oed.report.parts.reading import called
from oed.report.parts.section import Column, Picture, Section, Table
from oed.report.sections.searches import SIX, WITHIN

SAY = Prose("sureness")
TITLE = "How sure it is the best"
PRACTICALLY = 1e-4
"""Share by which a design is less than its best start that needs a word."""


def sureness(record: Record) -> Section | None:
    """The bound, the best drive and every start on one axis, and what the bound rests on; None where there is
    neither a bound nor a start.
    """
    found, strip = record.certificate, _strip(record)
    if found is None:
        return None if strip is None else Section.of(TITLE, SAY("unproved", record.study.bound), strip)
    criterion = study_aim(record).criterion
    said = SAY.paragraphs("certificate", found, _holder(record, found.best), criterion, _lost(record, found))
    loose = SAY("loose") if found.loose else ""
    bounds = _bounds(found) if len(found.bounds) > 1 else None
    return replace(Section.of(TITLE, *said, strip, bounds, notices=[loose]), brief=(1, 0))


def _holder(record: Record, best: float | None) -> str:
    # The drive that the gap is of, where it is not the one that is chosen; "" else.
    holders = (one for one in record.results if one.feasible and one.objective == best)
    holder, winner = next(holders, None), record.best
    return "" if holder is None or winner is None or holder.name == winner.name else called(record, holder)


def _lost(record: Record, found: StoredCertificate) -> float | None:
    # By what share of the best objective known that of the best splines is less, in efficiency; None if not.
    if found.spline_objective is None or found.best is None or found.best <= found.spline_objective:
        return None
    return -study_aim(record).change(found.spline_objective, found.best) / 100


def _bounds(found: StoredCertificate) -> Table:
    columns = (
        Column("upper bound", "", SIX, lambda one: one.upper_bound),
        Column("proved by", cell=lambda one: one.method),
        Column("assumes", cell=lambda one: "; ".join(one.assumptions)),
    )
    return Table.of(found.bounds, columns, "All bounds found; the smallest counts")


@dataclass(frozen=True)
class _Search:
    """A search whose design can be driven.

    Attributes:
        result: of the search.
        ends: what its starts ended with, those that compare with the study's designs.
        failed: starts without a feasible design.
        looser: starts under limits that were not tight enough yet.
        elsewhere: whether they sought something else: another criterion, no drift, or all readings.
    """

    result: Result
    ends: tuple[float, ...]
    failed: int
    looser: int
    elsewhere: bool

    @property
    def worth(self) -> float:
        """Of its design."""
        return self.result.worth or 0.0


def _searches(record: Record, winner: Result) -> list[_Search]:
    # The drive that is chosen first, whatever found it, then the best.
    every = [one for one in record.results if one.origin == "search" or one.name == winner.name]
    driven = [one for one in every if one.feasible and not one.useless]
    finite = [one for one in driven if one.worth is not None and math.isfinite(one.worth)]
    ranked = sorted(finite, key=lambda one: (one.name != winner.name, -(one.worth or 0.0)))
    return [_search(record, one) for one in ranked]


def _search(record: Record, result: Result) -> _Search:
    aim, found = study_aim(record), [one.objective for one in result.starts]
    reached = _of_starts(result)
    if aim_of(record, result).label != aim.label or _of_all_readings(aim, result):
        return _Search(result, (), 0, 0, bool(found))
    known = [one for one in found if one is not None]
    # The starts of a robust search are of all its rounds, each with tighter limits than the last.
    tight = known
    if record.study.robust is not None:
        tight = [one for one in known if aim.change(one, reached) <= WITHIN]
    return _Search(result, tuple(tight), len(found) - len(known), len(known) - len(tight), False)


def _of_all_readings(aim: Aim, result: Result) -> bool:
    # Whether the starts sought a design with all readings, of which some were chosen afterwards.
    reached = [value for value in result.stages.values() if value is not None]
    far = bool(reached) and abs(aim.change(reached[-1], result.worth or 0.0)) > WITHIN
    return result.selection is not None and far


def _of_starts(result: Result) -> float:
    # What starts compare with: a design on their own spline.
    first = next((one.objective for one in result.levels), None)
    return first if first is not None else result.worth or 0.0


def _first_spline(result: Result) -> int | None:
    # Its coefficients, where the search went on from it to finer ones.
    return result.levels[0].coefficients if len(result.levels) > 1 else None


@dataclass(frozen=True)
class _Scale:
    """What designs are worth: in efficiency, of the bound or else of the best; as a number where a criterion
    knows no efficiency.

    Attributes:
        aim: the study's criterion.
        best: what they are measured by.
        proved: whether that is a bound.
    """

    aim: Aim
    best: float
    proved: bool

    @property
    def shares(self) -> bool:
        """Whether the criterion knows an efficiency."""
        return self.aim.efficiency(self.best, self.best) is not None

    @property
    def axis(self) -> Axis:
        """Of a figure."""
        whole = "of the proved bound" if self.proved else "of the best"
        return Axis(f"efficiency, share {whole}", "%") if self.shares else Axis(self.aim.number)

    def of(self, value: float) -> float:
        """Where a design of that objective is on the axis."""
        return 100.0 * (self.aim.efficiency(value, self.best) or 0.0) if self.shares else value

    def text(self, value: float) -> str:
        """What a design of that objective is worth, in words."""
        shown = self.of(value)
        # 99.97 % is not 100 %.
        return f"{shown:{'.4g' if shown > 99 else '.3g'}} %" if self.shares else significant(4)(value)


def _given_up(search: _Search, aim: Aim) -> float:
    # By what share the chosen design is less than its best start, for a second stage's sake; 0 if not.
    if "second_stage" not in search.result.stages or not search.ends:
        return 0.0
    less = -aim.change(search.worth, max(search.ends)) / 100
    return less if less > PRACTICALLY else 0.0


def _strip(record: Record) -> Picture | None:
    winner, found = record.best, record.certificate
    searches = [] if winner is None else _searches(record, winner)
    bound = None if found is None else found.gap_to or found.upper_bound
    ends = [value for one in searches for value in one.ends]
    if winner is None or not searches or (bound is None and not ends):
        return None
    aim = study_aim(record)
    best = max(*ends, *(one.worth for one in searches)) if bound is None else bound
    scale = _Scale(aim, best, bound is not None)
    close = sum(aim.change(value, _of_starts(winner)) >= -WITHIN for value in ends)
    names = [called(record, one.result) for one in searches]
    lanes = [
        spread.Lane(name, scale.of(one.worth), scale.text(one.worth), tuple(map(scale.of, one.ends)))
        for name, one in zip(names, searches, strict=True)
    ]
    at = scale.text(winner.worth or 0.0) if scale.proved and scale.shares else None
    caption = SAY(
        "caption",
        scale.proved,
        sum(one.failed for one in searches),
        [name for name, one in zip(names, searches, strict=True) if one.elsewhere],
        sum(one.looser for one in searches),
        _given_up(searches[0], aim),
    )
    title = SAY("finding", called(record, winner), at, close, len(ends), _first_spline(winner))
    figure = spread.strip(lanes, scale.axis, scale.of(best) if scale.proved else None, title)
    return Picture("sureness", SAY("alt", names, scale.proved), caption, figure)
