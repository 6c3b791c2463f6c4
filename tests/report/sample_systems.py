"""Records of experiments with systems given by equations: scored as given, nothing is solved."""

from __future__ import annotations

import textwrap
from dataclasses import replace
from functools import cache

import numpy as np

from oed.kernel import solution
from oed.kernel.dynamics.held import HeldSpace
from oed.kernel.dynamics.trajectory import Trajectory
from oed.optimize import solve
from oed.records.record import Record
from oed.study.study import Study
from oed.workflow.runner import record as record_of
from oed.workflow.studies import parse_study

PONDS = textwrap.dedent("""\
    format: 1
    name: Two ponds
    system:
      kind: equations
      states: {prey: {design: ["0.5", "1.5"]}, predators: "0.7"}
      inputs: {fishing: 1/s, warmth: ""}
      parameters: {birth: 1 1/h, loss: 1 1/h, gain: 0.9 1/h, death: 1 1/h}
      derivatives:
        prey: (birth * warmth - loss * predators - 0.4 * fishing) * prey
        predators: (gain * prey - death * warmth - 0.2 * fishing) * predators
      outputs: {prey_seen: prey, catch: fishing * predators}
      substeps: 4
    experiment:
      duration: 12 h
      samples: 24
      trials: 2
      inputs:
        fishing: {range: [0 1/h, 1 1/h], rate: 4 1/h/h}
        warmth: {range: ["0.8", "1.2"], signal: constant}
    measurement: {kind: outputs, noise: {prey_seen: 0.02, catch: 0.01 1/h}}
    limits: [{kind: always, name: many, of: prey, range: ["0.1", "9"]}]
    criterion: D
    """)
REACTIONS = textwrap.dedent("""\
    format: 1
    name: Two reactions
    system:
      kind: equations
      inputs: {t: s}
      parameters: {k1: 0.7 1/min, k2: 0.2 1/min}
      outputs: {b: k1 / (k1 - k2) * (exp(-k2 * t) - exp(-k1 * t))}
    experiment: {points: 2, inputs: {t: [0 min, 20 min]}}
    measurement: {kind: responses, noise: {b: 0.05}}
    criterion: {kind: D, scaling: none}
    """)
GAS = textwrap.dedent("""\
    format: 1
    name: A gas that is adsorbed
    system:
      kind: equations
      inputs: {pressure: Pa, temperature: K}
      parameters: {capacity: 2 mol/kg, affinity: 0.5 1/bar, heat: 15 kJ/mol, gas: 8.314 J/mol/K, warm: 300 K}
      define: {k: affinity * exp(heat / gas * (1 / temperature - 1 / warm))}
      outputs: {loading: capacity * k * pressure / (1 + k * pressure)}
    experiment: {points: 3, inputs: {pressure: [0.1 bar, 10 bar], temperature: [280 K, 340 K]}}
    measurement: {kind: responses, noise: {loading: 0.02 mol/kg}}
    estimate: [capacity, affinity]
    criterion: D
    """)
PARABOLA = textwrap.dedent("""\
    format: 1
    name: A parabola
    system:
      kind: equations
      inputs: {x: ""}
      parameters: {constant: 1, slope: 1, curvature: 1}
      outputs: {y: constant + slope * x + curvature * x^2}
    experiment: {candidates: {grid: {x: {least: -1, largest: 1, count: 21}}}}
    measurement: {kind: responses, noise: {y: 0.01}}
    weights: {total: 1}
    criterion: {kind: E, scaling: none}
    """)
TRIALS = textwrap.dedent("""\
    format: 1
    name: Which trials of a tank
    system:
      kind: equations
      states: {temperature: 293 K}
      inputs: {heat: W, flow: 1/s}
      parameters: {loss: 2 W/K, capacity: 20 kJ/K, room: 293 K}
      define: {above: temperature - room}
      derivatives: {temperature: (heat - loss * above) / capacity - flow * above}
      outputs: {reading: temperature}
    experiment:
      duration: 2 h
      samples: 8
      candidates: {rows: {heat: [0 W, 500 W, 200 W, 500 W], flow: [0 1/h, 0 1/h, 1 1/h, 1 1/h]}}
    measurement: {kind: outputs, noise: {reading: 0.5 K}}
    weights: {of: trials, readings: 4, most: 3}
    estimate: [loss, capacity]
    criterion: D
    """)
HOUR = 3600.0
FISHING = np.repeat([0.0, 1.0, 0.2, 0.8], 6) / HOUR
"""Of a trial with the ponds [1/s]."""
WARMTHS, STARTS = (1.2, 0.8), ((1.0, 0.7), (0.5, 0.7))
TIMES = (73.8, 411.5)
"""Of the readings of two reactions [s]."""


def scored(text: str | Study, held: np.ndarray, starts: np.ndarray, duration: float) -> Record:
    """A record of one experiment, as if a search had found it.

    Args:
        text: of the study, or itself.
        held: values of the inputs in every period, SI.
        starts: start states of the trials, SI.
        duration: of a trial [s].
    """
    study = parse_study(text) if isinstance(text, str) else text
    trajectory = HeldSpace.of(held, starts, duration=duration).only
    assert isinstance(trajectory, Trajectory)
    found = replace(solution.scored(study.problem, trajectory, "ipopt"), kind="ipopt")
    return record_of(study, [found], 7)


@cache
def ponds() -> Record:
    """Two trials with prey and predators, fished in steps, one warm and one cool."""
    held = np.vstack([np.column_stack([FISHING, np.full(24, warmth)]) for warmth in WARMTHS])
    return scored(PONDS, held, np.array(STARTS), 12 * HOUR)


@cache
def reactions() -> Record:
    """Two reactions, looked at twice."""
    return scored(REACTIONS, np.array(TIMES)[::-1, None], np.zeros((1, 0)), 2.0)


@cache
def gas() -> Record:
    """A gas that is adsorbed at settings of two inputs, one of them twice."""
    held = np.array([[1e5, 280.0], [1e5, 280.0], [1e6, 340.0]])
    return scored(GAS, held, np.zeros((1, 0)), 3.0)


@cache
def parabola() -> Record:
    """A parabola that may be read at 21 places, and is read at three of them by weights."""
    study = parse_study(PARABOLA)
    only = study.problem.design.only
    assert only is not None
    weights = np.zeros(21)
    weights[[0, 10, 20]] = 0.2, 0.6, 0.2
    found = solution.scored(study.problem, replace(only, weights=weights), "ipopt")
    return record_of(study, [replace(found, kind="ipopt")], 7)


@cache
def trials() -> Record:
    """Four trials of a tank that may be made, each up to three times."""
    study = parse_study(TRIALS)
    return record_of(study, [solve(study.problem, study.solvers[0], seed=0)], 7)
