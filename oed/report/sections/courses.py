"""What happens in the best experiment over time: inputs, readings and states, and sensitivities."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from oed.foundation.arrays import Array
from oed.foundation.text import words
from oed.kernel.courses import Course, reading_courses, response_courses, state_courses
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.problem import Problem
from oed.records.record import Record
from oed.records.stored.result import Result
from oed.report.figures import courses as figures
from oed.report.figures import spec
from oed.report.figures.courses import SAME, Band, Held, Sensitivity
from oed.report.parts.experiments import (
    MOST_QUANTITIES,
    band_of,
    best_of,
    by_quantity,
    drawn_trials,
    read_trials,
    scale_of,
    trial_names,
    widths_of,
)
from oed.report.parts.inputs import groups_of
from oed.report.parts.prose import Prose
from oed.report.parts.reading import drivable, taken, time_scale
from oed.report.parts.section import Picture, Section
from oed.report.sections.drives import input_picture

SAY = Prose("courses")
DRAWN = 400
"""Settings of an input at which a response is drawn, and the least number of times of a course."""
FEW = 40
"""Settings that are marked in a figure of sensitivities."""
NARROW = 6.6
"""Width of a figure beside the answer [inch]."""


def inputs_picture(record: Record) -> Picture | None:
    """The inputs of the best experiment over time, those that change; None where none does."""
    best = record.best
    if record.states_are_none or best is None or best.drive is None:
        return None
    unit, factor = time_scale(record.study.space.duration)
    shown = [
        [_held(record, run, place, factor) for run in _trials(best)]
        for place in changing_inputs(best)[:MOST_QUANTITIES]
    ]
    if not shown:
        return None
    figure = figures.held(shown, spec.Axis("time", unit), trial_names(best), NARROW)
    names = [each[0].title for each in shown]
    return Picture("inputs", SAY("inputs_alt", names), SAY("inputs", _undrawn(best)), figure)


def changing_inputs(best: Result) -> list[int]:
    """Places of the inputs that change within a trial."""
    assert best.drive is not None
    tables = [one.inputs for one in best.drive.trajectory.each]
    width = tables[0].shape[1]
    sizes = [max(float(np.abs(one[:, place]).max()) for one in tables) for place in range(width)]
    changes = [max(float(np.ptp(one[:, place])) for one in tables) for place in range(width)]
    return [place for place in range(width) if changes[place] > SAME * sizes[place]]


def _held(record: Record, trial: Trajectory, place: int, factor: float) -> Held:
    one = record.inputs[place]
    scale = scale_of(record, one.name, one.unit)
    limits = [limit for limit in record.study.every_limit if limit.name == one.name]
    low, high = getattr(limits[0], "bounds", (-np.inf, np.inf)) if limits else (-np.inf, np.inf)
    bounds = (scale.factor * low, scale.factor * high) if np.isfinite([low, high]).all() else None
    edges = factor * np.linspace(0.0, trial.duration, trial.samples + 1)
    return Held(words(one.name), scale.unit, edges, scale.factor * trial.inputs[:, place], bounds)


def _trials(best: Result) -> list[Trajectory]:
    assert best.drive is not None
    each = best.drive.trajectory.each
    return [each[run] for run in drawn_trials(best)]


def _undrawn(best: Result) -> int:
    # Of trials that are read and not drawn.
    return len(read_trials(best)) - len(drawn_trials(best))


def courses(record: Record) -> Section | None:
    """Readings and states of the best experiment over time, with their bands; None of settings."""
    found = best_of(record)
    if record.states_are_none or found is None:
        return _recorded(record)
    problem, best = found
    assert best.drive is not None
    drive, trials = best.drive.trajectory, drawn_trials(best)
    unit, factor = time_scale(problem.design.duration)
    across, finer = spec.Axis("time", unit), _finer(drive)
    known = reading_courses(problem, drive, finer)
    read = by_quantity(known, trials, lambda one, run: _read(record, one, run, factor))
    pictures = []
    if read:
        figure = figures.bands(read, across, trial_names(best))
        note = SAY("outputs", any(map(figures.marked, read)), widths_of(read), _undrawn(best))
        pictures.append(Picture("readings", "Readings over time", note, figure))
    followed = state_courses(problem, drive, finer)
    hidden = _unread(followed, known)
    states = by_quantity(hidden, trials, lambda one, _: band_of(record, one, factor * one.places))
    if states:
        figure = figures.bands(states, across, trial_names(best))
        note = SAY("states", bool(read), widths_of(states), _undrawn(best))
        pictures.append(Picture("states", "States over time", note, figure))
    return Section("What happens", figures=tuple(pictures))


def _recorded(record: Record) -> Section | None:
    # The states at the samples, as the record has them, of a system whose code is not run for a page.
    best = record.best
    if record.states_are_none or best is None or best.drive is None:
        return None
    unit, factor = time_scale(record.study.space.duration)
    shown = []
    for place, one in enumerate(record.states[:MOST_QUANTITIES]):
        scale = scale_of(record, one.name, one.unit)
        shown.append(
            [
                Band(
                    words(one.name),
                    scale,
                    factor * np.linspace(0.0, trial.duration, trial.samples + 1),
                    best.drive.by_run[run][:, place],
                )
                for run, trial in zip(drawn_trials(best), _trials(best), strict=True)
            ]
        )
    figure = figures.bands(shown, spec.Axis("time", unit), trial_names(best))
    note = SAY("recorded", _undrawn(best))
    return Section("What happens", figures=(Picture("states", "States over time", note, figure),))


def _finer(drive: Trajectory) -> int:
    # Places of every period that make a smooth line.
    return -(-DRAWN // (drive.samples // drive.runs))


def _unread(followed: Sequence[Sequence[Course]], known: Sequence[Sequence[Course]]) -> list[list[Course]]:
    # A state that is read as it is would be drawn twice.
    apart = [
        place
        for place, one in enumerate(followed[0])
        if not any(np.array_equal(one.values, other.values) for other in known[0])
    ]
    return [[each[place] for place in apart] for each in followed]


def _read(record: Record, course: Course, run: int, factor: float) -> Band:
    band = band_of(record, course, factor * course.places)
    places = _taken(record, course, run)
    # What is read all the time has no moments.
    if not places or course.deviation is None:
        return band
    return replace(
        band,
        read=factor * course.places[places],
        readings=course.values[places],
        noise=course.deviation,
    )


def _taken(record: Record, course: Course, run: int) -> list[int]:
    # Of its places those that are read in a run.
    best, places = record.best, list(course.read)
    if best is None or best.selection is None:
        return places
    chosen = set(taken(best.selection))
    own = [
        place in chosen
        for place, one in enumerate(best.selection.readings)
        if one.sensor == course.sensor and one.run == run
    ]
    if len(own) != len(places):
        return []
    return [place for place, one in zip(places, own, strict=True) if one]


def sensitivity(record: Record) -> Section | None:
    """By how much readings change with each parameter; None of settings of several inputs."""
    found = best_of(record)
    if found is None:
        return None
    problem, best = found
    chosen: Sequence[float] = ()
    if record.states_are_none:
        if len(record.inputs) != 1:
            return None
        one = record.inputs[0]
        scale = scale_of(record, one.name, one.unit)
        settings = chosen_settings(best)
        low, high = ends_of(problem, settings)
        read = [response_courses(problem, 0, np.linspace(low, high, DRAWN))]
        across, factor = spec.Axis(words(one.name), scale.unit), scale.factor
        chosen = (factor * settings).tolist()
        trials, names = [0], list[str]()
    else:
        assert best.drive is not None
        read = reading_courses(problem, best.drive.trajectory, _finer(best.drive.trajectory))
        unit, factor = time_scale(problem.design.duration)
        across = spec.Axis("time", unit)
        trials, names = drawn_trials(best), trial_names(best)
    if not read[0]:
        return None
    shown = _sensitivities(record, problem, [read[run] for run in trials], names, factor)
    parameters = [name for name in problem.any_estimations[0].parameters if name not in problem.constants]
    figure = figures.sensitivities(
        shown, parameters, across, chosen if len(chosen) <= FEW else (), len(trials) if names else 0
    )
    caption = SAY("sensitivity", record.states_are_none and len(chosen) <= FEW)
    picture = Picture("sensitivities", "How readings change with the parameters", caption, figure)
    return Section("Sensitivity of the readings", figures=(picture,))


def _sensitivities(
    record: Record,
    problem: Problem,
    read: Sequence[Sequence[Course]],
    trials: Sequence[str],
    factor: float,
) -> list[Sensitivity]:
    # Quantity by quantity, and of each trial by trial.
    sizes = np.array([abs(value) or 1.0 for value in problem.any_estimations[0].nominal])
    return [
        Sensitivity(
            ", ".join(filter(None, [words(one.name), trial])),
            scale_of(record, one.name, one.unit),
            factor * one.places,
            one.slopes * sizes[: one.slopes.shape[1]],
        )
        for each in list(zip(*read, strict=True))[:MOST_QUANTITIES]
        for one, trial in zip(each, trials or [""], strict=True)
    ]


def response(record: Record) -> Picture | None:
    """What is read over the only input of a system without states, with the settings that are chosen."""
    found = best_of(record)
    if not record.states_are_none or len(record.inputs) != 1 or found is None:
        return None
    problem, best = found
    name, scale = record.inputs[0].name, scale_of(record, record.inputs[0].name, record.inputs[0].unit)
    settings = chosen_settings(best)
    low, high = ends_of(problem, settings)
    over = np.unique(np.concatenate([np.linspace(low, high, DRAWN), settings]))
    shown = [
        [
            replace(
                band_of(record, one, scale.factor * over),
                read=scale.factor * settings,
                readings=one.values[np.searchsorted(over, settings)],
                noise=one.deviation,
            )
        ]
        for one in response_courses(problem, 0, over)[:MOST_QUANTITIES]
    ]
    figure = figures.bands(shown, spec.Axis(words(name), scale.unit), width=NARROW)
    note = SAY("response", widths_of(shown))
    return Picture("response", f"What is read over {words(name)}", note, figure)


def settings_picture(record: Record) -> Picture | None:
    """The settings of two inputs in their plane, between their limits."""
    found = best_of(record)
    if not record.states_are_none or len(record.inputs) != 2 or found is None:
        return None
    problem, best = found
    assert best.drive is not None
    table, weights = best.drive.trajectory.inputs, None
    if best.selection is not None:
        chosen = taken(best.selection)
        weights = [best.selection.readings[place].weight for place in chosen]
        table = table[[place % len(table) for place in chosen]]
    axes, columns = [], []
    for place, one in enumerate(record.inputs):
        scale = scale_of(record, one.name, one.unit)
        low, high = ends_of(problem, table[:, place], place)
        room = 0.08 * ((high - low) or 1.0)
        ends = scale.factor * (low - room), scale.factor * (high + room)
        axes.append(spec.Axis(words(one.name), scale.unit, ends))
        columns.append(scale.factor * table[:, place])
    places, labels = _together(np.column_stack(columns), weights)
    figure = figures.settings(places, labels, axes[0], axes[1], NARROW)
    names = [one.name for one in record.inputs]
    note = SAY("settings", weights is not None, any(labels))
    return Picture("settings", SAY("settings_alt", names), note, figure)


def _together(table: Array, weights: Sequence[float] | None) -> tuple[Array, list[str]]:
    # Settings that cannot be distinguished are one dot, with how many there are, or their weight, beside it.
    size = np.abs(table).max(axis=0)
    _, first, own = np.unique(
        np.round(table / np.where(size > 0, size, 1.0), 3), axis=0, return_index=True, return_inverse=True
    )
    totals = np.bincount(own.ravel(), weights)
    if weights is None:
        return table[first], [f"{count:.0f} ×" if count > 1 else "" for count in totals]
    return table[first], [f"{total:.3g}" for total in totals]


def chosen_settings(best: Result) -> Array:
    """Settings of the only input that are read, rising."""
    assert best.drive is not None
    table = best.drive.trajectory.inputs[:, 0]
    if best.selection is None:
        return np.unique(table)
    return np.unique([table[place % len(table)] for place in taken(best.selection)])


def ends_of(problem: Problem, settings: Array, place: int = 0) -> tuple[float, float]:
    """The least and the largest setting of an input that may be chosen, SI.

    Args:
        problem: that says so.
        settings: that are chosen, of an input that nothing bounds.
        place: of the input.
    """
    low, high = problem.input_bounds[place]
    only = problem.design.only
    if only is not None:
        low, high = only.inputs[:, place].min(), only.inputs[:, place].max()
    return (float(low), float(high)) if np.isfinite([low, high]).all() else (settings.min(), settings.max())


def inputs(record: Record) -> Section | None:
    """Inputs of all experiments where there are several, and rates of change that are limited."""
    results = drivable(record)
    if record.states_are_none or not record.inputs or not results:
        return None
    several = len(results) > 1
    every = [
        input_picture(record, group, results)
        for pair in groups_of(record, len(record.inputs))
        for group, wanted in zip(pair, (several, bool(pair[1].own_bounds(record))), strict=True)
        if wanted
    ]
    pictures = tuple(one for one in every if one is not None)
    title = "Inputs over time" if several else "How fast inputs change"
    return Section(title, figures=pictures) if pictures else None
