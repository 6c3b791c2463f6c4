"""What estimate.json holds; readers do without whatever an older file leaves out."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from oed.records.stored.parts import (
    Count,
    Interval,
    Keyed,
    Number,
    Positive,
    Seed,
    Stored,
    require_alike,
    require_different,
    require_known,
    require_table,
)
from oed.records.stored.study_record import Provenance

Maybe = Number | None
Column = list[Maybe]
Steps = dict[str, Maybe]


class Value(Stored):
    """A parameter's value."""

    name: str
    value: Number


class Estimates(Stored):
    """As much of an estimate as says what a robot's parameters are."""

    parameters: list[Value]


class Estimated(Keyed):
    """A parameter with its estimate."""

    name: str
    value: Maybe
    unit: str | None = None
    nominal: Maybe = None
    size: Maybe = None
    standard_error: Positive | None = None
    interval: Interval | None = None
    standard_errors: dict[str, Positive | None] | None = None


class Along(Stored):
    """Another unknown, or a coefficient."""

    name: str
    unit: str | None = None
    value: Maybe = None
    standard_error: Positive | None = None
    file: str | None = None


class TriedLength(Stored):
    """A length of segments that was tried, and the errors found with it by what they are of."""

    __pydantic_extra__: dict[str, Number | None]

    seconds: Positive | None


class Segments(Stored):
    """What logs were cut into."""

    seconds: Positive | None = None
    count: Count | None = None
    chosen: bool | None = None
    drifts: bool | None = None
    tried: list[TriedLength] | None = None


class FoundNoise(Stored):
    """The noise of readings."""

    about: str
    unit: str | None = None
    at_rest: Maybe = None
    per_speed: Maybe = None
    per_yaw_rate: Maybe = None


class Diagnostic(Stored):
    """A test of the fit."""

    name: str
    about: str
    passed: bool
    message: str
    statistic: Maybe = None
    p_value: Maybe = None


class Finding(Stored):
    """What was noticed about a log."""

    name: str
    message: str
    doubtful: bool | None = None


class ReadLog(Stored):
    """A log."""

    name: str
    file: str | None = None
    seconds: Positive | None = None
    poses: Count | None = None
    quantities: list[str] | None = None
    clock_offset: Maybe = None
    findings: list[Finding] | None = None


class Known(Stored):
    """Numbers of logs with nominal and with estimated parameters."""

    logs: Annotated[list[str], Field(min_length=1)]
    before: list[Steps]
    after: list[Steps]
    parameters: dict[str, Maybe] | Column | None = None
    mean: dict[str, Steps] | None = None

    @model_validator(mode="after")
    def _fits(self) -> Known:
        require_alike(len(self.logs), before=self.before, after=self.after)
        return self


class FittedParameter(Keyed):
    """A parameter of a model."""

    name: str
    unit: str | None
    value: Maybe
    standard_error: Positive | None


class Score(Keyed):
    """How good a model is by a measure."""

    value: Maybe
    difference: Maybe
    interval: Interval | None
    equal: bool


class ComparedModel(Keyed):
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
    """The comparison of models."""

    models: list[ComparedModel]
    readings: Maybe
    inflation: Maybe
    inflation_by: str
    best: dict[str, str]
    agree: bool | None
    favourites: list[str]

    @model_validator(mode="after")
    def _fits(self) -> Models:
        names = [one.name for one in self.models]
        require_known("best", self.best.values(), names)
        require_known("favourites", self.favourites, names)
        return self


class Reckoned(Stored):
    """A path, measured and by dead reckoning."""

    log: str
    role: str | None = None
    t: Column | None = None
    x: Column
    y: Column
    before_x: Column
    before_y: Column
    after_x: Column
    after_y: Column

    @model_validator(mode="after")
    def _fits(self) -> Reckoned:
        columns = ("y", "before_x", "before_y", "after_x", "after_y")
        require_alike(len(self.x), **{name: getattr(self, name) for name in columns})
        return self


class Residuals(Stored):
    """Residuals of a quantity of a log."""

    log: str
    quantity: str
    unit: str | None = None
    t: Column
    value: Column
    speed: Column
    yaw_rate: Column | None = None

    @model_validator(mode="after")
    def _fits(self) -> Residuals:
        require_alike(len(self.t), value=self.value, speed=self.speed, yaw_rate=self.yaw_rate or self.t)
        return self


class Correlations(Stored):
    """Correlations of residuals with later ones."""

    about: str
    values: Column
    bound: Maybe = None


class StoredEstimate(Stored):
    """The outcome of a calibration; the study itself is checked by its own reader."""

    format: Literal[1]
    parameters: list[Estimated]
    oed_version: str | None = None
    study: dict[str, Any] | None = None
    study_text: str | None = None
    provenance: Provenance | None = None
    seed: Seed | None = None
    method: str | None = None
    covariance: list[Column] | None = None
    correlation: list[Column] | None = None
    covariance_kind: str | None = None
    half_width: Maybe = None
    coefficients: list[Along] | None = None
    nuisances: list[Along] | None = None
    segments: Segments | None = None
    noise: list[FoundNoise] | None = None
    converged: bool | None = None
    untold: list[str] | None = None
    notes: list[str] | None = None
    diagnostics: list[Diagnostic] | None = None
    logs: list[ReadLog] | None = None
    left_out: list[Known] | None = None
    held_out: Known | None = None
    comparison: Models | None = None
    paths: list[Reckoned] | None = None
    residuals: list[Residuals] | None = None
    correlations: list[Correlations] | None = None

    @model_validator(mode="after")
    def _fits(self) -> StoredEstimate:
        require_different("parameters", [one.name for one in self.parameters])
        for what in ("covariance", "correlation"):
            matrix = getattr(self, what)
            if matrix:
                require_table(what, matrix, len(self.parameters), len(self.parameters))
        return self

    def plain(self) -> dict[str, Any]:
        """As plain data, as much as the file holds."""
        return self.model_dump(exclude_unset=True)
