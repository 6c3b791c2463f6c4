"""Certificates: proved upper bounds on the objective, with their assumptions."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from oed.foundation.arrays import ROUNDING, Array
from oed.foundation.equality import ByValue
from oed.foundation.presenting import Card, Presented, given, number
from oed.foundation.text import significant
from oed.kernel.criteria import Criterion, E
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.results import Evaluation

INFLATION = 1e-9
"""Share of the information by which every bound is raised, far above the rounding errors."""
OF_ALL = (
    "the study's model at its nominal parameter values, with its duration, samples and held inputs",
    "information is linearised about these values",
    f"computed in floating point, raised by {significant(1)(INFLATION)} of the information against rounding",
)
"""Assumptions common to all bounds."""
LOOSE = 0.05
"""Gap above which a bound counts as loose."""
LATTICE = "lattice"
"""Name and kind of the best drive of the lattice search."""
SMALLEST = E()
"""Default criterion: the smallest eigenvalue."""


@dataclass(frozen=True)
class Bound:
    """Proved upper bound on the objective.

    Attributes:
        value: upper bound on the objective of every feasible design.
        method: derivation of the bound, in words.
        assumptions: assumptions of the bound, one sentence each.
        multiplier: matrix Z >= 0 with trace 1 if the bound is one on tr(Z F), as in lambda_min(F) <= tr(Z F);
            other criteria use `Criterion.trace_bound`. None for other bounds.
        block: block of readings with the information F; "" for all readings.
    """

    value: float
    method: str
    assumptions: tuple[str, ...]
    multiplier: Array | None = None
    block: str = ""


@dataclass(frozen=True, repr=False, eq=False)
class Certificate(ByValue, Presented):
    """Smallest of the bounds that hold for a problem, with the best drive of the search.

    Attributes:
        upper_bound: upper bound on the objective of designs that satisfy the limits exactly; infinite if
            nothing is proved.
        method, multiplier: method and multiplier of the smallest bound.
        assumptions: assumptions common to all bounds, then those of the smallest one.
        bounds: all bounds, the smallest first.
        drive: best drive of the lattice search; None without one.
        complete: True if the search reached its gap before its limits on nodes and time.
        nodes: number of nodes of the search, 0 without one.
        widened: certificate for limits widened by the scoring tolerance: it holds for every feasible design.
        criterion: criterion that is bounded.
        judged: number of parameters that the criterion judges.
        wall_seconds: computing time [s].
    """

    upper_bound: float
    method: str
    assumptions: tuple[str, ...]
    multiplier: Array | None = None
    bounds: tuple[Bound, ...] = ()
    drive: Trajectory | None = None
    complete: bool = True
    nodes: int = 0
    widened: Certificate | None = None
    criterion: Criterion = SMALLEST
    judged: int = 1
    wall_seconds: float = field(default=0.0, compare=False)

    def __post_init__(self) -> None:
        """Add the common assumptions to a finite bound."""
        if np.isfinite(self.upper_bound):
            object.__setattr__(self, "assumptions", with_common(self.assumptions))

    def bound_on(self, evaluation: Evaluation) -> float:
        """Return the bound that applies to a drive; see `bound_on`."""
        widened = None if self.widened is None else self.widened.upper_bound
        return bound_on(evaluation, self.upper_bound, widened)

    def gap(self, objective: float, bound: float | None = None) -> float:
        """Return the share by which a bound exceeds an objective, in efficiency.

        That is bound / objective - 1 for E, exp((bound - objective) / p) - 1 for D, and
        objective / bound - 1 for A.

        Args:
            objective: objective of a design.
            bound: bound that applies to the design, see `bound_on`; by default the one for exact limits.
        """
        most = self.upper_bound if bound is None else bound
        return gap(most, objective, self.criterion, self.judged)

    def loose(self, objective: float) -> bool:
        """Return True if the gap of a design with this objective is above `LOOSE`."""
        return self.gap(objective) > LOOSE

    def _card(self) -> Card:
        facts = given(
            ("upper bound", number(self.upper_bound)),
            ("method", self.method),
            ("assumes", "; ".join(self.assumptions)),
            ("search", "" if self.complete else "not complete: more nodes may lower the bound"),
        )
        rows = tuple((number(bound.value), bound.method) for bound in self.bounds)
        return Card("Certificate: no design has a larger objective", facts, ("bound", "method"), rows)


def with_common(assumptions: Iterable[str]) -> tuple[str, ...]:
    """Return the common assumptions, followed by further ones."""
    return (*OF_ALL, *(assumption for assumption in assumptions if assumption not in OF_ALL))


def gap(bound: float, objective: float, criterion: Criterion = SMALLEST, judged: int = 1) -> float:
    """Return the share by which a bound exceeds an objective; infinite for an unidentifiable design.

    Args:
        bound: bound on the objective.
        objective: objective of a design.
        criterion: criterion of both values.
        judged: number of parameters that the criterion judges.
    """
    useless = not np.isfinite(objective) or (criterion.proportional and objective <= 0)
    return np.inf if useless or bound == np.inf else criterion.change(bound, objective, judged)


def inflate(bound: float, criterion: Criterion, judged: int) -> float:
    """Return a bound raised by more than the rounding errors of the information.

    Args:
        bound: bound on the objective, of any sign.
        criterion: criterion of the bound.
        judged: number of parameters that the criterion judges.
    """
    return criterion.scaled(bound, INFLATION, judged) if np.isfinite(bound) else bound


def bound_on(evaluation: Evaluation, exact: float, widened: float | None) -> float:
    """Return the bound that applies to a drive: the widened one if it uses the tolerance of the limits.

    Args:
        evaluation: evaluation of the drive.
        exact: bound for limits satisfied exactly.
        widened: bound for limits satisfied within the tolerance; None without one.
    """
    if widened is None or not evaluation.feasible:
        return exact
    satisfied = all(margin.violation <= ROUNDING * margin.size for margin in evaluation.margins)
    # A drive that satisfies the limits but for rounding may exceed the exact bound by rounding.
    return exact if satisfied and evaluation.objective <= exact else widened
