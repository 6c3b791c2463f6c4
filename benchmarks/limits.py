"""Building a search's program with limits of every kind, against the same without them."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import ClassVar, Literal

import numpy as np

from benchmarks.figure import Figure, seconds
from benchmarks.forms import problem_of
from oed import EndPosition, Limit, PathLength
from oed.kernel.dynamics.rollout import Drive
from oed.kernel.limit import Rows
from oed.kernel.problem import Problem
from oed.optimize.ipopt import Ipopt
from oed.optimize.local import LocalSearch

SAMPLES = 200
FACTOR = 3.0
"""How many times longer building may take with another limit."""


class Bend(Limit):
    """A user's own limit, which does not say what it looks at."""

    name: ClassVar[str] = "bend"

    def rows(self, drive: Drive) -> Rows:
        """At every point of the path x + y^2 / 2 [m]."""
        values = drive.path[:, 0] + drive.path[:, 1] ** 2 / 2
        count = values.shape[0]
        return Rows(values, np.full(count, -np.inf), np.full(count, 0.9), 1.0, "m")


class InstantBend(Bend):
    """The same, which says so."""

    looks_at: ClassVar[Literal["state"]] = "state"


LIMITS: dict[str, Limit] = {
    "end_position": EndPosition(at="start"),
    "path_length": PathLength(bounds=8),
    "a limit of the user's own": Bend(),
    "one on instants": InstantBend(),
}


def figures() -> list[Figure]:
    """Per limit: building with it, in units of building without it."""
    problem = problem_of("joint", SAMPLES)
    # Loads what is loaded once; terms of the problem itself would be kept.
    _building(problem_of("joint", 2 * SAMPLES))
    without = _building(problem)
    found = []
    for name, limit in LIMITS.items():
        own = _building(replace(problem, limits=(*problem.limits, limit)))
        what = f"joint form, N = {SAMPLES}, with {name}: building"
        found.append(Figure(what, seconds(own), f"{seconds(without)} without", own / without, FACTOR, "most"))
    return found


def _building(problem: Problem) -> float:
    # Of a program and its solver, and one iteration.
    began = time.perf_counter()
    search = LocalSearch(problem, Ipopt(max_iterations=1))
    z = 0.25 * np.random.default_rng(0).uniform(-1, 1, search.design.terms.size)
    search.solve(search.program, z, search.grid.no_correction)
    return time.perf_counter() - began
