"""Systems whose instants a search watches: the nominal one, and all others that are to keep the limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from oed.foundation.arrays import Bools
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.rollout import Instant, instant_of
from oed.kernel.dynamics.system import System
from oed.kernel.limit import PathLimit, Rows
from oed.kernel.problem import Problem
from oed.kernel.tightening import Scenarios


@dataclass(frozen=True)
class WatchedRows:
    """Rows of a limit, and the systems that are to keep them.

    Attributes:
        limit: place of the limit among the problem's.
        rows: rows at an instant.
        systems: True for each of the watched systems that keeps them, (K,).
    """

    limit: int
    rows: Rows
    systems: Bools


def watched_systems(problem: Problem) -> Scenarios:
    """Return the nominal system and, of a robust problem, those that are to keep limits on the path."""
    if problem.robust is None:
        return Scenarios.nominal(problem.system, problem.design.runs)
    return problem.robust.scenarios(problem.uncertain_system).after_nominal


@dataclass(frozen=True)
class Watched:
    """Symbols of an instant of a watched system (SX).

    Attributes:
        state: state where the instant's sample begins, (states,).
        sensitivities: sensitivities of that state by (parameters, start), column by column.
        held: inputs held in the sample, SI, (inputs,).
        asked: inputs that the splines ask for at the instant, SI, (inputs,).
        elapsed: time since the sample's begin [s].
        parameters: parameters of the system, (p,); none where all are nominal.
    """

    state: Expression
    sensitivities: Expression
    held: Expression
    asked: Expression
    elapsed: Expression
    parameters: Expression

    @classmethod
    def of(cls, scenarios: Scenarios, held: Expression, asked: Expression) -> Watched:
        """Return symbols of an instant; parameters are symbols only where they differ.

        Args:
            scenarios: the watched systems.
            held: inputs held in the sample, SI, (inputs,).
            asked: inputs that the splines ask for at the instant, SI, (inputs,).
        """
        system = scenarios.system
        states, width = len(system.states), len(system.parameters) + len(system.states)
        return cls(
            state=ca.SX.sym("state", states),
            sensitivities=ca.SX.sym("S", states * width),
            held=held,
            asked=asked,
            elapsed=ca.SX.sym("elapsed"),
            parameters=ca.SX.sym("p", scenarios.varied.shape[1]),
        )

    @property
    def columns(self) -> int:
        """Number of columns of the sensitivities."""
        return int(self.sensitivities.shape[0]) // max(int(self.state.shape[0]), 1)

    def rows(self, problem: Problem, limits: Sequence[int]) -> list[WatchedRows]:
        """Return the rows of limits at the instant.

        Limits on the path of a robust problem have a back-off for the nominal system, if its treatment has
        one, and none for all others. Other limits are those of the nominal system.

        Args:
            problem: problem with the limits.
            limits: places of the limits.
        """
        robust, scenarios = problem.robust, watched_systems(problem)
        is_nominal = np.arange(len(scenarios.parameters)) == 0
        nominal = self._instant(problem.system, ca.SX(ca.DM(problem.system.nominal)), None)
        rows = []
        for place in limits:
            limit = problem.limits[place]
            if robust is None or not isinstance(limit, PathLimit):
                rows.append(WatchedRows(place, limit.rows(nominal), is_nominal))
                continue
            varied = self.parameters if scenarios.varied.size else ca.SX(ca.DM(scenarios.system.nominal))
            seen = self._instant(scenarios.system, varied, self.sensitivities)
            if robust.backs_off:
                tightened = robust.backed_off(limit, seen, problem.uncertain_system)
                rows.append(WatchedRows(place, tightened, is_nominal))
            if not robust.backs_off or len(is_nominal) > 1:
                rows.append(WatchedRows(place, limit.rows(seen), ~is_nominal | (not robust.backs_off)))
        return rows

    def _instant(self, system: System, parameters: Expression, sensitivities: Expression | None) -> Instant:
        states = len(system.states)
        return instant_of(
            system,
            state=self.state,
            held=self.held,
            parameters=parameters,
            period=self.elapsed,
            asked=self.asked,
            fraction=ca.SX(1),
            sensitivities=None if sensitivities is None else ca.reshape(sensitivities, states, -1),
        )
