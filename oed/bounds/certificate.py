"""What is proved about the best drive: an upper bound on the objective, and under which assumptions."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from oed.trajectory import Trajectory

Array = npt.NDArray[np.float64]

INFLATION = 1e-9
"""Share by which every bound is raised, far above what rounding can have taken from it."""
LOOSE = 0.05
"""Gap above which a bound is called loose."""


@dataclass(frozen=True)
class Cap:
    """One proved upper bound on the objective.

    Attributes:
        value: no feasible drive scores more.
        method: how it was found.
        assumptions: what it rests on, one sentence each.
        multiplier: the Z >= 0 with trace 1 of lambda_min(F) <= tr(Z F), where it is one of these.
    """

    value: float
    method: str
    assumptions: tuple[str, ...]
    multiplier: Array | None = None


@dataclass(frozen=True)
class Certificate:
    """The smallest of the bounds found, and what drives were found with it.

    Attributes:
        upper_bound: no drive that keeps the limits has a larger objective; infinite if nothing is proved.
        method, assumptions, multiplier: of that bound.
        caps: every bound found, the smallest first.
        drive: a drive that the search for the bound came upon, where it did.
        complete: whether the search for it ended by itself, not by its time limit.
        wall_seconds: of the computation.
    """

    upper_bound: float
    method: str
    assumptions: tuple[str, ...]
    multiplier: Array | None = None
    caps: tuple[Cap, ...] = ()
    drive: Trajectory | None = None
    complete: bool = True
    wall_seconds: float = field(default=0.0, compare=False)

    def gap(self, objective: float) -> float:
        """By what share the bound exceeds an objective: upper_bound / objective - 1."""
        return self.upper_bound / objective - 1 if objective > 0 else np.inf

    def loose(self, objective: float) -> bool:
        """Whether the bound leaves much open about a design of that objective."""
        return self.gap(objective) > LOOSE
