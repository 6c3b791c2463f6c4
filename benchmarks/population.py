"""Drives scored per second for a population, by CasADi's own machine and as generated C."""

from __future__ import annotations

import numpy as np

from benchmarks.figure import Figure, best_seconds
from benchmarks.forms import problem_of
from oed.solvers.design import DesignExpressions
from oed.solvers.genetic import REFINE

POPULATION, SAMPLES, WANTED = 200, 200, 50_000


def figures() -> list[Figure]:
    """Limits looked at once per sample, and as often as the genetic algorithm does."""
    found = []
    for refine in (1, REFINE):
        design = DesignExpressions(problem_of("segment", SAMPLES), refine)
        drives = np.random.default_rng(0).uniform(-0.3, 0.3, (POPULATION, design.size))
        plain = POPULATION / best_seconds(lambda d=design, x=drives: d.score_many(x))
        design.compile_scores()
        quick = POPULATION / best_seconds(lambda d=design, x=drives: d.score_many(x))
        what = f"drives of N = {SAMPLES} scored per second and core, {refine} points a sample"
        found.append(
            Figure(
                f"{what}, generated C",
                f"{quick:.0f}",
                f"{WANTED} wanted; {plain:.0f} without",
                quick / WANTED,
                1,
            )
        )
    return found
