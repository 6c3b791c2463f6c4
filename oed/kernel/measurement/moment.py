"""Moments: what a sensor may read at one time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca

from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.rollout import Named
from oed.kernel.dynamics.system import System


@dataclass(frozen=True)
class Moment(Named):
    """Expressions that a sensor may read at one time.

    Attributes:
        system: system that is driven.
        state: states, (states,).
        inputs: inputs held at that time, (inputs,).
        signals: the system's signals, at that instant or as means of the period; attributes by their names.
        nuisances: the sensor's nuisances, by their names.
        earlier: moment at which the reading of a sensor between samples begins.
        elapsed: time since then [s]; 0 for other sensors.
        period: duration of the reading of a period [s]; 0 for an instant.
    """

    system: System
    state: Expression
    inputs: Expression
    signals: Mapping[str, Expression]
    nuisances: Mapping[str, Expression]
    earlier: Moment | None = None
    elapsed: Expression | float = 0.0
    period: Expression | float = 0.0


class AnyMoment:
    """A moment of symbols alone, for whatever attribute is read.

    Attributes:
        SIZE: entries of every symbol, more than any system's state or signal has.
        nuisances: the sensor's nuisances.
    """

    SIZE = 32

    def __init__(self, nuisances: Mapping[str, Expression]) -> None:
        """Keep the nuisances."""
        self.nuisances = nuisances

    @property
    def earlier(self) -> AnyMoment:
        """A further moment of symbols."""
        return AnyMoment(self.nuisances)

    def __getattr__(self, name: str) -> Expression:
        """Return a symbol."""
        return ca.SX.sym(name, self.SIZE)
