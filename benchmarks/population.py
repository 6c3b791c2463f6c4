"""Drives scored per second for a population, by CasADi's own machine and as generated C."""

from __future__ import annotations

import numpy as np

from benchmarks.figure import Figure, best_seconds
from benchmarks.forms import problem_of
from oed.optimize.genetic import REFINE
from oed.optimize.transcription.design import DesignExpressions

POPULATION, SAMPLES, WANTED = 200, 200, 50_000


def figures() -> list[Figure]:
    """As the genetic algorithm scores them: limits on the path at several points a sample."""
    design = DesignExpressions(problem_of("segment", SAMPLES), REFINE)
    drives = np.random.default_rng(0).uniform(-0.3, 0.3, (POPULATION, design.terms.size))
    plain = POPULATION / best_seconds(lambda: design.score_many(drives))
    design.compile_scores()
    quick = POPULATION / best_seconds(lambda: design.score_many(drives))
    what = f"drives of N = {SAMPLES} scored per second and core, {REFINE} path points a sample, generated C"
    against = f"{WANTED} wanted; {plain:.0f} without a compiler"
    return [Figure(what, f"{quick:.0f}", against, quick / WANTED, 1)]
