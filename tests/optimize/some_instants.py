"""Rows of instants for a program's slots, at random."""

from __future__ import annotations

import numpy as np

from oed.optimize.exchange import Exchange
from oed.optimize.lower_level import Instants
from oed.optimize.terms.base import Terms

SLOTS = 8


def numbers_of(terms: Terms, rng: np.random.Generator, slots: int = SLOTS) -> np.ndarray:
    """What a program with so many slots is given, the last two of them empty; none without such rows."""
    count, space = terms.instants.count, terms.problem.design
    if not count:
        return np.zeros(terms.slots(slots).width)
    rows, runs = (rng.integers(0, most, slots - 2) for most in (count, space.runs))
    instants = Instants(rows, runs, rng.uniform(0, space.duration, slots - 2))
    drive = terms.embedding.table(np.zeros(terms.coefficient_count))
    starts = np.zeros((space.runs, len(terms.problem.system.states)))
    return (
        Exchange(terms.problem, terms).chosen_rows(instants, space.trajectory(drive, starts)).numbers(slots)
    )
