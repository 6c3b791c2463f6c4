"""Rows of instants for a program's slots, at random."""

from __future__ import annotations

import numpy as np

from oed.optimize.exchange import Exchange
from oed.optimize.lower_level import Instants
from oed.optimize.terms.chosen import ChosenRows
from oed.optimize.terms.terms import Terms

SLOTS = 8


def chosen_of(terms: Terms, rng: np.random.Generator, slots: int = SLOTS) -> ChosenRows | None:
    """Rows for so many slots, the last two of them empty; None without such rows."""
    space = terms.problem.design
    if not terms.instants.count:
        return None
    rows, runs = np.nonzero(np.repeat(terms.instants.systems, space.runs, axis=1))
    picked = rng.integers(0, len(rows), slots - 2)
    instants = Instants(rows[picked], runs[picked], rng.uniform(0, space.duration, slots - 2))
    drive = terms.embedding.table(np.zeros(terms.coefficient_count))
    starts = np.zeros((space.runs, len(terms.problem.system.states)))
    exchange = Exchange(terms.problem, terms)
    return exchange.chosen_rows(instants, space.trajectory(drive, starts)).padded(slots)
