"""All candidates side by side: in repetitions of the best, by every criterion, and as the paper has them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

from oed.foundation.text import error_text, fixed, listing, quantity, significant, whole, words
from oed.kernel.solution import Status
from oed.records.record import Record
from oed.records.stored.result import Result
from oed.records.stored.study_record import StoredParameter
from oed.report.figures.ranking import Scale, ranking
from oed.report.parts.judging import Aim, aim_of, judged, plain_aim, repeatable, repetitions_of, study_aim
from oed.report.parts.prose import Prose
from oed.report.parts.reading import (
    VARIANT,
    called,
    drivable,
    found_by,
    or_infinite,
    regression_of,
    with_drive,
)
from oed.report.parts.section import Column, Picture, Section, Table
from oed.report.sections.limits import exceeded

SAY = Prose("candidates")
FOUR = significant(4)
CENTIMETRES = 100.0
"""In a metre: the founding paper's table has |y| in cm."""
MOST_DOTS, MOST_SCALES = 8, 4
"""Drives and parameters that are drawn side by side."""
LEVEL = 99.95
"""Share [%] from which a drive counts as the best."""
PRACTICALLY = 1e-3
"""How much better [%] a drive has to be for its being second to need a word."""


def comparison(record: Record) -> Section | None:
    """The drives to choose from, best first: what each is worth as a dot; None for one alone."""
    shown = _ranked(record)
    if len(shown) < 2:
        return None
    scales = _errors(record, shown) or _efficiencies(record, shown)
    if not scales:
        return None
    designs = [one.origin == "search" for one in shown]
    names = [called(record, one).removesuffix(words(VARIANT)) for one in shown]
    picture = Picture(
        "candidates",
        SAY("alt"),
        SAY("caption", bool(_errors(record, shown))),
        ranking(names, designs, scales),
    )
    undriven = sum(not one.feasible for one in with_drive(record))
    return Section.of("How it compares", _practically_equal(record), SAY("undriven", undriven), picture)


def _ranked(record: Record) -> list[Result]:
    # The best first, then by worth; what leaves something not identifiable last.
    best = record.best

    def rank(one: Result) -> tuple[bool, bool, float]:
        return best is None or one.name != best.name, one.useless, -(one.worth or 0.0)

    return sorted((one for one in drivable(record) if one.feasible), key=rank)[:MOST_DOTS]


def _errors(record: Record, shown: Sequence[Result]) -> list[Scale]:
    # Standard errors of what is judged.
    return [
        _error_scale(record, one, [result.standard_deviations.get(one.name) for result in shown])
        for one in judged(record)
        if any(result.standard_deviations.get(one.name) for result in shown)
    ][:MOST_SCALES]


def _error_scale(record: Record, parameter: StoredParameter, sizes: Sequence[float | None]) -> Scale:
    unit, factor = record.shown_unit(parameter.name, parameter.unit)
    values = tuple(None if size is None else factor * size for size in sizes)
    texts = tuple("not identifiable" if size is None else error_text(size, factor) for size in sizes)
    return Scale("standard error", unit, values, texts, words(parameter.name))


def _efficiencies(record: Record, shown: Sequence[Result]) -> list[Scale]:
    shares = [repetitions_of(record, one) for one in shown]
    if any(one is None for one in shares):
        return []
    values = tuple(100.0 / one if one and math.isfinite(one) else None for one in shares)
    texts = tuple("not identifiable" if one is None else quantity(one, "%") for one in values)
    return [Scale("efficiency", "%", values, texts)]


def candidates(record: Record) -> Section | None:
    """One row per result: objective, efficiency, effort, and why it cannot be driven."""
    if not with_drive(record):
        return None
    best = record.best
    shares, several = best is not None and repeatable(record), len(record.results) > 1
    said = ""
    if best is not None and several:
        baselines = any(one.origin == "baseline" for one in record.results)
        known = (record.nuisances, record.study.prior, baselines)
        said = SAY("worth", study_aim(record), shares, called(record, best), *known)
    return Section.of("Candidates", said, Table.of(record.results, _columns(record, shares)))


