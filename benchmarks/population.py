"""Drives scored per second for a population, by CasADi's own machine and as generated C; and by a search."""

from __future__ import annotations

import os
import tempfile
import time

import numpy as np

from benchmarks.figure import Figure, best_seconds, compile_calls
from benchmarks.forms import problem_of
from oed.optimize import Genetic, solve, terms
from oed.optimize.genetic import REFINE
from oed.optimize.transcription.design import DesignExpressions

POPULATION, GENERATIONS, SAMPLES = 200, 300, 200
WANTED, SEARCHED = 50_000, 25_000
"""Drives per second and core: scored, and scored by a whole search."""
ROUNDS = 3


def figures() -> list[Figure]:
    """As the genetic algorithm scores them: limits on the path at several points a sample."""
    return [_scored(), _searched()]


def _scored() -> Figure:
    design = DesignExpressions(problem_of("segment", SAMPLES), REFINE)
    drives = np.random.default_rng(0).uniform(-0.3, 0.3, (POPULATION, design.terms.size))
    plain = POPULATION / best_seconds(lambda: design.score_many(drives))
    compile_calls(lambda: design.score_many(drives))
    quick = POPULATION / best_seconds(lambda: design.score_many(drives))
    what = f"drives of N = {SAMPLES} scored per second and core, {REFINE} path points a sample, generated C"
    against = f"{WANTED} wanted; {plain:.0f} without a compiler"
    return Figure(what, f"{quick:.0f}", against, quick / WANTED, 1)


def _searched() -> Figure:
    quick = max(_drives_per_second() for _ in range(ROUNDS))
    what = (
        f"the same by a genetic search of {POPULATION} drives for {GENERATIONS} generations, from end to end"
    )
    return Figure(what, f"{quick:.0f}", f"{SEARCHED} wanted", quick / SEARCHED, 1)


def _drives_per_second() -> float:
    # With all that a first search does: its expressions are written, and its C is compiled.
    terms._KEPT.clear()
    options = Genetic(population=POPULATION, generations=GENERATIONS)
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_CACHE_HOME"] = folder
        began = time.perf_counter()
        found = solve(problem_of("segment", SAMPLES), options, seed=0, workers=1)
        return found.history[-1].evaluations / (time.perf_counter() - began)
