"""Process noise: random errors of a system's steps, which readings see and no model predicts.

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
from oed.kernel.dynamics.system import System, step_symbols


class Period(NamedTuple):
    """A period of a system, SI.

    Attributes:
        system: system that is driven.
        state: states at the period's begin, (states,).
        inputs: inputs held in it, (inputs,).
        parameters: values of the parameters, (p,).
        duration: duration [s].
    """

    system: System
    state: Expression
    inputs: Expression
    parameters: Expression
    duration: Expression


class ProcessNoise(ABC):
    """Errors w (m,) of every period and their effect; hashable, because functions of it are cached.

    Attributes:
        signal: name of the system's signal of m entries whose mean over a period they change by w / T, which
            sensors that read periods see; "" for none.
        key: key of sensors that states it.
        walks: sentence about its effect.
    """

    signal: ClassVar[str] = ""
    key: ClassVar[str] = "drift"
    walks: ClassVar[str] = "Its state is a random walk"

    @abstractmethod
    def covariance(self, period: Period) -> Expression:
        """Return the covariance Q (m, m) of a period's errors, smooth in all that the period depends on."""

    @abstractmethod
    def step(self, period: Period, errors: Expression) -> Expression:
        """Return the state (states,) after a period with `errors` (m,); for errors of 0 the system's step."""

    @property
    @abstractmethod
    def size(self) -> int:
        """Number m of errors of a period."""

    @property
    @abstractmethod
    def text(self) -> str:
        """Kind and size of the noise, in words."""

    def issues(self, system: System) -> list[Issue]:
        """Return why that system cannot have this noise; [] if it can."""
        return []


@lru_cache(maxsize=16)
def erring(noise: ProcessNoise, system: System) -> ca.Function:
    """Return the function (state, inputs, parameters, period, errors) -> next state."""
    period, errors = Period(system, *step_symbols(system)), ca.SX.sym("errors", noise.size)
    return ca.Function("erring", [*period[1:], errors], [noise.step(period, errors)])


@lru_cache(maxsize=16)
def spread(noise: ProcessNoise, system: System) -> ca.Function:
    """Return the function (state, inputs, parameters, period) -> (dx+/dw (states, m) at w = 0, Q)."""
    period, errors = Period(system, *step_symbols(system)), ca.SX.sym("errors", noise.size)
    effect = ca.jacobian(noise.step(period, errors), errors)
    effect = ca.substitute(effect, errors, ca.SX.zeros(noise.size))
    return ca.Function("spread", [*period[1:]], [ca.sparsify(effect), ca.sparsify(noise.covariance(period))])
