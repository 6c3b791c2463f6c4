"""Drives of robots other than the nominal one: how likely they violate the limits, and what that costs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from oed.foundation.arrays import Array
from oed.foundation.text import chance_text, fixed, listing, significant, whole, words
from oed.kernel.results import TOLERANCE
from oed.kernel.solution import NOMINAL
from oed.records.record import Record
from oed.records.stored.result import Result
from oed.records.stored.simulation import Paths, StatesOverTime, StoredRobustness, Tried, Uncertain
from oed.report.figures import courses, paths, spec
from oed.report.figures.driven import room_of
from oed.report.parts.experiments import MOST_QUANTITIES, scale_of
from oed.report.parts.judging import study_aim
from oed.report.parts.prose import Prose
from oed.report.parts.reading import called, called_by, time_scale
from oed.report.parts.section import Column, Picture, Section, Table, percent
from oed.robots.limits import EndHeading, EndPosition

SAY = Prose("robustness")


def robustness(record: Record) -> Section | None:
    """How likely a robot is to violate the limits on each drive, by simulation, and the price of that."""
    found = record.robustness
    if found is None or not found.results:
        return None
    pictures = (_bundles(record, found), _spreads(record, found))
    parts = (*_sentences(record, found), *pictures, _table(record, found))
    made = Section.of("Robots other than the nominal one", *parts)
    return replace(made, brief=(len(made.paragraphs), 0))


def _sentences(record: Record, found: StoredRobustness) -> Iterator[str]:
    # Where every robot ends cannot be asked for: nothing corrects it on its way.
    given = {one.name for one in record.study.every_limit}
    ends = [name for name in (EndPosition.name, EndHeading.name) if name in given]
    searched = [(called_by(record, one.name), one) for one in found.results if one.back_off is not None]
    yield SAY("verdict", found.kind, searched)
    yield SAY("uncertain", found, [_range(record, one) for one in found.uncertain], TOLERANCE)
    yield SAY("ends", ends)
    if record.study.domain != "robots":
        yield SAY("untightened", [one.name for one in record.study.every_limit if one.looks_at == "run"])
    plain = next((one for one in found.results if one.name == NOMINAL), None)
    best = record.best
    if plain is None or plain.objective is None or best is None or best.objective is None:
        return
    share = study_aim(record).efficiency(best.objective, plain.objective)
    if share is not None:
        yield SAY("cost", called(record, best), share, called_by(record, plain.name), plain)


def _range(record: Record, one: Uncertain) -> str:
    own = record.study.shown_units.get(one.name)
    below, above = one.nominal - one.low, one.high - one.nominal
    return SAY("range", one, own, above, abs(above - below) <= 1e-9 * (above + below))


def _table(record: Record, found: StoredRobustness) -> Table:
    objective = f"objective, {study_aim(record).number}"
    columns = (
        Column("drive", cell=lambda one: called_by(record, one.name)),
        Column(objective, "", significant(4), lambda one: one.objective),
        Column("violation probability", "%", fixed(2), lambda one: 100 * one.probability),
        Column(
            "95 % interval", "%", cell=lambda one: " to ".join(f"{100 * end:.2f}" for end in one.interval)
        ),
        Column("farthest beyond", "% of the limit", fixed(1), lambda one: percent(one.farthest)),
        Column("draws", "", whole, lambda one: one.draws),
    )
    return Table.of(found.results, columns, "How likely robots are to violate the limits")


def _bundles(record: Record, found: StoredRobustness) -> Picture | None:
    if not found.bundles:
        return None
    tried = {one.name: one for one in found.results}
    cases = [_bundle(record, tried[one.name], one) for one in found.bundles]
    alt = f"Bundles of the paths that may happen, {listing([one.title for one in cases])}"
    caption = SAY("bundles", len(found.bundles[0].violating))
    return Picture("bundles", alt, caption, paths.bundles(cases, room_of(record)))


def _spreads(record: Record, found: StoredRobustness) -> Picture | None:
    # What other systems do on the best design.
    best = record.best
    own = next((one for one in found.courses or () if best is not None and one.name == best.name), None)
    if own is None or best is None or best.drive is None:
        return None
    unit, factor = time_scale(record.study.space.duration)
    shown = [
        _spread(record, best, own, place, factor) for place in range(min(len(record.states), MOST_QUANTITIES))
    ]
    figure = courses.spreads(shown, spec.Axis("time", unit))
    return Picture("spread", SAY("spread_alt"), SAY("spread", len(own.violating)), figure)


def _spread(record: Record, best: Result, own: StatesOverTime, place: int, factor: float) -> courses.Spread:
    state = record.states[place]
    scale = scale_of(record, state.name, state.unit)
    assert best.drive is not None
    times = [factor * np.array(one) for one in own.times]

    def lines(violating: bool) -> list[Array]:
        return [
            np.column_stack([at, scale.factor * np.array(run)[:, place]])
            for one, leaves in zip(own.states, own.violating, strict=True)
            if leaves == violating
            for at, run in zip(times, one, strict=True)
        ]

    nominal = [
        np.column_stack([np.linspace(at[0], at[-1], len(run)), scale.factor * run[:, place]])
        for at, run in zip(times, best.drive.by_run, strict=True)
    ]
    # A limit on the state itself.
    limits: list[Any] = [one for one in record.study.every_limit if one.looks_at == "state"]
    low, high = next((one.bounds for one in limits if one.of == state.name), (np.nan, np.nan))
    bounds = (scale.factor * low, scale.factor * high) if np.isfinite([low, high]).all() else None
    return courses.Spread(words(state.name), scale.unit, nominal, lines(False), lines(True), bounds)


def _bundle(record: Record, tried: Tried, bundle: Paths) -> paths.Bundle:
    result = record.result(bundle.name)
    assert result is not None
    assert result.drive is not None
    robots = list(zip(bundle.paths, bundle.violating, strict=True))
    inside, outside = (
        tuple(np.array(path) for runs, leaves in robots if leaves == side for path in runs)
        for side in (False, True)
    )
    # None of so many is no proof that there is none.
    share = chance_text(tried.probability)
    if not tried.probability:
        share = f"less than {chance_text(tried.interval[1])}"
    nominal = tuple(poses[:, :2] for poses in result.drive.by_run)
    return paths.Bundle(f"{called(record, result)}: {share} violate", inside, outside, nominal)
