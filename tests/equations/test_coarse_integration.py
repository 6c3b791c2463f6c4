"""Drives scored by steps that are too coarse for their system."""

from __future__ import annotations

import numpy as np
import pytest

import oed

STUDY = """format: 1
name: Oscillator
system:
  kind: equations
  states: {place: 0 m, speed: 0 m/s}
  inputs: {push: m/s^2}
  parameters: {stiff: 400 1/s^2, gain: 1}
  derivatives: {place: speed, speed: gain * push - stiff * place}
  outputs: {seen: place}
experiment: {duration: 4 s, samples: 4, inputs: {push: [-4 m/s^2, 4 m/s^2]}}
limits: [{kind: always, name: narrow, of: place, range: [-15 mm, 15 mm]}]
measurement: {kind: outputs, noise: {seen: 1 mm}}
"""


@pytest.mark.slow
def test_limit_is_exceeded_where_coarse_steps_damp_a_swing():
    problem = oed.parse_study(STUDY).problem
    drive = oed.Trajectory.from_samples(np.array([[4.0], [-4.0], [4.0], [-4.0]]), 4.0, [0.0, 0.0])
    states, swing = np.zeros(2), 0.0
    for push in (4.0, -4.0, 4.0, -4.0):
        still = push / 400
        radius = np.hypot(states[0] - still, states[1] / 20)
        swing = max(swing, abs(still) + radius)
        cosine, sine, off = np.cos(20.0), np.sin(20.0), states[0] - still
        states = np.array(
            [still + off * cosine + states[1] / 20 * sine, states[1] * cosine - 20 * off * sine]
        )
    assert swing > 0.016
    margin = next(one for one in oed.evaluate(problem, drive).margins if one.name == "narrow")
    np.testing.assert_allclose(margin.violation, swing - 0.015, rtol=0.01)
