"""What is proved of all drives."""

from __future__ import annotations

from pydantic import Field

from oed.records.stored.parts import Count, Matrix, Name, Number, Positive, Seconds, Stored


class UpperBound(Stored):
    """A bound and how it is proved."""

    upper_bound: Number
    method: str
    assumptions: list[str]


class WidenedBound(UpperBound):
    """A bound on drives that satisfy the limits within a tolerance, a share of each limit's size."""

    tolerance: Positive


class StoredCertificate(UpperBound):
    """A record's `certificate`.

    Attributes:
        gap: of the best result to the bound, None where there is none.
        gap_to: the bound that this gap is to.
        multiplier: proves the bound.
        widened: what holds for drives that satisfy the limits within the tolerance.
        loose: whether the gap is too large to be informative.
        complete: whether the search for the bound came to its end.
        nodes: of that search.
        best: largest objective of a feasible result.
        drive: name of the result that the search for the bound came upon.
        spline_objective: largest objective of a feasible result of a search over splines.
        bounds: every bound that was found, the lowest first.
        wall_seconds: of the search for the bound.
    """

    gap: Number | None
    multiplier: Matrix | None = None
    widened: WidenedBound | None = None
    gap_to: Number | None = None
    loose: bool | None = None
    complete: bool = True
    nodes: Count | None = None
    best: Number | None = None
    drive: Name | None = None
    spline_objective: Number | None = None
    bounds: list[UpperBound] = Field(default_factory=list, alias="caps")
    wall_seconds: Seconds = 0.0
