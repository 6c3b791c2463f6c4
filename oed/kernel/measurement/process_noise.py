"""Process noise: what a system does beside what its inputs say, a random walk that readings see but no model.

x_{k+1} = f(x_k, u_k, p, T; w_k) with w_k ~ N(0, Q_k), independent from period to period. Absolute readings do
not average it away, so that information under it is less, and grows with the number of readings more slowly.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, ClassVar

import casadi as ca

from oed.foundation.errors import Flaw
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.system import System

if TYPE_CHECKING:
    from oed.kernel.measurement.sensor import Sensor


class ProcessNoise(ABC):
    """Errors w (m,) of every period, and what they do; hashable, for functions of it are kept.

    Attributes:
        signal: name of the system's signal of m entries whose mean over a period they change by w / T, which
            sensors that read periods see; "" for none.
        key: of sensors, by which it is given.
        walks: what it does, in words.
    """

    signal: ClassVar[str] = ""
    key: ClassVar[str] = "drift"
    walks: ClassVar[str] = "Its state is a random walk"

    @abstractmethod
    def covariance(
        self,
        system: System,
        state: Expression,
        inputs: Expression,
        parameters: Expression,
        period: Expression,
    ) -> Expression:
        """Q (m, m) of a period's errors, smooth in all its arguments.

        Args:
            system: that is driven.
            state: at the period's begin, (states,), SI.
            inputs: held in it, (inputs,), SI.
            parameters: values, (p,), SI.
            period: its duration [s].
        """

    @abstractmethod
    def step(
        self,
        system: System,
        state: Expression,
        inputs: Expression,
        parameters: Expression,
        period: Expression,
        errors: Expression,
    ) -> Expression:
        """The state (states,) after a period with `errors` (m,); with none of them the system's own step."""

    @property
    @abstractmethod
    def size(self) -> int:
        """How many errors a period has, m."""

    @property
    @abstractmethod
    def text(self) -> str:
        """What it is and how large, in words."""

    def flaws(self, system: System) -> list[Flaw]:
        """Why it cannot be of that system; [] if it can."""
        return []


def process_flaws(sensors: Sequence[Sensor], system: System) -> list[Flaw]:
    """Why the process noise that sensors speak of is none that a filter takes in, by key; [] if it is."""
    noise = process_noise_of(sensors)
    if noise is None:
        return []
    flaws = noise.flaws(system)
    for place, sensor in enumerate(sensors):
        key: tuple[str | int, ...] = ("measurement",) if len(sensors) == 1 else ("measurement", place)
        if sensor.process_noise not in (None, noise):
            flaws.append(
                Flaw((*key, noise.key), "differs from that of the sensors before; a system drifts in one way")
            )
        if sensor.when == "in periods" and not noise.signal:
            text = (
                f"readings of whole periods do not go with {noise.key}, which is left out within them: read "
            )
            flaws.append(Flaw((*key, "kind"), f"{text}at the samples, or leave out `{noise.key}`"))
        if sensor.joint_whitening is not None:
            text = "one covariance of all readings does not go with drift, whose filter takes in one by one: "
            text += "give that of one reading"
            flaws.append(Flaw((*key, "noise", "covariance"), text))
    return flaws


def process_noise_of(sensors: Sequence[Sensor]) -> ProcessNoise | None:
    """What sensors say of the process, which is one for all of them; None where none does."""
    return next((one.process_noise for one in sensors if one.process_noise is not None), None)


@lru_cache(maxsize=16)
def erring(noise: ProcessNoise, system: System) -> ca.Function:
    """The function (state, inputs, parameters, period, errors) -> next state."""
    given = _symbols(noise, system)
    state, inputs, parameters, period, errors = given
    return ca.Function("erring", given, [noise.step(system, state, inputs, parameters, period, errors)])


@lru_cache(maxsize=16)
def spread(noise: ProcessNoise, system: System) -> ca.Function:
    """The function (state, inputs, parameters, period) -> G (states, m) = dx+/dw without errors, Q (m, m)."""
    state, inputs, parameters, period, errors = _symbols(noise, system)
    following = noise.step(system, state, inputs, parameters, period, errors)
    effect = ca.substitute(ca.jacobian(following, errors), errors, ca.SX.zeros(noise.size))
    covariance = noise.covariance(system, state, inputs, parameters, period)
    given = [state, inputs, parameters, period]
    return ca.Function("spread", given, [ca.sparsify(effect), ca.sparsify(covariance)])


def _symbols(noise: ProcessNoise, system: System) -> list[ca.SX]:
    return [
        ca.SX.sym("state", len(system.states)),
        ca.SX.sym("inputs", len(system.inputs)),
        ca.SX.sym("p", len(system.parameters)),
        ca.SX.sym("period"),
        ca.SX.sym("errors", noise.size),
    ]
