"""How often systems with uncertain parameters violate limits that the nominal one satisfies."""

from __future__ import annotations

from dataclasses import dataclass

from oed.foundation.arrays import Array


@dataclass(frozen=True)
class Violation:
    """How often robots violate the limits that the nominal robot satisfies.

    Attributes:
        probability: of a violation: share of the draws that exceed a limit on the path at any time.
        interval: of that probability, 95 %, exact [Clopper and Pearson, 1934].
        draws, seed: of the simulation.
        by_limit: share of the draws that exceed each limit.
        farthest: how far the worst draws exceed a limit, as a share of the limit's size; 0 for none, infinite
            where a drive is not a number somewhere.
        worst: the uncertain quantities of the draws that exceed a limit most, SI, (<= 4, q).
        checked_at_points: limits that draws were checked against at some points only: more may exceed them.
    """

    probability: float
    interval: tuple[float, float]
    draws: int
    seed: int
    by_limit: dict[str, float]
    farthest: float
    worst: Array
    checked_at_points: tuple[str, ...] = ()

    @property
    def sentence(self) -> str:
        """The probability in words."""
        share = f"{self.probability:.2%} of {self.draws} simulated robots violate the limits."
        points = ", ".join(self.checked_at_points)
        return f"{share} Checked at points only: {points}; between them more may." if points else share

    def surely_below(self, probability: float) -> bool:
        """Whether the whole interval lies below a probability."""
        return self.interval[1] <= probability
