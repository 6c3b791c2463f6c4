"""Perturbations: random changes of a design, of many sizes and kinds, to solve it again from (basin hopping).

[Wales, Doye, "Global optimization by basin-hopping", Journal of Physical Chemistry A 101, 1997.]
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from oed.foundation.arrays import Array
from oed.optimize.transcription.design import DesignExpressions

KINDS = (0.34, 0.22, 0.22, 0.22)
"""Probabilities of four changes: all unknowns moved, some redrawn, all inputs delayed by the same time, each
input delayed by a time of its own.
"""
LEAST, MOST = 0.05, 0.8
"""Smallest and largest standard deviation by which all unknowns are changed, as a share of half of each
range."""
FEW, MANY = 0.05, 0.4
"""Smallest and largest share of the unknowns that are drawn anew."""
DELAY = 0.12
"""Standard deviation of the delay in the middle of a drive, as a share of its duration."""
PERTURBATION = 0.15
"""Standard deviation of the perturbation of a neighbour, as a share of each input's largest value."""
ROUGHNESS = 0.15
"""Standard deviation of the noise added to a delayed drive, as a share of half of each range."""


def varied_design(design: DesignExpressions, unknowns: Array, rng: np.random.Generator) -> Array:
    """Return a design changed at random: all unknowns moved, some redrawn, or the drive's time warped.

    Args:
        design: expressions of the problem.
        unknowns: unknowns z of the design, (size,).
        rng: generator of the draws.
    """
    count = design.terms.coefficient_count
    low, high = design.coefficient_bounds.T
    half, moved = (high - low) / 2, np.array(unknowns)
    kind = int(rng.choice(4, p=KINDS))
    if kind == 0:
        size = np.exp(rng.uniform(np.log(LEAST), np.log(MOST)))
        moved[:count] += size * half * rng.standard_normal(count)
    elif kind == 1:
        chosen = rng.random(count) < rng.uniform(FEW, MANY)
        moved[:count] = np.where(chosen, rng.uniform(low, high), moved[:count])
        size = ROUGHNESS
    else:
        # Local searches change the timing of a drive least.
        moved[:count] = _warp(design, moved[:count], rng, together=kind == 2)
        size = ROUGHNESS * float(rng.integers(2))
        moved[:count] += size * half * rng.standard_normal(count)
    moved[count:] += size * rng.standard_normal(len(moved) - count)
    return _within_bounds(design, moved)


def perturbed_design(design: DesignExpressions, unknowns: Array, rng: np.random.Generator) -> Array:
    """Return a neighbour of a design: every unknown perturbed, within the inputs' bounds.

    Args:
        design: expressions of the problem.
        unknowns: unknowns z of the design, (size,).
        rng: generator of the draws.
    """
    return _within_bounds(design, unknowns + PERTURBATION * rng.standard_normal(len(unknowns)))


def _within_bounds(design: DesignExpressions, unknowns: Array) -> Array:
    coefficients = unknowns[: design.terms.coefficient_count]
    np.clip(coefficients, *design.coefficient_bounds.T, out=coefficients)
    return np.clip(unknowns, *design.terms.own_bounds.T)


def _warp(design: DesignExpressions, unknowns: Array, rng: np.random.Generator, *, together: bool) -> Array:
    # The unknowns of every input of every run are moved along its time by linear interpolation.
    embedding, warped = design.terms.embedding, np.array(unknowns)
    sizes = [
        count
        for count, size in zip(embedding.counts, embedding.sizes, strict=True)
        for _ in range(size // count)
    ]
    middle, late = _delay(rng)
    for first, end in pairwise(np.cumsum([0, *sizes]).tolist()):
        if not together:
            middle, late = _delay(rng)
        times = np.linspace(0.0, 1.0, end - first)
        warped[first:end] = np.interp(
            np.interp(times, [0.0, middle, 1.0], [0.0, late, 1.0]), times, unknowns[first:end]
        )
    return warped


def _delay(rng: np.random.Generator) -> tuple[float, float]:
    # An instant of the drive (0 to 1), and the instant whose inputs it gets.
    middle = rng.uniform(0.1, 0.9)
    return middle, float(np.clip(middle + DELAY * rng.standard_normal(), 0.02, 0.98))
