"""Rows of instants for a program's slots, at random."""

from __future__ import annotations

import numpy as np

from oed.optimize.exchange import Exchange
from oed.optimize.lower_level import Instants
from oed.optimize.terms.slots import Chosen
from oed.optimize.terms.terms import Terms

SLOTS = 8


def chosen_of(terms: Terms, rng: np.random.Generator, slots: int = SLOTS) -> Chosen | None:
    """Rows for so many slots but two; None without such rows."""
    space = terms.problem.design
    if not terms.instants.count:
        return None
    rows, runs = np.nonzero(np.repeat(terms.instants.systems, space.runs, axis=1))
    picked = rng.integers(0, len(rows), slots - 2)
    instants = Instants(rows[picked], runs[picked], rng.uniform(0, space.duration, slots - 2))
    drive = terms.embedding.table(np.zeros(terms.coefficient_count))
    starts = np.zeros((space.runs, len(terms.problem.system.states)))
    return Exchange(terms.problem, terms).chosen_rows(instants, space.trajectory(drive, starts))


def numbers_of(terms: Terms, rng: np.random.Generator, slots: int = SLOTS) -> np.ndarray:
    """What a program with so many slots is given, the last two of them empty; none without such rows."""
    chosen = chosen_of(terms, rng, slots)
    return np.zeros(terms.slots(slots).width) if chosen is None else chosen.numbers(slots)
