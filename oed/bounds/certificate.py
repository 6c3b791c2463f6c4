"""What is proved about the best design: an upper bound on the objective, and under which assumptions."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from oed.foundation.arrays import Array
from oed.foundation.equality import ByValue
from oed.foundation.presenting import Card, Presented, given, number
from oed.foundation.text import significant
from oed.kernel.criteria import Criterion, E
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.results import Evaluation

INFLATION = 1e-9
"""Share of the information by which every bound is raised, far above what rounding can have taken from it."""
OF_ALL = (
    "the study's model at its nominal parameter values, with its duration, samples and held inputs",
    "information is linearised about these values",
    f"computed in floating point, raised by {significant(1)(INFLATION)} of the information against rounding",
)
"""What every bound is about, whatever else it assumes."""
LOOSE = 0.05
"""Gap above which a bound is called loose."""
LATTICE = "lattice"
"""Name and kind of the drive that the lattice's search comes upon."""
EXACT = 1e-9
"""Share of a limit's size by which a drive that satisfies it exactly may exceed it, for rounding."""
SMALLEST = E()
"""The smallest eigenvalue."""


@dataclass(frozen=True)
class Bound:
    """One proved upper bound on the objective.

    Attributes:
        value: no feasible design scores more.
        method: how it was found.
        assumptions: what it rests on, one sentence each.
        multiplier: the Z >= 0 of which tr(Z F) is bounded, where it is one of these: with trace 1 for
            lambda_min(F) <= tr(Z F); of other criteria see `Criterion.trace_bound`.
        block: of the readings that F is of; "" of all.
    """

    value: float
    method: str
    assumptions: tuple[str, ...]
    multiplier: Array | None = None
    block: str = ""


@dataclass(frozen=True, repr=False, eq=False)
class Certificate(ByValue, Presented):
    """The smallest of the bounds found, and what drives were found with it.

    Attributes:
        upper_bound: no design that satisfies the limits exactly has a larger objective; infinite if nothing
            is proved.
        method, multiplier: of that bound.
        assumptions: of every bound, then those of that one.
        bounds: every bound found, the smallest first.
        drive: a drive that the search for the bound came upon, where it did.
        complete: whether the search for it ended by itself, not by the most nodes allowed.
        nodes: of that search, 0 without one.
        widened: the same of limits widened by what scoring tolerates: no feasible design exceeds it.
        criterion: that is bounded.
        judged: number of parameters that it judges.
        wall_seconds: of the computation.
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
        """Say what every bound is about, where something is proved."""
        if np.isfinite(self.upper_bound):
            object.__setattr__(self, "assumptions", with_common(self.assumptions))

    def bound_on(self, evaluation: Evaluation) -> float:
        """The bound that a drive is to be held against; see `bound_on`."""
        widened = None if self.widened is None else self.widened.upper_bound
        return bound_on(evaluation, self.upper_bound, widened)

    def gap(self, objective: float, bound: float | None = None) -> float:
        """By what share a bound, by default the exact one, exceeds an objective, in efficiency: for E
        bound / objective - 1, for D exp((bound - objective) / p) - 1, for A objective / bound - 1.

        Args:
            objective: of a design.
            bound: of designs like that one, see `bound_on`.
        """
        most = self.upper_bound if bound is None else bound
        return gap(most, objective, self.criterion, self.judged)

    def loose(self, objective: float) -> bool:
        """Whether the bound says little about a design of that objective."""
        return self.gap(objective) > LOOSE

    def _card(self) -> Card:
        facts = given(
            ("upper bound", number(self.upper_bound)),
            ("method", self.method),
            ("assumes", "; ".join(self.assumptions)),
            ("search", "" if self.complete else "not complete: more nodes may lower the bound"),
        )
        rows = tuple((number(one.value), one.method) for one in self.bounds)
        return Card("Certificate: no design has a larger objective", facts, ("bound", "method"), rows)


def with_common(assumptions: Iterable[str]) -> tuple[str, ...]:
    """Assumptions of a bound after those of every bound, which earlier versions did not say."""
    return (*OF_ALL, *(one for one in assumptions if one not in OF_ALL))


def gap(bound: float, objective: float, criterion: Criterion = SMALLEST, judged: int = 1) -> float:
    """By what share a bound exceeds an objective, in efficiency; infinite for what is not identifiable.

    Args:
        bound: on the objective.
        objective: of a design.
        criterion: whose values both are.
        judged: number of parameters that it judges.
    """
    useless = not np.isfinite(objective) or (criterion.proportional and objective <= 0)
    return np.inf if useless or bound == np.inf else criterion.change(bound, objective, judged)


def raised(bound: float, criterion: Criterion, judged: int) -> float:
    """Return a bound for a little more information than rounding can have taken from it.

    Args:
        bound: on the objective, of any sign.
        criterion: whose value it is.
        judged: number of parameters that it judges.
    """
    return criterion.scaled(bound, INFLATION, judged) if np.isfinite(bound) else bound


def bound_on(evaluation: Evaluation, exact: float, widened: float | None) -> float:
    """The bound that a drive is to be held against, of two for exact and for widened limits.

    The widened one for a drive that satisfies the limits within the tolerance only.

    Args:
        evaluation: of the drive.
        exact: the bound for limits satisfied exactly.
        widened: the bound for limits within the tolerance; None without one.
    """
    if widened is None or not evaluation.feasible:
        return exact
    satisfied = all(margin.violation <= EXACT * margin.size for margin in evaluation.margins)
    # What is satisfied to rounding may exceed by rounding.
    return exact if satisfied and evaluation.objective <= exact else widened
