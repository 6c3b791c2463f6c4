"""Simulate a system: its states over time, and their derivatives by its parameters."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
import numpy.typing as npt

from oed.foundation.arrays import Array
from oed.kernel.dynamics.rollout import roll_out
from oed.kernel.dynamics.system import System


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
    lengths = np.broadcast_to(np.asarray(periods, dtype=float), len(inputs))
    drive = roll_out(
        system,
        inputs=ca.DM(inputs),
        start=ca.DM(np.asarray(start, dtype=float).ravel()),
        parameters=ca.DM(system.nominal),
        period=ca.DM(lengths).T,
    )
    states, parameters = len(system.states), len(system.parameters)
    slopes = np.array(drive.sensitivities).reshape(states, len(inputs) + 1, -1)[:, :, :parameters]
    return Simulation(np.array(drive.states), slopes.transpose(1, 0, 2))
