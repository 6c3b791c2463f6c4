"""How far a drive stays inside a limit."""

from __future__ import annotations

from dataclasses import dataclass

TOLERANCE = 1e-3
"""A limit is satisfied when it is exceeded by at most this share of its size, and active within it."""


@dataclass(frozen=True)
class Margin:
    """How far a trajectory stays inside one limit.

    Attributes:
        name: of the limit.
        margin: distance to the limit at the closest time, in `unit`; negative when it is exceeded.
        size: the limit's size in `unit`.
        unit: SI unit.
        certain: whether that is so at all times; else only at the points that were checked.
    """

    name: str
    margin: float
    size: float
    unit: str
    certain: bool = True

    @property
    def active(self) -> bool:
        """Whether the trajectory touches the limit (or exceeds it)."""
        return self.margin <= TOLERANCE * self.size

    @property
    def violation(self) -> float:
        """Amount by which the limit is exceeded, 0 where it is satisfied."""
        return max(0.0, -self.margin)

    @property
    def satisfied(self) -> bool:
        """Whether the limit is satisfied, within `TOLERANCE` of its size."""
        return self.violation <= TOLERANCE * self.size
