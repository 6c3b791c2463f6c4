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
    """What a sensor may read at one time; expressions.

    Attributes:
        system: that is driven.
        state: (states,).
        inputs: held at that time, (inputs,).
        signals: the system's, at that instant or as means of the period; attributes by their names.
        nuisances: the sensor's own, by the names it gave them.
        earlier: of a sensor that reads between samples, the moment that its reading begins at.
        elapsed: the time since then [s]; 0 of other sensors.
        period: how long a reading of a period lasts [s]; 0 of an instant.
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
    """A moment at which nothing is known: symbols for all that is asked.

    Attributes:
        SIZE: entries of each, more than any system's state or signal has.
        nuisances: the sensor's own.
    """

    SIZE = 32

    def __init__(self, nuisances: Mapping[str, Expression]) -> None:
        """Keep the nuisances."""
        self.nuisances = nuisances

    @property
    def earlier(self) -> AnyMoment:
        """Another one."""
        return AnyMoment(self.nuisances)

    def __getattr__(self, name: str) -> Expression:
        """A symbol."""
        return ca.SX.sym(name, self.SIZE)
