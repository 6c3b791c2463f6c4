"""The condensed program, multiple shooting and fatrop's stage structure, all with few rows of instants."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np

from benchmarks.figure import Figure, compile_calls, seconds
from benchmarks.forms import problem_of
from benchmarks.mapped import Mapped
from benchmarks.plain import Plain, multiple_shooting
from benchmarks.staged import Staged
from benchmarks.stages import Stages
from oed.foundation.arrays import Array, Places
from oed.kernel.problem import Problem
from oed.optimize.ipopt import Ipopt
from oed.optimize.local import LocalSearch
from oed.optimize.transcription.solver_calls import one_thread

SAMPLES = (200, 1000)
STARTS = 12
MOST = 200
"""Iterations of a solve."""
ALIKE = 1e-4
"""Share of the best objective within which an end is as good."""
COMPILED = 200
"""Samples up to which stages are compiled: of more, a compiler is at work on one for minutes."""
REPEATED = 2
FEW = 3
"""Starts of what is built anew for each, which takes seconds."""


@dataclass(frozen=True)
class End:
    """What one solve came to.

    Attributes:
        objective: maximised.
        succeeded: whether the solver says that it has solved it.
        iterations: that it took.
        seconds: of one processor.
    """

    objective: float
    succeeded: bool
    iterations: int
    seconds: float


@dataclass(frozen=True)
class Way:
    """A transcription, and how fast it is.

    Attributes:
        name: in the table.
        ends: from each start.
    """

    name: str
    ends: tuple[End, ...]

    @property
    def iteration(self) -> float:
        """Seconds of one, the median of all solves."""
        return float(np.median([one.seconds / max(one.iterations, 1) for one in self.ends]))

    @property
    def whole(self) -> float:
        """Seconds of a solve, their median."""
        return float(np.median([one.seconds for one in self.ends]))

    def solves(self, best: float) -> str:
        """Its solves for the table."""
        found = sum(one.succeeded and one.objective >= best * (1 - ALIKE) for one in self.ends)
        iterations = int(np.median([one.iterations for one in self.ends]))
        return f"{seconds(self.whole)} {self.name} ({iterations} iterations, {found} of {len(self.ends)})"


def figures() -> list[Figure]:
    """Per number of samples: an iteration, and a solve to the end."""
    return [figure for samples in SAMPLES for figure in _of(samples)]


def _of(samples: int) -> Iterator[Figure]:
    problem = problem_of("segment", samples)
    search = LocalSearch(problem, Ipopt(max_iterations=MOST, search_samples=samples))
    starts = [start_of(search, seed) for seed in range(STARTS)]
    known = search.exchange.first_instants()
    instants = np.rint(np.unique(known.time) / problem.design.period).astype(int)
    others = [Way(name, tuple(ends)) for name, ends in _others(problem, search, instants, starts)]
    plain = Way("without a compiler", tuple(_condensed(search, z) for z in starts))
    compile_calls(lambda: _condensed(search, starts[0]))
    own = Way("condensed", tuple(_condensed(search, z) for z in starts))
    name = f"segment form, N = {samples}, {len(known)} rows of instants"
    compared = "; ".join(f"{seconds(one.iteration)} {one.name}" for one in others)
    least = min(one.iteration for one in others)
    ours = f"{seconds(own.iteration)}; {seconds(plain.iteration)} {plain.name}"
    yield Figure(f"{name}: an iteration", ours, compared, least / own.iteration)
    best = max(end.objective for one in (own, *others) for end in one.ends if end.succeeded)
    compared = "; ".join(one.solves(best) for one in others)
    ours = f"{own.solves(best)}; {seconds(plain.whole)} {plain.name}"
    least = min(one.whole for one in others)
    yield Figure(f"{name}: a solve", ours, compared, least / own.whole)


def start_of(search: LocalSearch, seed: int) -> Array:
    """Unknowns that a solve begins at."""
    return 0.25 * np.random.default_rng(seed).uniform(-1, 1, search.design.terms.size)


def _condensed(search: LocalSearch, z: Array) -> End:
    exchange, nothing = search.exchange, search.grid.no_correction
    chosen = exchange.chosen_rows(exchange.first_instants(), search.grid.trajectory(z))

    def solve() -> tuple[float, bool, int]:
        outcome = search.solve(search.program, z, nothing, chosen=chosen)
        return outcome.maximised, outcome.succeeded, outcome.iterations

    return _timed(solve)


def _others(
    problem: Problem, search: LocalSearch, instants: Places, starts: list[Array]
) -> Iterator[tuple[str, Iterator[End]]]:
    scale = search.scale
    shot = (_solved(multiple_shooting(problem, z, scale, MOST, instants)) for z in starts[:FEW])
    yield "by multiple shooting, SX", shot
    staged, begin = Staged(Stages(problem, instants, search.scale)), starts[0]
    fatrop = ca.has_nlpsol("fatrop")

    def from_each(plain: Plain) -> Iterator[End]:
        return (_solved(Plain(plain.solver, staged.arguments(z))) for z in starts)

    program = staged.unrolled()
    yield "in stages, SX", from_each(staged.by_ipopt(program, begin, MOST))
    if fatrop:
        yield "by fatrop, SX", from_each(staged.by_fatrop(program, begin, MOST))
    ways = ((False, "mapped"), (True, "mapped, compiled"))
    for machine, how in ways if problem.design.samples <= COMPILED else ways[:1]:
        mapped = Mapped(staged, machine=machine)
        yield f"in stages, {how}", from_each(mapped.by_ipopt(begin, MOST))
        if fatrop:
            yield f"by fatrop, {how}", from_each(mapped.by_fatrop(begin, MOST))


def _solved(plain: Plain) -> End:
    def solve() -> tuple[float, bool, int]:
        with one_thread():
            found = plain.solver(**plain.arguments)
        stats = plain.solver.stats()
        return -float(found["f"]), bool(stats["success"]), int(stats["iter_count"])

    return _timed(solve)


def _timed(solve: Callable[[], tuple[float, bool, int]]) -> End:
    # Of this thread: others may be at work on the machine.
    shortest = np.inf
    for _ in range(REPEATED):
        began = time.thread_time()
        objective, succeeded, iterations = solve()
        shortest = min(shortest, time.thread_time() - began)
    return End(objective, succeeded, iterations, shortest)
