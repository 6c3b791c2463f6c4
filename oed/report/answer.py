"""The answer that a study found: what its drive teaches, beside the best baseline, and what that rests on."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from oed.foundation.text import (
    Unit,
    deviation_text,
    given_text,
    nominal_text,
    own_unit,
    quantity,
    unit_text,
    words,
)
from oed.kernel.solution import TAIL
from oed.records.record import Record
from oed.records.stored.result import Result
from oed.records.stored.study_record import StoredParameter
from oed.report.parts.judging import identifies, judged, repeatable, repetitions_of, study_aim
from oed.report.parts.prose import Prose
from oed.report.parts.reading import chosen_text, duration_text, in_place, kind_of, taken
from oed.robots.limits import Circle, Workspace

SAY = Prose("answer")
EQUAL = 0.05
"""Share of a drive by which two count as equally good."""
MANY = 100.0
"""Drives beyond which their number says nothing to a reader: standard errors are compared instead."""
TWICE = 2.0
"""Times from which what may be smaller is said to be so many times smaller, not by a share."""


@dataclass(frozen=True)
class Estimated:
    """A parameter that the study estimates, in words.

    Attributes:
        name: of the parameter.
        value: nominal, with its unit.
        designed: standard error from the designed drive.
        baseline: the same from the best baseline; "" without one.
    """

    name: str
    value: str
    designed: str
    baseline: str


@dataclass(frozen=True)
class Answer:
    """What a study found, in words.

    Attributes:
        title: the drive.
        rows: what is estimated.
        baseline: name of the best baseline that can be driven; "" for none.
        sentences: how it compares, what is proved, what simulations say.
        warning: what a reader has to know before everything else; "" for nothing.
    """

    title: str
    rows: tuple[Estimated, ...]
    baseline: str
    sentences: tuple[str, ...]
    warning: str = ""


def answer_of(record: Record) -> Answer | None:
    """The answer that a record holds; None where no drive satisfies every limit."""
    winner = record.best
    if winner is None:
        return None
    baseline = best_baseline(record)
    beside = baseline if baseline is not None and baseline.name != winner.name else None
    parameters = record.parameters if beside is None else _unimproved_first(record, winner, beside)
    rows = rows_of(parameters, winner, beside, record.study.shown_units)
    said = (
        _chosen(record, winner),
        _compared(record, winner, baseline),
        _proved(record, winner),
        _holds(record, winner),
        "" if _warns(record, winner) else _departing(record, winner),
        _with_usual_drift(record, parameters, winner),
        *_tried(record),
    )
    return Answer(
        title_of(record),
        rows,
        "" if beside is None else _pattern(beside),
        tuple(filter(None, said if rows else (SAY("noiseless"), *said))),
        _departing(record, winner) if _warns(record, winner) else "",
    )


def _unimproved_first(record: Record, winner: Result, baseline: Result) -> list[StoredParameter]:
    shares = _drives(record.parameters, winner, baseline)
    return sorted(record.parameters, key=lambda one: shares.get(one.name, math.inf) > 1 + EQUAL)


def _with_usual_drift(record: Record, parameters: Sequence[StoredParameter], winner: Result) -> str:
    # In the order of the rows.
    drifting = winner.model_copy(update={"standard_deviations": winner.usual_drift_deviations})
    units = record.study.shown_units
    errors = [_error(one, drifting, units.get(one.name)) for one in parameters]
    return SAY("with_usual_drift", errors) if winner.usual_drift_deviations else ""


def _chosen(record: Record, winner: Result) -> str:
    # Of a robot that is read at some moments only: at how many. Experiments say so in their titles.
    found = winner.selection
    if found is None or record.study.domain != "robots":
        return ""
    some, every = len(taken(found)), len(found.readings)
    return SAY("chosen", some, every, found.of_runs) if some < every else ""


def _tried(record: Record) -> Iterator[str]:
    # Of simulated robots with slip: what the study's own model leaves at best, and what drives add to it.
    trial = record.trial
    if trial is None:
        return
    own, designed = trial.models[0].name, {one.name: one.model for one in trial.planned}
    for floor in trial.floors:
        least = next((one.value for one in floor.attainable if one.fit == own), None)
        excess = {
            one.drive: one.excess.value
            for one in floor.errors
            if one.fit == own and one.excess is not None and one.excess.value is not None
        }
        mine = next((name for name in excess if designed[name] == own), None)
        usual = [name for name in excess if designed[name] is None]
        if least is not None and mine is not None:
            other = min(usual, key=excess.__getitem__) if usual else ""
            more = excess.get(other)
            yield SAY("tried", floor.friction, least, excess[mine], other, more)


def best_baseline(record: Record) -> Result | None:
    """The best baseline among those that satisfy every limit; None without any.

    That is the one that identifies the most parameters, and of those that identify all, the one of the
    largest objective; where none does, the most precise about what it identifies.
    """
    driven = [one for one in record.results if one.origin == "baseline" and one.feasible]
    return max(driven, key=lambda one: _rank(record, one), default=None)


def _rank(record: Record, one: Result) -> tuple[int, bool, float]:
    known, asked = [each for each in judged(record) if identifies(one, each)], judged(record)
    # Without noise no standard error is known, and objectives are all there is.
    if len(known) == len(asked) or not any(one.standard_deviations.values()):
        return len(known), not one.useless, one.worth or -math.inf
    errors = [(one.standard_deviations[each.name] or 1.0) / (abs(each.nominal) or 1.0) for each in known]
    return len(known), False, -sum(map(math.log, errors))


def _pattern(baseline: Result) -> str:
    # What is driven, of whichever length.
    return words(kind_of(baseline))


def title_of(record: Record) -> str:
    """What was asked for: a drive of how long, in which room."""
    room = next((one for one in record.study.every_limit if isinstance(one, Workspace)), None)
    turning, where = record.best is not None and in_place(record.best), _room_text(room) if room else ""
    return SAY("title", record.study.name, chosen_text(record) or duration_text(record), where, turning)


def _room_text(room: Workspace) -> str:
    if isinstance(room, Circle):
        return f"a round room of radius {given_text(room.radius, 'm')}"
    x_min, x_max, y_min, y_max = room.extent
    return f"a room of {given_text(x_max - x_min, 'm')} x {given_text(y_max - y_min, 'm')}"


def rows_of(
    parameters: Sequence[StoredParameter],
    drive: Result,
    beside: Result | None = None,
    units: Mapping[str, Unit] | None = None,
) -> tuple[Estimated, ...]:
    """A row for each parameter with its standard errors; none where there is no noise.

    Args:
        parameters: that are estimated.
        drive: that identifies them.
        beside: another drive, to compare with.
        units: in which parameters are shown, and their factors from SI; usual ones of those not named.
    """
    if not drive.standard_deviations:
        return ()
    return tuple(_row(one, drive, beside, (units or {}).get(one.name)) for one in parameters)


def _row(parameter: StoredParameter, winner: Result, baseline: Result | None, own: Unit | None) -> Estimated:
    unit, factor = own or own_unit(parameter.unit)
    known = winner.standard_deviations.get(parameter.name)
    value = f"{nominal_text(parameter.nominal * factor, known and known * factor)} {unit_text(unit)}".strip()
    other = "" if baseline is None else _error(parameter, baseline, own)
    return Estimated(words(parameter.name), value, _error(parameter, winner, own), other)


def _error(parameter: StoredParameter, result: Result, own: Unit | None) -> str:
    size = result.standard_deviations.get(parameter.name)
    if size is None:
        return SAY("open")
    if not identifies(result, parameter):
        return SAY("beyond")
    return deviation_text(size, parameter.unit) if own is None else quantity(size * own[1], own[0], 2)


def _compared(record: Record, winner: Result, baseline: Result | None) -> str:
    if baseline is None:
        why = {words(one.name): list(one.violations) for one in record.results if one.origin == "baseline"}
        return SAY("undriven", why) if why else ""
    name = _pattern(baseline)
    if baseline.name == winner.name:
        return SAY("baseline", name)
    own = [one for one in judged(record) if identifies(winner, one)]
    unidentified = [one.name for one in own if not identifies(baseline, one)]
    if unidentified or baseline.useless:
        return SAY("useless", name, unidentified)
    return _weighted(record, winner, baseline)


def _weighted(record: Record, winner: Result, baseline: Result) -> str:
    # In drives, which every error in sight bears out; else in how many times the errors are as large.
    name, share = _pattern(baseline), study_aim(record).efficiency(baseline.worth or 0.0, winner.worth or 0.0)
    if share is not None and share > 1 + EQUAL:
        return SAY("better", name)
    drives, needed = _drives(record.parameters, winner, baseline), repetitions_of(record, baseline)
    if not drives:
        return "" if needed is None else SAY("by_criterion", name, needed, EQUAL)
    worse = [one for one, number in drives.items() if number < 1 - EQUAL]
    alike = [one for one, number in drives.items() if 1 - EQUAL <= number <= 1 + EQUAL]
    low, high = min(drives.values()), max(drives.values())
    if high <= 1 + EQUAL:
        return _together(record, winner, baseline, worse)
    if not repeatable(record) or high > MANY:
        return SAY("smaller", name, math.sqrt(low), math.sqrt(high), worse, alike)
    return SAY("repetitions", name, low, high, worse, alike)


def _together(record: Record, winner: Result, baseline: Result, worse: list[str]) -> str:
    # No parameter by itself is more precise: only what the criterion makes of all of them.
    aim, worths = study_aim(record), (baseline.worth or 0.0, winner.worth or 0.0)
    share, what = aim.efficiency(*worths), _standard_error(record)
    if what and share:
        return SAY("together", _pattern(baseline), what, share**-0.5, share < 1 - EQUAL, worse)
    ahead = aim.change(*worths) < -100 * EQUAL
    return SAY("together", _pattern(baseline), aim.named, None, ahead, worse)


def _standard_error(record: Record) -> str:
    # What the study's criterion is about; "" where that is no standard error.
    return study_aim(record).criterion.standard_error([words(one.name) for one in judged(record)])


def _drives(parameters: Sequence[StoredParameter], winner: Result, baseline: Result) -> dict[str, float]:
    # Number of baseline drives that reach the designed drive's standard error, by parameter; 0 where the
    # baseline alone identifies the parameter.
    drives = {}
    for one in parameters:
        designed, usual = (result.standard_deviations.get(one.name) for result in (winner, baseline))
        if usual:
            drives[one.name] = (usual / designed) ** 2 if designed else 0.0
    return drives


def _proved(record: Record, winner: Result) -> str:
    found = record.certificate
    if found is None:
        return ""
    bound, aim = found.gap_to or found.upper_bound, study_aim(record)
    share = None if winner.worth is None else aim.efficiency(winner.worth, bound)
    what = _standard_error(record)
    absent = [one for one in found.assumptions if one.endswith("left out")]
    if what and share:
        # Its square is what efficiencies compare.
        return SAY("smallest", what, max(share**-0.5, 1.0), TWICE, absent)
    gap = found.gap if not share else 1 / share - 1
    return SAY("proved", aim.named, None if gap is None else max(gap, 0.0), absent)


def _holds(record: Record, winner: Result) -> str:
    simulations = record.validation
    simulated = [] if simulations is None else simulations.results
    own = [one for one in simulated if one.name == winner.name]
    replicates = simulations.replicates if simulations is not None and own else 0
    agreement = "" if simulations is None else simulations.agreement(own)
    failed = [check.question for one in own for check in one.checks if not check.passed]
    violating, departing = _violating(record, winner), bool(_departing(record, winner))
    satisfied = violating is None and not departing
    return SAY("holds", replicates, failed, agreement, violating, f"{100 * (1 - TAIL):g}", satisfied)


def _violating(record: Record, winner: Result) -> float | None:
    # Largest probability that robots violate limits; None where that was not simulated, or where these are
    # robots that leave, of which another sentence tells.
    tried, departures = record.robustness, record.departures
    if tried is None or (departures is not None and set(tried.limits) <= set(departures.limits)):
        return None
    return next((entry.interval[1] for entry in tried.results if entry.name == winner.name), None)


def _departing(record: Record, winner: Result) -> str:
    return "" if record.departures is None else record.departures.sentence(winner.name)


def _warns(record: Record, winner: Result) -> bool:
    return record.departures is not None and record.departures.warns(winner.name)