def _columns(record: Record, shares: bool) -> Iterator[Column]:
    # What is 0 or infinite but for rounding is shown so.
    nothing = 0.0 if study_aim(record).criterion.proportional else -math.inf

    def repetitions(one: Result) -> float | None:
        return repetitions_of(record, one)

    def efficiency(one: Result) -> float | None:
        number = repetitions(one)
        return None if number is None else 100.0 / number

    yield Column("drive", cell=lambda one: called(record, one))
    yield Column("found by", cell=found_by)
    yield Column("objective", "", FOUR, lambda one: nothing if one.useless else one.worth)
    if shares:
        yield Column("efficiency", "%", fixed(1), efficiency)
        yield Column("repetitions for the same", "", significant(2), repetitions)
    if any(one.path_length is not None for one in record.results):
        yield Column("path length", "m", fixed(2), lambda one: one.path_length)
    yield Column("search time", "s", fixed(1), lambda one: one.wall_seconds if one.history else None)
    yield Column("evaluations", "", whole, lambda one: one.history[-1].evaluations if one.history else None)
    yield Column("satisfies every limit", cell=lambda one: one.feasible)
    if any(_driven(one) for one in record.results):
        yield Column("how it is driven", cell=_driven)
    yield Column("why it cannot be driven", cell=lambda one: _impossible(one) or _obstacle(one, record))


def _driven(one: Result) -> str | None:
    # A baseline's laps, their size and the way there; earlier records do not say.
    known = one.origin == "baseline" and one.feasible and not one.message.startswith(Status.SCORED.sentence)
    return one.message if known else None


def _impossible(one: Result) -> str | None:
    # Why there is no such drive of this robot.
    return one.message if one.status == Status.IMPOSSIBLE.value else None


def _obstacle(one: Result, record: Record) -> str | None:
    # By how much a drive exceeds which limits, in the limits' units.
    broken = exceeded(one, record.robustness, record.study.limit_units)
    return f"exceeds {listing(broken)}" if broken else None


@dataclass(frozen=True)
class _Judge:
    """A criterion by which all drives are judged."""

    aim: Aim
    results: Sequence[Result]

    def value(self, result: Result) -> float | None:
        """The criterion of a drive; minus infinity of one that leaves something not identifiable."""
        criterion = self.aim.criterion
        if criterion.kind not in result.criteria:
            return None
        # JSON holds no infinite number.
        number = result.criteria[criterion.kind]
        return -math.inf if number is None or (result.rounded and not criterion.proportional) else number

    @cached_property
    def best(self) -> float | None:
        """That of the drives that satisfy every limit."""
        kept = (self.value(one) for one in self.results if one.feasible)
        largest = max((found for found in kept if found is not None), default=-math.inf)
        return largest if math.isfinite(largest) else None

    @property
    def shares(self) -> bool:
        """Whether drives are worth a share of the best."""
        return self.best is not None and self.aim.efficiency(self.best, self.best) is not None

    def share(self, result: Result) -> float | None:
        """What a drive is worth of the best [%]."""
        number = self.value(result)
        if number is None or self.best is None:
            return None
        share = self.aim.efficiency(number, self.best)
        return None if share is None else 0.0 if result.rounded else 100.0 * share

    @property
    def column(self) -> Column:
        """Of the table."""
        if self.shares:
            return Column(f"{self.aim.label}-efficiency", "%", fixed(1), self.share)
        return Column(self.aim.label, "", FOUR, self.value)


