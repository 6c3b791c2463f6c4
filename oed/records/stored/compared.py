"""Models that were compared on the same logs, as estimate.json holds them."""

from __future__ import annotations

from oed.records.stored.parts import Interval, Maybe, Positive, Stored, require_known


class FittedParameter(Stored):
    """A parameter of a model."""

    name: str
    unit: str | None
    value: Maybe
    standard_error: Positive | None


class Score(Stored):
    """How good a model is by a measure."""

    value: Maybe
    difference: Maybe
    interval: Interval | None
    equal: bool


class ComparedModel(Stored):
    """A model that was compared."""

    name: str
    kind: str
    own: bool
    comparable: bool
    reason: str
    doubt: str
    parameters: list[FittedParameter]
    unknowns: Maybe
    starts: Maybe
    log_likelihood: Maybe
    scores: dict[str, Score]


class Models(Stored):
    """Models side by side, as `Comparison` has them."""

    models: list[ComparedModel]
    readings: Maybe
    inflation: Maybe
    inflation_by: str
    best: dict[str, str]
    agree: bool | None
    favourites: list[str]

    def _require(self) -> None:
        names = [one.name for one in self.models]
        require_known("best", self.best.values(), names)
        require_known("favourites", self.favourites, names)
