"""Building a search's program, and one iteration of it, against plain single and multiple shooting."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.figure import Figure, compile_calls, seconds
from benchmarks.forms import FORMS, problem_of
from benchmarks.plain import Plain, multiple_shooting, single_shooting
from oed.kernel.problem import Problem
from oed.optimize.ipopt import Ipopt
from oed.optimize.local import LocalSearch
from oed.optimize.results import LocalResult

COMPARED = (200, 1000)
"""Samples of drives that a search looks at all of, as the plain programs do."""
LONGER = (5000, 20_000)
"""Samples of drives that a search looks at some of, on the coarse grid that it takes by itself."""
GOALS: tuple[dict[str, float], dict[str, float]] = ({"segment": 3, "per-sample": 3, "joint": 4}, {})
"""How many times as fast as single shooting an iteration is to be, by form; 6 times on more samples."""
ITERATIONS = 20
BUILT = 10
"""Iterations that building is to take less time than."""
REPEATED = 3
ENOUGH = 500
"""Iterations in which a search converges."""


@dataclass(frozen=True)
class Timed:
    """A search's program.

    Attributes:
        search: that has built it.
        start: z that it was solved from.
        building: how long that took [s].
        iteration: how long one of Ipopt's takes [s], by generated C where there is a compiler.
        plain: the same without a compiler [s].
    """

    search: LocalSearch
    start: np.ndarray
    building: float
    iteration: float
    plain: float


def figures() -> list[Figure]:
    """Per form and number of samples: an iteration, and building in units of `BUILT` iterations."""
    return [figure for form in FORMS for figure in _of_form(form)]


def _of_form(form: str) -> Iterator[Figure]:
    short = 0.0
    for samples in COMPARED:
        problem, name = problem_of(form, samples), f"{form} form, N = {samples}"
        timed = _timed(problem, samples)
        short = short or timed.iteration
        yield _compared(name, problem, timed)
        yield _building(name, timed)
        grid = _samples(_search(problem, ITERATIONS))
        if grid < samples:
            yield _saved(f"{name}, on a grid of {grid}", problem)
    for samples in LONGER:
        timed = _timed(problem_of(form, samples))
        name = f"{form} form, N = {samples}, on a grid of {_samples(timed.search)}"
        yield _growth(name, samples, timed.iteration, short)
        yield _building(name, timed)


def _search(problem: Problem, iterations: int, samples: int | None = None) -> LocalSearch:
    # On so many samples, or those that a search takes by itself.
    return LocalSearch(problem, Ipopt(max_iterations=iterations, search_samples=samples))


def _samples(search: LocalSearch) -> int:
    # Of a run, that a search looks at.
    return search.design.problem.design.samples


def _timed(problem: Problem, samples: int | None = None) -> Timed:
    began = time.perf_counter()
    search = _search(problem, ITERATIONS, samples)
    z = _start(search)
    program, nothing = search.program, search.grid.no_correction
    chosen = search.exchange.chosen_rows(search.exchange.first_instants(), search.grid.trajectory(z))

    def solve() -> int:
        return search.solve(program, z, nothing, chosen=chosen).iterations

    solve()
    whole = time.perf_counter() - began
    plain = _per_iteration(solve)
    compile_calls(solve)
    # The first solve both builds and solves.
    return Timed(search, z, max(whole - ITERATIONS * plain, 0.0), _per_iteration(solve), plain)


def _start(search: LocalSearch) -> np.ndarray:
    return 0.25 * np.random.default_rng(0).uniform(-1, 1, search.design.terms.size)


def _compared(name: str, problem: Problem, ours: Timed) -> Figure:
    samples = problem.design.samples
    assert _samples(ours.search) == samples, "plain programs look at every sample"
    single = _plain_iteration(single_shooting(problem, ours.start, ours.search.scale, ITERATIONS))
    told = f"{seconds(single)} by single shooting, SX"
    if "joint" not in name:
        multiple = _plain_iteration(multiple_shooting(problem, ours.start, ours.search.scale, ITERATIONS))
        told += f"; {seconds(multiple)} by multiple shooting"
    ratio, goal = single / ours.iteration, GOALS[samples > COMPARED[0]].get(name.split()[0], 6)
    own = f"{seconds(ours.iteration)}; {seconds(ours.plain)} without a compiler"
    return Figure(f"{name}: an Ipopt iteration", own, told, ratio, goal, "least")


def _building(name: str, ours: Timed) -> Figure:
    solving = BUILT * ours.iteration
    told = f"{seconds(solving)} for {BUILT} iterations"
    return Figure(f"{name}: building", seconds(ours.building), told, ours.building / solving, 1, "most")


def _saved(name: str, problem: Problem) -> Figure:
    # What a coarse grid brings: to a search as a whole, with building and corrections by all samples.
    (every, all_seconds), (coarse, coarse_seconds) = (
        _searched(problem, samples) for samples in (problem.design.samples, None)
    )
    return Figure(
        f"{name}: a search from one start",
        f"{seconds(coarse_seconds)}, objective {coarse.objective:.6g}",
        f"{seconds(all_seconds)} on all samples, objective {every.objective:.6g}",
        all_seconds / coarse_seconds,
        1,
    )


def _searched(problem: Problem, samples: int | None) -> tuple[LocalResult, float]:
    began = time.perf_counter()
    search = _search(problem, ENOUGH, samples)
    found = search.maximise(_start(search))
    return found, time.perf_counter() - began


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
