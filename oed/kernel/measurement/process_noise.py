"""Process noise: what a system does beside what its inputs say, a random walk that readings see but no model.

x_{k+1} = f(x_k, u_k, p, T; w_k) with w_k ~ N(0, Q_k), independent from period to period. Absolute readings do
not average it away, so that information under it is less, and grows with the number of readings more slowly.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import lru_cache
from typing import ClassVar, NamedTuple

import casadi as ca

from oed.foundation.errors import Issue
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.system import System


class Period(NamedTuple):
    """A period of a system, SI.

    Attributes:
        system: that is driven.
        state: at the period's begin, (states,).
        inputs: held in it, (inputs,).
        parameters: values, (p,).
        duration: [s].
    """

    system: System
    state: Expression
    inputs: Expression
    parameters: Expression
    duration: Expression

    @classmethod
    def symbols(cls, system: System) -> Period:
        """Of symbols (SX)."""
        sizes = {"state": system.states, "inputs": system.inputs, "p": system.parameters, "period": [""]}
        return cls(system, *(ca.SX.sym(name, len(entries)) for name, entries in sizes.items()))


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
    def covariance(self, period: Period) -> Expression:
        """Q (m, m) of a period's errors, smooth in all that the period depends on."""

    @abstractmethod
    def step(self, period: Period, errors: Expression) -> Expression:
        """The state (states,) after a period with `errors` (m,); with none of them the system's own step."""

    @property
    @abstractmethod
    def size(self) -> int:
        """How many errors a period has, m."""

    @property
    @abstractmethod
    def text(self) -> str:
        """What it is and how large, in words."""

    def issues(self, system: System) -> list[Issue]:
        """Why it cannot be of that system; [] if it can."""
        return []


@lru_cache(maxsize=16)
def erring(noise: ProcessNoise, system: System) -> ca.Function:
    """The function (state, inputs, parameters, period, errors) -> next state."""
    period, errors = Period.symbols(system), ca.SX.sym("errors", noise.size)
    return ca.Function("erring", [*period[1:], errors], [noise.step(period, errors)])


@lru_cache(maxsize=16)
def spread(noise: ProcessNoise, system: System) -> ca.Function:
    """The function (state, inputs, parameters, period) -> G (states, m) = dx+/dw without errors, Q (m, m)."""
    period, errors = Period.symbols(system), ca.SX.sym("errors", noise.size)
    effect = ca.jacobian(noise.step(period, errors), errors)
    effect = ca.substitute(effect, errors, ca.SX.zeros(noise.size))
    return ca.Function("spread", [*period[1:]], [ca.sparsify(effect), ca.sparsify(noise.covariance(period))])
