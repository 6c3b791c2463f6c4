"""Perturbations: random changes of a design, of many sizes and kinds, to solve it again from (basin hopping).

[Wales, Doye, "Global optimization by basin-hopping", Journal of Physical Chemistry A 101, 1997.]
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from oed.foundation.arrays import Array
from oed.optimize.transcription.design import DesignExpressions

KINDS = (0.34, 0.22, 0.22, 0.22)
"""How often all unknowns are changed, some drawn anew, all inputs delayed alike, and each input apart."""
LEAST, MOST = 0.05, 0.8
"""Smallest and largest standard deviation by which all unknowns are changed, as a share of half of each
range."""
FEW, MANY = 0.05, 0.4
"""Smallest and largest share of the unknowns that are drawn anew."""
DELAY = 0.12
"""Standard deviation of the time by which the middle of a drive comes sooner or later, as a share of it."""
ROUGHNESS = 0.15
"""Standard deviation of what is added to a drive that was so delayed, as a share of half of each range."""


def varied_design(design: DesignExpressions, unknowns: Array, rng: np.random.Generator) -> Array:
    """A design changed at random: all of it a little or a lot, some of it wholly, or its time warped.

    Args:
        design: the problem's expressions.
        unknowns: of the design, (size,).
        rng: of the draws.
    """
    own = design.terms.coefficient_count
    low, high = design.coefficient_bounds.T
    half, moved = (high - low) / 2, np.array(unknowns)
    kind = int(rng.choice(4, p=KINDS))
    if kind == 0:
        size = np.exp(rng.uniform(np.log(LEAST), np.log(MOST)))
        moved[:own] += size * half * rng.standard_normal(own)
    elif kind == 1:
        chosen = rng.random(own) < rng.uniform(FEW, MANY)
        moved[:own] = np.where(chosen, rng.uniform(low, high), moved[:own])
        size = ROUGHNESS
    else:
        # What happens when is what local searches change least: each input apart, or all of them alike.
        moved[:own] = _warped(design, moved[:own], rng, alike=kind == 2)
        size = ROUGHNESS * float(rng.integers(2))
        moved[:own] += size * half * rng.standard_normal(own)
    moved[own:] += size * rng.standard_normal(len(moved) - own)
    moved[:own] = np.clip(moved[:own], low, high)
    return np.clip(moved, *design.terms.own_bounds.T)


def _warped(design: DesignExpressions, unknowns: Array, rng: np.random.Generator, *, alike: bool) -> Array:
    # Every input of every run, its unknowns moved along its time by linear interpolation.
    embedding, found = design.terms.embedding, np.array(unknowns)
    runs = design.problem.design.runs
    sizes = [
        count
        for count, shared in zip(embedding.counts, embedding.shared, strict=True)
        for _ in range(1 if shared else runs)
    ]
    middle, late = _delay(rng)
    for first, end in pairwise(np.cumsum([0, *sizes]).tolist()):
        if not alike:
            middle, late = _delay(rng)
        times = np.linspace(0.0, 1.0, end - first)
        found[first:end] = np.interp(
            np.interp(times, [0.0, middle, 1.0], [0.0, late, 1.0]), times, unknowns[first:end]
        )
    return found


def _delay(rng: np.random.Generator) -> tuple[float, float]:
    # An instant of the drive (0 to 1), and the one whose inputs it gets.
    middle = rng.uniform(0.1, 0.9)
    return middle, float(np.clip(middle + DELAY * rng.standard_normal(), 0.02, 0.98))
