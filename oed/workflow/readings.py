"""Which readings of a study's designs are taken: as records have it, and as a table."""

from __future__ import annotations

import csv
import io

import numpy as np

from oed.kernel.problem import Problem
from oed.kernel.solution import Solution
from oed.optimize.selection import select
from oed.records.stored.selection import StoredBudget, StoredReading, StoredSelection

COLUMNS = ("run", "sensor", "t", "weight")
"""Of the table of readings."""


def selection_of(problem: Problem, solution: Solution) -> StoredSelection | None:
    """The chosen readings of a solution; None where none were chosen, or no choice is better than another, as
    where all are too few.
    """
    trajectory = solution.trajectory
    if problem.selection is None or trajectory is None or trajectory.weights is None:
        return None
    chosen, criterion = select(problem, trajectory), problem.objective
    if chosen is None or not np.isfinite(chosen.chosen.value):
        return None
    parts = chosen.parts
    numbers = parts.sizes, chosen.chosen.values, chosen.relaxed.values, chosen.derivatives
    each = zip(parts.readings, *(values.tolist() for values in numbers), strict=True)
    return StoredSelection.of(
        whole=problem.selection.whole,
        budgets=[
            StoredBudget.of(readings=list(one.places), total=one.total, most=one.most)
            for one in chosen.budgets
        ],
        readings=[
            # Plain numbers already: thousands of readings are saved several times.
            StoredReading.model_construct(
                sensor=one.sensor,
                run=one.run,
                time=one.time,
                size=size,
                weight=weight,
                relaxed=relaxed,
                derivative=slope,
            )
            for one, size, weight, relaxed, slope in each
        ],
        value=chosen.chosen.value,
        relaxed=chosen.relaxed.value,
        bound=chosen.bound,
        efficiency=criterion.efficiency(chosen.chosen.value, chosen.bound, parts.judged),
    )


def readings_csv(selection: StoredSelection) -> str:
    """The readings that are taken, with their weights: run (from 1), sensor, time [s], weight."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(COLUMNS)
    for one in selection.readings:
        if one.weight > 0:
            table.writerow([one.run + 1, one.sensor, f"{one.time:.9g}", f"{one.weight:.9g}"])
    return text.getvalue()
