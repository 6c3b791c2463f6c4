"""The first section of systems given by equations: the experiment, its settings, and what is assumed."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from oed.foundation.arrays import Array
from oed.foundation.text import unit_text, words
from oed.records.path_file import drive_csv
from oed.records.record import Record
from oed.records.stored.study_record import StoredInput, StoredState
from oed.report.parts.experiments import read_trials, scale_of
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
    taken,
)
from oed.report.parts.section import Column, Download, Section, Table
from oed.report.sections.courses import changing_inputs, inputs_picture, response, settings_picture
from oed.report.sections.summary import summary

SAY = Prose("systems")
FEW = 40
"""Settings that are listed."""


def experiment(record: Record) -> Section:
    """The summary, the settings of the best experiment, and what all this assumes."""
    made = replace(summary(record), folds=(Section("What this page assumes", tuple(_assumed(record))),))
    if record.best is None:
        return made
    said = [one.removeprefix(f"{record.study.name}: ") for one in made.paragraphs]
    tables = [one for one in (_settings(record), _trials(record)) if one is not None]
    picture = response(record) or settings_picture(record) or inputs_picture(record)
    return replace(
        made,
        paragraphs=(capital(said[0]), *said[1:]),
        tables=(*made.tables, *tables),
        figures=() if picture is None else (picture,),
        downloads=_downloads(record),
        first=picture is not None,
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
    if not record.states_are_none or best is None or best.drive is None:
        return None
    table, weights = best.drive.trajectory.inputs, None
    if best.selection is not None:
        chosen = taken(best.selection)
        readings = [best.selection.readings[place] for place in chosen]
        if len({one.sensor for one in readings}) > 1:
            # Of several sensors each has its own weights, which the table of readings has.
            return None
        table = table[[place % len(table) for place in chosen]]
        weights = np.array([one.weight for one in readings])
    if len(table) > FEW:
        return None
    order = np.lexsort(table.T[::-1])
    columns = [_column(record, one, table[order, place]) for place, one in enumerate(record.inputs)]
    if weights is not None:
        ordered = weights[order]
        columns.append(Column("weight", "", _five, lambda row: float(ordered[row])))
    return _numbered("setting", range(len(table)), columns, SAY("settings"))


def _trials(record: Record) -> Table | None:
    # Where trials begin, as far as that is chosen, and inputs that each holds from its begin to its end.
    best, problem = record.best, problem_of(record)
    if record.states_are_none or best is None or best.drive is None:
        return None
    ranges, numbers = None if problem is None else problem.design.start_ranges, read_trials(best)
    each = [best.drive.trajectory.each[run] for run in numbers]
    starts, held = np.array([one.starts[0] for one in each]), np.array([one.inputs[0] for one in each])
    chosen: Iterable[int] = () if ranges is None else np.flatnonzero(np.ptp(ranges, axis=1) > 0)
    constant = sorted(set(range(len(record.inputs))) - set(changing_inputs(best)))
    columns = [
        *(_column(record, record.states[place], starts[:, place], "initial ") for place in chosen),
        *(_column(record, record.inputs[place], held[:, place]) for place in constant),
    ]
    return _numbered("trial", numbers, columns, SAY("trials")) if columns and len(each) <= FEW else None


def _numbered(title: str, numbers: Sequence[int], columns: Iterable[Column], caption: str) -> Table:
    number = Column(title, cell=lambda row: str(numbers[row] + 1))
    return Table.of(range(len(numbers)), [number, *columns], caption)


def _column(record: Record, one: StoredInput | StoredState, values: Array, what: str = "") -> Column:
    scale = scale_of(record, one.name, one.unit)
    title = what + words(one.name)
    return Column(title, unit_text(scale.unit), _five, lambda row: scale.factor * float(values[row]))


def _five(value: float) -> str:
    # A setting's digits, without idle zeros.
    return f"{value:.5g}"
