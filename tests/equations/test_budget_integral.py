"""Budgets of states are integrals over time, whatever the samples are."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

import oed

STIFF = (2 * np.pi) ** 2
STUDY = f"""format: 1
name: Budget of a square
system:
  kind: equations
  states: {{place: 0 m, speed: 0 m/s}}
  inputs: {{push: m/s^2}}
  parameters: {{gain: 1, stiff: {STIFF} 1/s^2}}
  derivatives: {{place: speed, speed: gain * push - stiff * place}}
  outputs: {{seen: place}}
  substeps: 40
experiment: {{duration: 2 s, samples: 2, inputs: {{push: [1 m/s^2, 4 m/s^2]}}}}
limits: [{{kind: budget, name: strain, of: place^2, most: 0.001 m^2*s}}]
measurement: {{kind: outputs, noise: {{seen: 1 mm}}}}
"""


@pytest.mark.slow
def test_budget_of_a_state_that_swings_once_a_sample_is_its_integral():
    push = 3.0
    problem = oed.parse_study(STUDY).problem
    drive = oed.Trajectory.from_samples(np.full((2, 1), push), 2.0, [0.0, 0.0])
    margin = next(one for one in oed.evaluate(problem, drive).margins if one.name == "strain")
    square = quad(lambda t: (push / STIFF * (1 - np.cos(2 * np.pi * t))) ** 2, 0, 1)[0]
    np.testing.assert_allclose(margin.violation, 2 * square - 0.001, rtol=1e-4)
