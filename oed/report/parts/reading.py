"""What a report reads out of a record: results, runs, what is measured, what is known of the parameters."""

from __future__ import annotations

import math
import re

from oed.foundation.component import Component
from oed.foundation.own.part import OwnPart
from oed.foundation.text import count, deviation_text, given_text, listing, quantity, words
from oed.kernel.measurement.measurement import FRAME
from oed.kernel.measurement.prior import Prior
from oed.kernel.problem import Problem
from oed.kernel.solution import NOMINAL
from oed.records.record import Record
from oed.records.stored.result import Result
from oed.records.stored.selection import StoredSelection
from oed.records.stored.study_record import StoredNuisance, StoredParameter
from oed.report.parts.prose import Prose
from oed.robots.sensors import Displacements

SAY = Prose("reading")
NOWHERE = 1e-3
"""Path length [m] below which a drive goes nowhere."""
VARIANT = "_same_length"
"""What names of baselines end in that go as far as the design."""
STATES = ("x", "y", "heading")
START = r"start(?:_(\d+))?"
"""What start states of a system are nuisances of, of several runs with the run's number."""
TAKEN = 1e-3
"""Weight, as a share of the most, from which a reading counts as taken."""


def with_drive(record: Record) -> list[Result]:
    """The results that have a drive, feasible or not."""
    return [one for one in record.results if one.drive is not None]


def or_infinite(result: Result, number: float | None) -> float | None:
    """A number of a result; infinite where a drive was scored but JSON could not hold the number."""
    return math.inf if number is None and result.drive is not None else number


def drivable(record: Record) -> list[Result]:
    """The drives to choose from: those that satisfy every limit, of each kind of baseline the better one.

    All drives where none satisfies every limit.
    """
    known = with_drive(record)
    kinds: dict[str, Result] = {}
    for one in known:
        if one.feasible:
            other = kinds.get(kind_of(one))
            kinds[kind_of(one)] = one if other is None else max(other, one, key=_worth)
    return list(kinds.values()) or known


def kind_of(result: Result) -> str:
    """A result's name, of a baseline as long as the design its kind's."""
    return result.name.removesuffix(VARIANT)


def _worth(result: Result) -> float:
    return -math.inf if result.worth is None or result.useless else result.worth


def called(record: Record, result: Result) -> str:
    """What a drive is called: `Designed drive`, `Design 2`, `Figure eight`; not by what found it."""
    if result.origin != "search":
        return capital(words(result.name)) if result.origin == "baseline" else words(result.name)
    if record.best is not None and result.name == record.best.name:
        return "Designed drive"
    if result.name == NOMINAL:
        return "Design for the nominal robot"
    others = [one.name for one in record.results if one.origin == "search" and one.name != NOMINAL]
    first = record.best.name if record.best is not None else ""
    number = 1 + sorted(others, key=lambda name: name != first).index(result.name)
    return f"Design {number}"


def called_by(record: Record, name: str) -> str:
    """What the drive of that name is called, whether or not the record has it."""
    result = record.result(name)
    return words(name) if result is None else called(record, result)


def found_by(result: Result) -> str | None:
    """The search that found a design, `Ipopt`; None for what was not searched for by its name."""
    return capital(words(result.name)) if result.origin == "search" and result.name != NOMINAL else None


def with_method(record: Record, result: Result) -> str:
    """What a drive is called, with the search that found it: `Designed drive (Ipopt)`."""
    method = found_by(result)
    return called(record, result) + (f" ({method})" if method else "")


def capital(text: str) -> str:
    """A text that begins with a capital letter."""
    return text[:1].upper() + text[1:]


def heading(result: Result, title: str = "") -> str:
    """What a result is called, and below it what is special about it: its variant, limits it breaks."""
    name, variant, _ = (title or result.name).replace(" ", "_").partition(VARIANT)
    broken = [words(limit) for limit in result.violations]
    what = broken[0] if len(broken) == 1 else f"{len(broken)} limits"
    notes = ["same length"] if variant else []
    notes += ["in place"] if in_place(result) else []
    return "\n".join(filter(None, [words(name), ", ".join(notes), f"violates {what}" if broken else ""]))


def in_place(result: Result) -> bool:
    """Whether a drive goes nowhere: it turns, or rests."""
    return result.path_length is not None and result.path_length < NOWHERE


def solver_of(record: Record, result: Result) -> Component | None:
    """The search that made a result; None for anything but a search."""
    solvers = () if result.origin == "baseline" else record.study.solvers
    return next((one for one in solvers if one.label == result.name), None)


def runs_of(record: Record) -> int:
    """How many runs the designed drives consist of."""
    return record.study.space.runs


def duration_text(record: Record) -> str:
    """How long the designed drives last: `8 s`, `3 runs of 8 s`."""
    space = record.study.space
    if record.states_are_none:
        return count(space.samples, "setting")
    duration, runs = _lasting(record), runs_of(record)
    return duration if runs == 1 else f"{runs} runs of {duration}"


def chosen_text(record: Record) -> str:
    """How much the best experiment takes of what it may choose among: `3 of 201 settings`, `2 of 18 runs of
    2 h`, `4 of 10 readings in 1 s`; "" where all of it.
    """
    best = record.best
    if best is None or best.selection is None or record.study.domain == "robots":
        return ""
    places, samples = taken(best.selection), record.study.space.samples
    if record.states_are_none:
        settings = {place % samples for place in places}
        return f"{len(settings)} of {count(samples, 'setting')}" if len(settings) < samples else ""
    every = best.selection.readings
    read = {every[place].run for place in places}
    if len(read) < runs_of(record):
        return f"{len(read)} of {duration_text(record)}"
    if len(places) < len(every):
        return f"{len(places)} of {count(len(every), 'reading')} in {duration_text(record)}"
    return ""