def criteria(record: Record) -> Section | None:
    """One row per drive: its efficiency by every criterion, against the best drive by that criterion.

    None for records that hold no such numbers, a single drive, or none that satisfies every limit.
    """
    results = [one for one in with_drive(record) if one.criteria]
    kinds = dict.fromkeys(kind for one in results for kind in one.criteria)
    if not kinds or len(results) < 2 or not any(one.feasible for one in results):
        return None
    judges = [_Judge(plain_aim(record, kind), results) for kind in kinds]
    columns = (
        Column("drive", cell=lambda one: called(record, one)),
        Column(
            "searched for", cell=lambda one: aim_of(record, one).label if one.origin == "search" else None
        ),
        *(one.column for one in judges),
        Column("satisfies every limit", cell=lambda one: one.feasible),
    )
    return Section.of(
        "Criteria",
        SAY("criteria", judges, record.study.criterion.scaling, record.study.prior),
        _verdict(record, judges),
        Table.of(results, columns),
    )


def _verdict(record: Record, judges: Sequence[_Judge]) -> str:
    winner = record.best
    if winner is None or not winner.criteria:
        return ""
    found = [(one.aim.label, one.share(winner)) for one in judges]
    shares = [(label, share) for label, share in found if share is not None]
    best = all(share > LEVEL for _, share in shares)
    return SAY("verdict", called(record, winner), shares, best) if shares else ""


def _practically_equal(record: Record) -> str:
    # The best result need not have the largest objective; say why.
    winner, aim = record.best, study_aim(record)
    kept = [(one.objective, one) for one in record.results if one.feasible and one.objective is not None]
    if winner is None or winner.objective is None or not kept:
        return ""
    largest, other = max(kept, key=lambda one: one[0])
    more = aim.change(largest, winner.objective)
    names = [called(record, one) for one in (other, winner)]
    return "" if more < PRACTICALLY else SAY("equal", names[0], more, aim.label, names[1])


def paper(record: Record) -> Section | None:
    """The numbers by which the founding paper compares paths [Choi, eqs 17, 18 and the table of section 4].

    One row per result: eigenvalues, cond(W), s_min(W), |y| and the error factor of eq. 17. None for sensors:
    they have no regressor W.
    """
    regression = regression_of(record)
    if not with_drive(record) or regression is None:
        return None
    unit = _response_unit(record)
    # Without scaling F is W'W, and W is in radians of wheel angle.
    square = "rad²" if record.study.criterion.scaling == "none" else ""
    columns = (
        Column("drive", cell=lambda one: called(record, one)),
        Column("λ_min", square, FOUR, lambda one: 0.0 if one.leaves_open else one.lambda_min),
        Column("λ_max", square, FOUR, lambda one: or_infinite(one, one.lambda_max)),
        Column("cond(W)", "", FOUR, _condition),
        Column("s_min(W)", "rad", FOUR, lambda one: 0.0 if one.leaves_open else one.smallest_singular_value),
        *(_response(unit) if unit else ()),
    )
    absolute = regression.noise_model == "absolute"
    said = SAY.paragraphs("paper", absolute, record.study.criterion, record.study.prior, unit)
    return Section.of("The paper's figures", *said, Table.of(record.results, columns))


def _condition(one: Result) -> float | None:
    # What is singular but for rounding is singular.
    return math.inf if one.leaves_open else or_infinite(one, one.condition_number)


def _response(unit: str) -> tuple[Column, Column]:
    # |y|, and the error factor of eq. 17.
    def size(one: Result) -> float | None:
        condition = _condition(one)
        if one.norm_y is None or condition is None:
            return None
        return one.norm_y if unit == "rad" else CENTIMETRES * one.norm_y

    def factor(one: Result) -> float | None:
        response, condition = size(one), _condition(one)
        return condition / response if response and condition is not None else None

    return Column("|y|", unit, FOUR, size), Column("cond(W)/|y|", f"1/{unit}", FOUR, factor)


def _response_unit(record: Record) -> str:
    # |y| has a unit only where all rows of W measure one kind of thing: displacements in m, turns in rad.
    block, *others = dict.fromkeys(one.block for one in record.parameters)
    return "" if others else {"position": "cm", "heading": "rad"}.get(block, "")
