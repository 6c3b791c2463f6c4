"""What is proved of all drives."""

from __future__ import annotations

from pydantic import Field

from oed.records.stored.parts import Matrix, Name, Number, Positive, Stored


class StoredBound(Stored):
    """A bound and how it is proved."""

    upper_bound: Number
    method: str
    assumptions: list[str]


class StoredCertificate(StoredBound):
    """A record's `certificate`."""

    gap: Number | None
    multiplier: Matrix | None = None
    loose: bool | None = None
    complete: bool = True
    best: Number | None = None
    drive: Name | None = None
    spline_objective: Number | None = None
    caps: list[StoredBound] = Field(default_factory=list)
    wall_seconds: Positive = 0.0
