"""Limits tightened for what is uncertain of a system: what the kernel asks of it.

Several systems get one design: the nominal one keeps limits with a back-off, others keep them as they stand,
and the criterion is that of one or of several together. Which these are follows from distributions above.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.foundation.component import Component
from oed.foundation.errors import Issue
from oed.kernel.dynamics.rollout import Drive
from oed.kernel.dynamics.system import System
from oed.kernel.limit import Limit, PathLimit, Rows
from oed.kernel.measurement.prior import Prior


@dataclass(frozen=True, eq=False)
class UncertainSystem:
    """A system, and what is said of its parameters before it is driven.

    Those of which the same is said, in the same order, are equal: functions of them are kept.

    Attributes:
        model: system with its own parameters.
        estimated: system with the parameters to estimate, which may be others.
        runs: number of runs of a drive.
        uncertainty: distribution of the system's parameters, or None.
        prior: prior knowledge of the parameters to estimate, or None.
    """

    model: System
    estimated: System
    runs: int
    uncertainty: ParameterUncertainty | None
    prior: Prior | None

    def __eq__(self, other: object) -> bool:
        """Return whether both are the same system with the same prior knowledge."""
        return isinstance(other, UncertainSystem) and self._identity == other._identity

    def __hash__(self) -> int:
        """Return the hash of the system and its prior knowledge."""
        return hash(self._identity)

    @cached_property
    def _identity(self) -> tuple[System, System, int, str, str]:
        return self.model, self.estimated, self.runs, repr(self.uncertainty), repr(self.prior)


@dataclass(frozen=True, eq=False)
class Scenarios:
    """K values of a system's parameters and starts.

    Attributes:
        system: system with these parameters.
        parameters: values of its parameters, (K, p), SI.
        shifts: shifts of the start states, (K, runs, states), SI.
    """

    system: System
    parameters: Array
    shifts: Array

    @classmethod
    def nominal(cls, system: System, runs: int) -> Scenarios:
        """Return the nominal values of a system alone.

        Args:
            system: system with nominal parameters.
            runs: number of runs of a drive.
        """
        return cls(system, np.array([system.nominal]), np.zeros((1, runs, len(system.states))))

    @property
    def varied(self) -> Array:
        """Parameters (K, p) where any are not nominal, else none: (K, 0)."""
        is_varied = (self.parameters != np.array(self.system.nominal)).any()
        return self.parameters if is_varied else self.parameters[:, :0]

    @property
    def each(self) -> tuple[tuple[Array, Array], ...]:
        """Parameters (p,) and shifts (runs, states) of one after the other."""
        return tuple(zip(self.parameters, self.shifts, strict=True))

    @property
    def after_nominal(self) -> Scenarios:
        """The nominal values, then these."""
        nominal = Scenarios.nominal(self.system, self.shifts.shape[1])
        return Scenarios(
            self.system,
            np.vstack([nominal.parameters, self.parameters]),
            np.concatenate([nominal.shifts, self.shifts]),
        )


class ParameterUncertainty(Component, ABC):
    """Uncertainty of a system about its nominal parameters: what a design has to survive."""

    @abstractmethod
    def issues(self, system: UncertainSystem) -> list[Issue]:
        """Why the system cannot be uncertain so; [] if it can."""


class Tightening(Component, ABC):
    """Treatment of limits for uncertain systems, and the parameters for which a drive is to be good.

    Attributes:
        kind: name in files.
        objective: the criterion of the "nominal" system, or the "mean" or the "worst" over several.
    """

    kind: str
    objective: Literal["nominal", "mean", "worst"] = "nominal"

    @abstractmethod
    def backed_off(self, limit: PathLimit, drive: Drive, system: UncertainSystem) -> Rows:
        """A limit with its back-off, on a drive of the nominal system that has the uncertain parameters.

        Args:
            limit: limit on states.
            drive: drive of the nominal system.
            system: system with its uncertainty.
        """

    @abstractmethod
    def scenarios(self, system: UncertainSystem) -> Scenarios:
        """Return the scenarios that are to keep every limit as it stands, besides the nominal one."""

    @abstractmethod
    def judged(self, system: UncertainSystem) -> Scenarios:
        """Return the scenarios whose criterion counts, where it is not that of the nominal one alone."""

    @property
    def backs_off(self) -> bool:
        """True if limits have a back-off at all."""
        return True

    def issues(self, system: UncertainSystem) -> list[Issue]:
        """Why limits cannot be tightened so for a system; [] if they can."""
        return []

    def together(self, values: Sequence[float | Array]) -> Array:
        """One number (...,) of the criterion's (...,) for each scenario that is judged."""
        table = np.array(values, dtype=float)
        return np.asarray(table.mean(axis=0) if self.objective == "mean" else table.min(axis=0))


def tightened_rows(
    tightening: Tightening, limits: Sequence[Limit], drive: Drive, system: UncertainSystem
) -> list[Rows]:
    """Every limit on a drive; those on its path with their back-off, and for all scenarios that keep them.

    Args:
        tightening: treatment of the limits.
        limits: all of the problem.
        drive: drive of the nominal system.
        system: system with its uncertainty.
    """
    begin, _ = drive.ends_of(drive.states)
    scenarios, nominal = tightening.scenarios(system), drive
    seen_system = scenarios.system
    drives = [
        drive.again(ca.DM(parameters), begin + ca.DM(shift), seen_system)
        for parameters, shift in scenarios.each
    ]
    if seen_system != drive.system:
        # Seen through other parameters, a system would not say by itself how its own ones move it.
        nominal = drive.again(ca.DM(seen_system.nominal), begin, seen_system)

    def tightened(limit: PathLimit) -> Rows:
        rows = tightening.backed_off(limit, nominal, system) if tightening.backs_off else limit.rows(nominal)
        return rows.joined([limit.rows(scenario) for scenario in drives])

    return [tightened(limit) if isinstance(limit, PathLimit) else limit.rows(drive) for limit in limits]
