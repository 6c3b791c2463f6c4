"""What sections read out of a record of a system: the trials that are drawn, their units and bands."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from oed.foundation.arrays import Array
from oed.foundation.text import quantity, words
from oed.kernel.courses import Course
from oed.kernel.problem import Problem
from oed.records.record import Record
from oed.records.stored.result import Result
from oed.report.figures.courses import Band, Scale
from oed.report.parts.reading import problem_of, taken

MOST_TRIALS = 4
"""Trials that are drawn."""
MOST_QUANTITIES = 8
"""Quantities that are drawn."""


def best_of(record: Record) -> tuple[Problem, Result] | None:
    """A record's problem and the best result that has a design; None where one is missing."""
    best, problem = record.best, problem_of(record)
    return None if best is None or best.drive is None or problem is None else (problem, best)


def read_trials(best: Result) -> list[int]:
    """Numbers, from 0, of the trials that are read."""
    assert best.drive is not None
    if best.selection is None:
        return list(range(best.drive.trajectory.runs))
    return sorted({best.selection.readings[place].run for place in taken(best.selection)})


def drawn_trials(best: Result) -> list[int]:
    """Numbers, from 0, of the trials that are drawn: the first of those that are read."""
    return read_trials(best)[:MOST_TRIALS]


def trial_names(best: Result) -> list[str]:
    """What the trials that are drawn are called; [] of a single one."""
    assert best.drive is not None
    several = best.drive.trajectory.runs > 1
    return [f"trial {run + 1}" for run in drawn_trials(best)] if several else []


def scale_of(record: Record, name: str, unit: str) -> Scale:
    """How a quantity is shown: as the study gives it.

    Args:
        record: of the study.
        name: of the quantity.
        unit: SI unit.
    """
    return Scale(*record.study.shown_units.get(name, (unit, 1.0)))


def covariance_of(record: Record) -> Array | None:
    """The covariance of what is estimated from the best design, SI; None where something is open."""
    best = record.best
    found = None if best is None or not best.covariances else best.covariances[0].covariance
    if found is None or any(None in row for row in found):
        return None
    return np.array(found, dtype=float)


def band_of(record: Record, course: Course, places: Array) -> Band:
    """A course with what estimates leave open of it.

    Args:
        record: whose best design it is of.
        course: of a quantity.
        places: times or settings, as shown.
    """
    covariance, spread = covariance_of(record), None
    if covariance is not None and len(covariance) == course.slopes.shape[1]:
        spread = course.spread(covariance)
    scale = scale_of(record, course.name, course.unit)
    return Band(words(course.name), scale, places, course.values, spread)


def widths_of(shown: Sequence[Sequence[Band]]) -> list[str]:
    """The widest place of each quantity's bands, in words: `prey ± 0.012`."""
    return [
        f"{each[0].title} ± {quantity(each[0].scale.factor * _widest(each), each[0].scale.unit, 2)}"
        for each in shown
        if all(one.open for one in each)
    ]


def _widest(each: Sequence[Band]) -> float:
    return max(float(np.max(np.asarray(one.spread))) for one in each)


def by_quantity(
    found: Sequence[Sequence[Course]], trials: Sequence[int], band: Callable[[Course, int], Band]
) -> list[list[Band]]:
    """Of every quantity its bands in the trials that are drawn.

    Args:
        found: courses, trial by trial.
        trials: numbers of those that are drawn.
        band: of a course in the trial of that number.
    """
    each = zip(*(found[run] for run in trials), strict=True)
    return [[band(one, run) for one, run in zip(some, trials, strict=True)] for some in each][
        :MOST_QUANTITIES
    ]
