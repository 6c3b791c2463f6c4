"""Building a search's program, and one iteration of it, against plain single and multiple shooting."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from benchmarks.figure import Figure, seconds
from benchmarks.forms import FORMS, problem_of
from benchmarks.plain import Plain, multiple_shooting, single_shooting
from oed.kernel.problem import Problem
from oed.optimize.local import LocalSearch, Settings

COMPARED = (200, 1000)
LONGER = (5000, 20_000)
ITERATIONS = 20
REPEATED = 3


def figures() -> list[Figure]:
    """Per form and number of samples: an iteration, and building in units of 20 iterations."""
    found = []
    for form in FORMS:
        short = 0.0
        for samples in (*COMPARED, *LONGER):
            problem = problem_of(form, samples)
            building, iteration, search, z = _ours(problem)
            short = short or iteration
            name = f"{form} form, N = {samples}"
            if samples in COMPARED:
                found.append(_compared(name, problem, iteration, search, z))
            else:
                found.append(_growth(name, samples, iteration, short))
            found.append(
                Figure(
                    f"{name}: building",
                    seconds(building),
                    f"{seconds(ITERATIONS * iteration)} for {ITERATIONS} iterations",
                    building / (ITERATIONS * iteration),
                    1,
                    "most",
                )
            )
    return found


def _ours(problem: Problem) -> tuple[float, float, LocalSearch, np.ndarray]:
    began = time.perf_counter()
    search = LocalSearch(problem, Settings(ITERATIONS, 1e-8, None, "none"))
    z = 0.25 * np.random.default_rng(0).uniform(-1, 1, search.design.size)
    program, nothing = search.program, search.grid.no_correction
    search.solved(program, z, nothing)
    whole = time.perf_counter() - began
    iteration = _per_iteration(lambda: search.solved(program, z, nothing).iterations)
    # The first solve both builds and solves.
    return max(whole - ITERATIONS * iteration, 0.0), iteration, search, z


def _compared(name: str, problem: Problem, ours: float, search: LocalSearch, z: np.ndarray) -> Figure:
    single = _plain_iteration(single_shooting(problem, z, search.scale, ITERATIONS))
    told = f"{seconds(single)} by single shooting, SX"
    if "joint" not in name:
        multiple = _plain_iteration(multiple_shooting(problem, z, search.scale, ITERATIONS))
        told += f"; {seconds(multiple)} by multiple shooting"
    return Figure(f"{name}: an Ipopt iteration", seconds(ours), told, single / ours, 3, "least")


def _growth(name: str, samples: int, ours: float, short: float) -> Figure:
    linear = short * samples / COMPARED[0]
    told = f"{seconds(linear)}, as many times that of N = {COMPARED[0]} as there are samples"
    return Figure(f"{name}: an Ipopt iteration", seconds(ours), told, ours / linear, 1, "most")


def _plain_iteration(plain: Plain) -> float:
    def solve() -> int:
        plain.solver(**plain.arguments)
        return int(plain.solver.stats()["iter_count"])

    return _per_iteration(solve)


def _per_iteration(solve: Callable[[], int]) -> float:
    shortest = np.inf
    for _ in range(REPEATED):
        began = time.perf_counter()
        iterations = solve()
        shortest = min(shortest, (time.perf_counter() - began) / max(iterations, 1))
    return float(shortest)
