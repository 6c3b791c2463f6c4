"""Problems of many samples on fewer: a spline has far fewer coefficients than a drive has samples, so that a
coarser grid is nearly as informative.
"""

from __future__ import annotations

from dataclasses import replace

from oed.kernel.problem import Problem

MOST_SEARCHED = 600
"""Samples per run up to which all of them are searched on."""
USUAL = 400
"""Samples per run of a coarse grid: so many that paths hardly violate limits between them."""
PER_COEFFICIENT = 12
"""Samples that a spline coefficient needs for a coarse grid to see its shape."""


def coarse_samples(problem: Problem, wanted: int | None = None) -> int:
    """Samples per run of the grid to search on: as many as wanted, or all where they are few, else about 400;
    a few more where segments would not be equally long.
    """
    space, multiple = problem.design, problem.measurement.grid_multiple
    usual = wanted or max(USUAL, PER_COEFFICIENT * space.spline.count)
    if wanted is None and space.samples <= usual * MOST_SEARCHED // USUAL:
        return space.samples
    return -(-usual // multiple) * multiple


def coarsened(problem: Problem, samples: int) -> Problem:
    """The problem on so many samples per run; itself where its measurement needs all of them."""
    space = problem.design
    measurement = problem.measurement.coarser(space.samples / samples)
    # Steps are known by the values of all periods.
    if measurement is None or samples >= space.samples or space.stores_steps:
        return problem
    return replace(problem, measurement=measurement, design=space.model_copy(update={"samples": samples}))
