"""An Ipopt iteration under drift, against one of the same problem without: what the filter costs."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from benchmarks.figure import Figure, seconds
from benchmarks.forms import problem_of
from oed.kernel.criteria import A
from oed.optimize.ipopt import Ipopt
from oed.optimize.local import LocalSearch
from oed.robots.sensors import Drift

SAMPLES = (200, 1000)
"""Of drives that a search looks at all of."""
ITERATIONS = 20
REPEATED = 5
DRIFT = Drift(
    ahead_per_metre=0.005,
    heading_per_metre=float(np.radians(1.0)),
    heading_per_radian=float(np.radians(1.0)),
)
"""As problems/laser_tracker_drift.yaml has it."""
MOST = 2.0
"""Times as long as without that an iteration may take, to be of the same class."""


def figures() -> list[Figure]:
    """One line for each number of samples; both measured in turn, of each the shortest."""
    return [_compared(samples) for samples in SAMPLES]


def _compared(samples: int) -> Figure:
    steady = replace(problem_of("joint", samples), criterion=A())
    drifting = replace(steady, measurement=steady.sensors[0].model_copy(update={"drift": DRIFT}))
    searches = [
        LocalSearch(problem, Ipopt(max_iterations=ITERATIONS, search_samples=samples))
        for problem in (drifting, steady)
    ]
    shortest = [np.inf, np.inf]
    # The first round builds as well.
    for _ in range(REPEATED + 1):
        for place, search in enumerate(searches):
            shortest[place] = min(shortest[place], _iteration(search))
    ours, without = shortest
    name = f"joint form under drift, N = {samples}: an Ipopt iteration"
    return Figure(name, seconds(ours), f"{seconds(without)} without drift", ours / without, MOST, "most")


def _iteration(search: LocalSearch) -> float:
    # How long one takes [s], on the processor: others may be busy there.
    size = search.design.terms.size
    z = 0.25 * np.random.default_rng(0).uniform(-1, 1, size)
    began = time.process_time()
    iterations = search.solve(search.program, z, search.grid.no_correction).iterations
    return (time.process_time() - began) / max(iterations, 1)