def taken(found: StoredSelection) -> list[int]:
    """Places of the readings that are taken."""
    least = TAKEN * max(one.most for one in found.budgets)
    return [place for place, one in enumerate(found.readings) if one.weight > least]


def _lasting(record: Record) -> str:
    # Of one run; of what is no robot in a unit that suits it, and as long as the design has it.
    planned, best = record.study.space.duration, record.best
    if record.study.domain == "robots":
        return f"{planned:g} s"
    chosen = (
        planned if best is None or best.drive is None else best.drive.trajectory.duration / best.drive.runs
    )
    unit, factor = time_scale(chosen)
    given = math.isclose(chosen, planned, rel_tol=1e-6)
    return f"{factor * chosen:.4g} {unit}" if given else quantity(factor * chosen, unit)


def problem_of(record: Record) -> Problem | None:
    """The problem of a record's study; None where code would have to be run for it."""
    if isinstance(getattr(record.study, "system", None), OwnPart):
        return None
    return record.study.problem()


TIMES = (("d", 86400.0, 5.0), ("h", 3600.0, 3.0), ("min", 60.0, 5.0), ("s", 1.0, 0.0))
"""Units of time [s], and from how many of them on they are shown."""


def time_scale(duration: float) -> tuple[str, float]:
    """The unit in which times of an experiment are shown, and its factor from s.

    Args:
        duration: of it [s].
    """
    return next((unit, 1 / size) for unit, size, least in TIMES if duration >= least * size)


def regression_of(record: Record) -> Displacements | None:
    """The displacements of segments that are measured, the paper's way; None where sensors are read."""
    measurement = record.study.measurement
    return measurement if isinstance(measurement, Displacements) else None


def segments(record: Record, samples: int) -> int | None:
    """Number of segments P of a displacement measurement of a run of that many samples."""
    regression = regression_of(record)
    return None if regression is None else regression.segment_count(samples)


def measured_as(record: Record) -> str:
    """`the displacements of 10 segments`, `201 poses (x, y and heading)`."""
    return f"{record.study.measurement.brief(record.study.space.samples)}{_each_run(record)}"


def readings_text(record: Record) -> str:
    """All sensors, with when they are read and their noise."""
    sentence = record.study.measurement.sentence(record.study.space.samples)
    return f"What is read{_each_run(record)}: {sentence}."


def _each_run(record: Record) -> str:
    return " in each run" if runs_of(record) > 1 else ""


def nuisance_text(record: Record) -> str:
    """The nuisance parameters and their priors; "" for none."""
    return SAY("nuisances", [f"{_called(name)}{_known(ones)}" for name, ones in _grouped(record).items()])


def nuisance_names(record: Record) -> list[str]:
    """The nuisance parameters, each with its article."""
    return [_called(name) for name in _grouped(record)]


def _grouped(record: Record) -> dict[str, list[StoredNuisance]]:
    # initial_pose.x, initial_pose.y -> initial_pose; poses.lever_arm.x -> poses.lever_arm; yaw_rate.bias;
    # landmarks.landmark_7.x -> landmarks.places.
    groups: dict[str, list[StoredNuisance]] = {}
    for one in record.nuisances:
        if _begins_exactly(record, one.name):
            continue
        full = re.sub(r"^initial_pose_\d+\.", "initial_pose_of_each_run.", one.name)
        full = re.sub(r"^[^.]+\.(beacon|landmark|tag)_[^.]+\.", r"\1s.places.", full)
        name, _, last = full.rpartition(".")
        groups.setdefault(name if last in STATES else full, []).append(one)
    return groups


def _begins_exactly(record: Record, name: str) -> bool:
    # Beside unknown initial values known ones are nuisances of next to no deviation.
    owner, _, state = name.rpartition(".")
    return bool(re.fullmatch(START, owner)) and state in record.study.known_starts


def _called(name: str) -> str:
    owner, _, what = name.rpartition(".")
    if begun := re.fullmatch(START, owner):
        return f"the initial {words(what)}" + (f" of run {begun[1]}" if begun[1] else "")
    return f"the {words(what)} of the {words(owner)}" if owner else f"the {words(name)}"


def _known(nuisances: list[StoredNuisance]) -> str:
    if all(one.deviation == FRAME for one in nuisances):
        return " (the frame of the map)"
    sizes = [f"± {given_text(one.deviation, one.unit)}" for one in nuisances if one.deviation is not None]
    return f" (prior: {listing(list(dict.fromkeys(sizes)))})" if sizes else ""


def prior_text(record: Record) -> str:
    """The prior on the parameters; "" without one."""
    prior = record.study.prior
    return SAY("prior", prior_of(record), bool(prior.covariance)) if isinstance(prior, Prior) else ""


def prior_of(record: Record) -> dict[str, str]:
    """Prior standard deviations by parameter, as they are shown; {} without a prior."""
    prior, table = record.study.prior, {one.name: one for one in record.parameters}
    if not isinstance(prior, Prior):
        return {}
    given = {name: _given(size, table.get(name)) for name, size in prior.standard_deviations.items()}
    for index, name in enumerate(prior.parameters):
        one = table[name]
        size, own = math.sqrt(prior.covariance[index][index]), record.shown_unit(name, one.unit)
        given[name] = deviation_text(size, one.unit, own)
    return given


def _given(size: float | str, parameter: StoredParameter | None) -> str:
    # As the study says it; a bare number is in SI units.
    if isinstance(size, str) or parameter is None:
        return str(size)
    return deviation_text(size, parameter.unit)
