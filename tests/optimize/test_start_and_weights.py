"""Start states and weights designed together, against a choice of both by SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import oed
from oed.workflow.studies import parse_study

PREY = """\
format: 1
name: Prey and predators
system:
  kind: equations
  states: {x: {design: [0.1, 1]}, y: 0.7}
  parameters: {c: 1 1/s, p1: 1 1/s, p2: 1 1/s, p3: 1 1/s}
  derivatives: {x: p1 * x - c * x * y, y: -p2 * y + p3 * x * y}
  outputs: {total: x + y}
experiment: {duration: 5 s, samples: 20}
measurement: {kind: rates, noise: {total: 1}}
estimate: [c]
weights: {total: 1 s, pieces: 10}
criterion: {kind: D, scaling: none}
solvers: [{kind: ipopt, starts: 4, perturbations: 0}]
"""


def best_two_windows(begin: float) -> float:
    """Return log of the information of the best two of ten windows of 0.5 s, from a start of x."""

    def slope(_: float, z: np.ndarray) -> list[float]:
        x, y, sx, sy = z
        return [x - x * y, x * y - y, sx * (1 - y) - x * sy - x * y, sx * y + sy * (x - 1)]

    path = solve_ivp(slope, (0, 5), [begin, 0.7, 0, 0], rtol=1e-8, atol=1e-10, dense_output=True).sol
    nodes, shares = np.polynomial.legendre.leggauss(8)
    middles = 0.5 * np.arange(10)[:, None] + 0.25
    states = path((middles + 0.25 * nodes).ravel())
    windows = (states[2] + states[3]).reshape(10, -1) ** 2 @ (0.25 * shares)
    return float(np.log(np.sort(windows)[-2:].sum()))


@pytest.mark.slow
def test_start_is_chosen_for_the_readings_that_are_taken():
    known = max(best_two_windows(begin) for begin in np.linspace(0.1, 1, 46))
    solution = oed.solve(parse_study(PREY).problem)
    assert solution.evaluation.objective == pytest.approx(known, abs=0.03)
