"""Simulate a system: its states over time, and their derivatives by its parameters."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
import numpy.typing as npt

from oed.foundation.arrays import Array
from oed.kernel.dynamics.system import System, carrier, stepper


@dataclass(frozen=True)
class Simulation:
    """The states of one run.

    Attributes:
        states: states at the begin of the first period and the end of every period, (N + 1, states), SI.
        sensitivities: derivatives of the states by the parameters, (N + 1, states, p), SI.
    """

    states: Array
    sensitivities: Array


def simulate(system: System, inputs: Array, start: npt.ArrayLike, periods: npt.ArrayLike) -> Simulation:
    """Simulate one run of a system at its nominal parameters, with a known start.

    Args:
        system: system that is driven.
        inputs: inputs held in every period, (N, inputs), SI.
        start: start state, (states,), SI.
        periods: duration of every period [s], (N,), or of all of them.
    """
    count, size, samples = len(system.states), len(system.parameters), len(inputs)
    states = np.zeros((samples + 1, count))
    sensitivities = np.zeros((samples + 1, count, size))
    states[0] = np.asarray(start, dtype=float).ravel()
    if count and samples:
        lengths = np.broadcast_to(np.asarray(periods, dtype=float), samples)
        held = ca.DM(inputs.T), ca.DM(system.nominal), ca.DM(lengths).T
        after = stepper(system).mapaccum(samples)(states[0], *held)
        states[1:] = np.array(after).T
        begin = ca.horzcat(ca.DM.zeros(count, size), ca.DM.eye(count))
        carried = carrier(system).mapaccum(samples)(begin, ca.DM(states[:-1].T), *held)
        every = np.array(carried).reshape(count, samples, size + count)
        sensitivities[1:] = every.transpose(1, 0, 2)[:, :, :size]
    return Simulation(states, sensitivities)
