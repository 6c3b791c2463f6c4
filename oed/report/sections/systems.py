"""Sections of systems given by equations: the experiment, what happens in it, and what readings tell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from oed.foundation.arrays import Array
from oed.foundation.text import significant, words
from oed.kernel.courses import Course, reading_courses, response_courses, state_courses
from oed.kernel.problem import Problem
from oed.records.path_file import drive_csv
from oed.records.record import Record
from oed.report.figures import courses as figures
from oed.report.figures import spec
from oed.report.figures.courses import TAKEN, Band, Scale, Sensitivity
from oed.report.parts.judging import judged, meaning
from oed.report.parts.prose import Prose
from oed.report.parts.reading import (
    capital,
    duration_text,
    measured_as,
    nuisance_text,
    prior_text,
    problem_of,
    readings_text,
    runs_of,
    time_scale,
)
from oed.report.parts.section import Column, Download, Picture, Section, Table
from oed.report.sections.drives import wheels
from oed.report.sections.summary import summary

SAY = Prose("systems")
DRAWN = 400
"""Settings of an input at which a response is drawn."""
FEW = 40
"""Settings that are listed."""


def experiment(record: Record) -> Section:
    """The summary, the settings of the best experiment, and what all this assumes."""
    made = replace(summary(record), folds=(Section("What this page assumes", tuple(_assumed(record))),))
    if record.best is None:
        return made
    said = [one.removeprefix(f"{record.study.name}: ") for one in made.paragraphs]
    table, picture = _settings(record), _response(record)
    return replace(
        made,
        paragraphs=(capital(said[0]), *said[1:]),
        tables=(*made.tables, *([table] if table is not None else [])),
        figures=() if picture is None else (picture,),
        downloads=_downloads(record),
    )


def _assumed(record: Record) -> list[str]:
    names, measured = [one.name for one in judged(record)], measured_as(record)
    yours = SAY("points" if record.states_are_none else "question", duration_text(record), names, measured)
    criterion = SAY("criterion", meaning(record))
    bound = SAY("bound", record.certificate) if record.certificate is not None else ""
    said = (yours, readings_text(record), nuisance_text(record), prior_text(record), criterion, bound)
    return [one for one in said if one]


def _downloads(record: Record) -> tuple[Download, ...]:
    best = record.best
    if best is None or best.drive is None:
        return ()
    states, inputs = [one.name for one in record.states], [one.name for one in record.inputs]
    poses = np.array(best.drive.poses, dtype=float).reshape(len(best.drive.poses), len(states))
    return (Download(SAY("csv"), "experiment.csv", drive_csv(best.drive.trajectory, poses, inputs, states)),)


def _settings(record: Record) -> Table | None:
    # Of points, each by its inputs; the smallest first.
    best = record.best
    if not record.states_are_none or best is None or best.drive is None or best.selection is not None:
        return None
    table = best.drive.trajectory.inputs
    if len(table) > FEW:
        return None
    columns = [Column("setting", cell=lambda item: str(item[0]))]
    for place, one in enumerate(record.inputs):
        unit, factor = record.study.shown_units.get(one.name, (one.unit, 1.0))
        columns.append(_column(words(one.name), unit, factor, place))
    order = np.lexsort(table.T[::-1])
    items = [(number, table[row]) for number, row in enumerate(order, start=1)]
    return Table.of(items, columns, SAY("settings", len(table)))


def _column(title: str, unit: str, factor: float, place: int) -> Column:
    return Column(title, unit, significant(5), lambda item: factor * float(item[1][place]))


def _response(record: Record) -> Picture | None:
    # What is read over the only input, with the settings that are chosen.
    best = record.best
    if not record.states_are_none or len(record.inputs) != 1 or best is None or best.drive is None:
        return None
    name, scale = record.inputs[0].name, _scale(record, record.inputs[0].name, record.inputs[0].unit)
    problem, chosen = problem_of(record), _chosen(record)
    if problem is None:
        return None
    low, high = _ends(problem, chosen)
    over = np.unique(np.concatenate([np.linspace(low, high, DRAWN), chosen]))
    shown = [
        replace(
            _band(record, one, scale.factor * over, _covariance(record)),
            read=scale.factor * chosen,
            readings=np.interp(chosen, over, one.values),
            noise=one.deviation,
        )
        for one in response_courses(problem, 0, over)
    ]
    figure = figures.bands(shown, spec.Axis(words(name), scale.unit))
    return Picture("response", f"What is read over the {words(name)}", SAY("response", name, False), figure)


def _chosen(record: Record) -> Array:
    # Settings of the only input that are read.
    best = record.best
    assert best is not None
    assert best.drive is not None
    table = best.drive.trajectory.inputs[:, 0]
    if best.selection is None:
        return np.unique(table)
    most = max(one.most for one in best.selection.budgets)
    return np.unique(
        [table[place] for place, one in enumerate(best.selection.readings) if one.weight > TAKEN * most]
    )


def _ends(problem: Problem, chosen: Array) -> tuple[float, float]:
    low, high = problem.input_bounds[0]
    only = problem.design.only
    if only is not None:
        low, high = only.inputs.min(), only.inputs.max()
    return (float(low), float(high)) if np.isfinite([low, high]).all() else (chosen.min(), chosen.max())


def courses(record: Record) -> Section | None:
    """States and readings of the best experiment over time, with their bands; None of settings."""
    best = record.best
    if record.states_are_none or best is None or best.drive is None:
        return None
    problem, drive = problem_of(record), best.drive.trajectory
    if problem is None:
        return None
    covariance, several = _covariance(record), runs_of(record) > 1
    unit, factor = time_scale(problem.design.duration)
    across = spec.Axis("time", unit)
    followed, known = state_courses(problem, drive)[0], reading_courses(problem, drive)[0]
    # A state that is read as it is would be drawn twice.
    hidden = [one for one in followed if not any(np.array_equal(one.values, other.values) for other in known)]
    states = [_band(record, one, factor * one.places, covariance) for one in hidden]
    read = [_read(record, one, factor, covariance) for one in known]
    marked = any(one.read is not None and len(one.read) <= figures.MOST_MARKS for one in read)
    seen = figures.bands(read, across)
    pictures = [Picture("readings", "Readings over time", SAY("outputs", several, marked), seen)]
    if states:
        below = figures.bands(states, across)
        pictures.append(Picture("states", "States over time", SAY("states", several), below))
    return Section("What happens", figures=tuple(pictures))


def _read(record: Record, course: Course, factor: float, covariance: Array | None) -> Band:
    band = _band(record, course, factor * course.places, covariance)
    places = _taken(record, course)
    # What is read all the time has no moments.
    if not places or course.deviation is None:
        return band
    return replace(
        band,
        read=factor * course.places[places],
        readings=course.values[places],
        noise=course.deviation,
    )


def _taken(record: Record, course: Course) -> list[int]:
    # Of its places those that are read in the first run.
    best, places = record.best, list(course.read)
    if best is None or best.selection is None:
        return places
    own = [one for one in best.selection.readings if one.sensor == course.sensor and one.run == 0]
    if len(own) != len(places):
        return []
    most = max(one.most for one in best.selection.budgets)
    return [place for place, one in zip(places, own, strict=True) if one.weight > TAKEN * most]


def sensitivity(record: Record) -> Section | None:
    """By how much readings change with each parameter."""
    best = record.best
    if best is None or best.drive is None:
        return None
    problem = problem_of(record)
    if problem is None:
        return None
    (estimation,) = problem.any_estimations
    sizes = np.array([abs(value) or 1.0 for value in estimation.nominal])
    names = [name for name in estimation.parameters if name not in problem.constants]
    chosen: Sequence[float] = ()
    if record.states_are_none:
        if len(record.inputs) != 1:
            return None
        low, high = _ends(problem, _chosen(record))
        found = response_courses(problem, 0, np.linspace(low, high, DRAWN))
        scale = _scale(record, record.inputs[0].name, record.inputs[0].unit)
        across, factor = spec.Axis(words(record.inputs[0].name), scale.unit), scale.factor
        chosen = (factor * _chosen(record)).tolist()
    else:
        found = reading_courses(problem, best.drive.trajectory)[0]
        unit, factor = time_scale(problem.design.duration)
        across = spec.Axis("time", unit)
    shown = [
        Sensitivity(
            words(one.name),
            _scale(record, one.name, one.unit),
            factor * one.places,
            one.slopes * sizes[: one.slopes.shape[1]],
        )
        for one in found
    ]
    figure = figures.sensitivities(shown, names, across, chosen if len(chosen) <= FEW else ())
    caption = SAY("sensitivity", record.states_are_none)
    picture = Picture("sensitivities", "How readings change with the parameters", caption, figure)
    return Section("What readings tell", figures=(picture,))


def inputs(record: Record) -> Section | None:
    """The inputs over time, and their rates; None of settings."""
    found = None if record.states_are_none or not record.inputs else wheels(record)
    return found if found is None else replace(found, title="Inputs over time")


def _covariance(record: Record) -> Array | None:
    # Of what is estimated, SI; None where something is open.
    best = record.best
    found = None if best is None or not best.covariances else best.covariances[0].covariance
    if found is None or any(None in row for row in found):
        return None
    return np.array(found, dtype=float)


def _band(record: Record, course: Course, places: Array, covariance: Array | None) -> Band:
    spread = None
    if covariance is not None and len(covariance) == course.slopes.shape[1]:
        spread = course.spread(covariance)
    return Band(words(course.name), _scale(record, course.name, course.unit), places, course.values, spread)


def _scale(record: Record, name: str, unit: str) -> Scale:
    # As the study gives it.
    return Scale(*record.study.shown_units.get(name, (unit, 1.0)))
