"""What estimate.json holds; readers do without whatever an older file leaves out."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import Field

from oed.foundation import views
from oed.foundation.presenting import Card, Presented, dataframe, given, parameter_rows
from oed.foundation.text import count, listing, words
from oed.kernel.dynamics.system import ROUNDING
from oed.records.stored.compared import ComparedModel, Models
from oed.records.stored.door import SavedFile
from oed.records.stored.parts import (
    Column,
    Count,
    Entries,
    Interval,
    Maybe,
    Number,
    Place,
    Positive,
    Rounded,
    Seed,
    Stored,
    require_alike,
    require_different,
    require_table,
)
from oed.records.stored.reckoned import ReckonedPath, UnseenLogs
from oed.records.stored.study_record import Provenance

Drawn = Annotated[Column, Rounded(4)]
"""Numbers that are drawn only."""


class Value(Stored):
    """A parameter's value."""

    name: str
    value: Number


class Estimates(Stored):
    """As much of an estimate as says what a robot's parameters are."""

    parameters: list[Value]


class Estimated(Stored):
    """A parameter with its estimate; SI.

    Noise of the inputs may be a share `input_noise` of what identifies it, and the estimate too large by up
    to `bias`, for which its standard errors allow.
    """

    name: str
    value: Maybe
    unit: str | None = None
    nominal: Maybe = None
    size: Maybe = None
    standard_error: Positive | None = None
    interval: Interval | None = None
    standard_errors: dict[str, Positive | None] | None = None
    bias: Maybe = None
    input_noise: Maybe = None

    @property
    def ends(self) -> tuple[float | None, float | None]:
        """Of the 95 % interval."""
        low, high = self.interval or (None, None)
        return low, high

    @property
    def reference(self) -> float | None:
        """The nominal value's magnitude, which a change is a share of; None where it is none, or 0."""
        size = abs(self.nominal or 0.0)
        return size if size > ROUNDING * (self.size or 1.0) else None

    @property
    def nominal_outside(self) -> bool:
        """Whether the nominal value is known to lie outside of the interval."""
        low, high = self.ends
        return None not in (low, high, self.nominal) and not low <= self.nominal <= high  # type: ignore[operator]

    def error(self, kind: str) -> float | None:
        """The standard error by a kind of covariance."""
        return (self.standard_errors or {}).get(kind)


class Unknown(Stored):
    """A nuisance parameter, or a coefficient that the estimates give; SI."""

    name: str
    unit: str | None = None
    value: Maybe = None
    standard_error: Positive | None = None
    interval: Interval | None = None
    file: str | None = None


class TriedLength(Stored):
    """A length of segments that was tried [s], and the residuals' size with it by what they are of."""

    __pydantic_extra__: dict[str, Number | None]

    seconds: Positive | None

    @property
    def sizes(self) -> dict[str, float | None]:
        """RMS of the residuals by what they are of; SI."""
        return self.__pydantic_extra__


class Segments(Stored):
    """What logs were cut into."""

    seconds: Positive | None = None
    count: Count | None = None
    chosen: bool | None = None
    drifts: bool | None = None
    relative: bool | None = None
    tried: Entries[TriedLength]


class FoundNoise(Stored):
    """The noise of readings."""

    about: str
    unit: str | None = None
    at_rest: Maybe = None
    per_speed: Maybe = None
    per_yaw_rate: Maybe = None


class FoundError(Stored):
    """Something that errs in whole logs, as `oed.estimation.methods.log_errors` has them: its size, and the
    95 % interval of that, SI.
    """

    name: str
    kind: Literal["noise", "passing", "lasting", "drift"]
    about: str
    unit: str
    size: Positive
    interval: Interval


class FoundDrift(Stored):
    """Drift beside what the inputs say, as standard deviations after 1 m of path or 1 rad of turning; SI.

    It grows with the root of either. `shown` is false where the logs show that there is none, null where they
    leave it open; `seconds` the length of the windows that it was found from, null of what is only usual or
    from whole logs.
    """

    ahead: Positive
    sideways: Positive
    turn_by_path: Positive
    turn_by_turning: Positive
    shown: bool | None = None
    seconds: Positive | None = None


class FoundLasting(Stored):
    """Errors of readings that last, as `GaussMarkov` has them: sizes, SI, and the correlations' time [s]."""

    seconds: Positive
    position: Positive | None = None
    heading: Positive | None = None

    @property
    def sizes(self) -> dict[str, float]:
        """Standard deviations by the noises' names, of those that last; SI."""
        known = {"position": self.position, "heading": self.heading}
        return {name: size for name, size in known.items() if size is not None}


class Diagnostic(Stored):
    """A test of the fit."""

    name: str
    about: str
    passed: bool
    message: str
    statistic: Maybe = None
    p_value: Maybe = None
    allowed_for: bool | None = None


class Doubt(Stored):
    """Why an estimate may not be what it seems."""

    parameter: str
    name: str
    message: str


class Finding(Stored):
    """What was noticed about a log."""

    name: str
    message: str
    doubtful: bool | None = None


class ReadSensor(Stored):
    """What another sensor read during a log: how often, and how often each of its entries."""

    sensor: str
    readings: Count
    entries: list[Count]
    clock: Literal["inputs", "poses"]


class ReadLog(Stored):
    """A log."""

    name: str
    file: str | None = None
    seconds: Positive | None = None
    poses: Count | None = None
    quantities: list[str] | None = None
    clock_offset: Maybe = None
    sensors: Entries[ReadSensor]
    findings: Entries[Finding]

    @property
    def doubtful(self) -> bool:
        """Whether something was found that casts doubt on the estimates."""
        return any(one.doubtful for one in self.findings)


class Residuals(Stored):
    """Residuals of a quantity of a log."""

    log: str
    quantity: str
    unit: str | None = None
    t: Drawn
    value: Annotated[Column, Rounded(7)]
    speed: Drawn
    yaw_rate: Drawn | None = None

    def _require(self) -> None:
        require_alike(len(self.t), value=self.value, speed=self.speed, yaw_rate=self.yaw_rate or self.t)


class Correlations(Stored):
    """Correlations of residuals with later ones."""

    about: str
    values: Place
    bound: Maybe = None


class EstimateRecord(Presented, SavedFile):
    """The outcome of a calibration, as estimate.json holds it; SI, None where there is none.

    What all models that were compared have in common stands in `comparison`: readings, inflation,
    inflation_by, best, agree, favourites (as good as the best by every measure).
    """

    format: Literal[1]
    parameters: list[Estimated]
    oed_version: str | None = None
    study: dict[str, Any] | None = None
    study_text: str | None = None
    provenance: Provenance | None = None
    seed: Seed | None = None
    method: str | None = None
    covariance: Entries[Column]
    correlation: Entries[Column]
    covariance_kind: str | None = None
    half_width: Maybe = None
    half_width_together: Maybe = None
    coefficients: Entries[Unknown]
    nuisances: Entries[Unknown]
    segments: Segments | None = None
    drift: FoundDrift | None = None
    noise: Entries[FoundNoise]
    lasting: FoundLasting | None = None
    log_errors: Entries[FoundError]
    converged: bool | None = None
    not_identifiable: Annotated[Entries[str], Field(alias="untold")]
    doubts: Entries[Doubt]
    notes: Entries[str]
    diagnostics: Entries[Diagnostic]
    logs: Entries[ReadLog]
    cross_validation: Annotated[Entries[UnseenLogs], Field(alias="left_out")]
    test_set: UnseenLogs | None = Field(default=None, alias="held_out")
    comparison: Models | None = None
    paths: Entries[ReckonedPath]
    residuals: Entries[Residuals]
    correlations: Entries[Correlations]

    def _require(self) -> None:
        require_different("parameters", [one.name for one in self.parameters])
        for what in ("covariance", "correlation"):
            matrix = getattr(self, what)
            if matrix:
                require_table(what, matrix, len(self.parameters), len(self.parameters))

    @property
    def values(self) -> dict[str, float]:
        """Estimates by name, SI; NaN where there is none."""
        return {one.name: math.nan if one.value is None else one.value for one in self.parameters}

    @property
    def diluted(self) -> tuple[str, ...]:
        """Names of the parameters that noise of the inputs may have moved by much of a standard error."""
        return tuple(one.parameter for one in self.doubts if one.name == "input_noise")

    @property
    def errors(self) -> dict[str, float]:
        """Standard errors by name, SI; NaN where there is none."""
        known = ((one.name, one.standard_error) for one in self.parameters)
        return {name: math.nan if error is None else error for name, error in known}

    def plot(self, what: str | None = None) -> Any:
        """A figure (matplotlib's) of the estimate's page.

        Args:
            what: the figure's name there, e.g. "estimate_paths"; the first by default.

        Raises:
            UserMistake: the page has no such figure; names those that it has.
        """
        return views.make("figure", self, what)

    def to_dataframe(self) -> Any:
        """A pandas DataFrame with a row per parameter: nominal value, estimate and standard error, SI.

        Raises:
            UserMistake: pandas is not installed.
        """
        names = ("name", "nominal", "value", "standard_error", "unit")
        return dataframe({name: [getattr(one, name) for one in self.parameters] for name in names})

    def _card(self) -> Card:
        facts = given(
            ("robot", words(self.robot)),
            ("logs", count(len(self.logs), "log") if self.logs else ""),
            ("method", words(self.method or "")),
            ("converged", "" if self.converged is None else "yes" if self.converged else "no"),
            ("doubts", " ".join(one.message for one in self.doubts)),
            ("not identifiable", listing(self.not_identifiable)),
            ("notes", " ".join(self.notes)),
        )
        units = {one.name: one.unit or "" for one in self.parameters}
        names, nominal = tuple(units), {one.name: one.nominal for one in self.parameters}
        found = parameter_rows(
            names,
            {one.name: one.value for one in self.parameters},
            {one.name: one.standard_error for one in self.parameters},
            units,
        )
        before = parameter_rows(names, nominal, {}, units)
        rows = tuple(
            (name, old, new, error) for (name, old, _), (_, new, error) in zip(before, found, strict=True)
        )
        heads = ("parameter", "nominal", "estimate", "standard error")
        return Card(f"Estimate of {self.title}", facts, heads, rows, leads=True)

    @property
    def title(self) -> str:
        """The study's name."""
        return str((self.study or {}).get("name", "Robot"))

    @property
    def robot(self) -> str:
        """The kind of robot."""
        return str((self.study or {}).get("robot", {}).get("kind", ""))

    def asked(self, option: str) -> Any:
        """An option of the study's key `calibration`, "auto" where it does not say."""
        return ((self.study or {}).get("calibration") or {}).get(option, "auto")

    @property
    def by_windows(self) -> bool:
        """Whether motion between the ends of windows was compared, rather than all poses of segments."""
        return self.method in ("gls", "two_stage")

    @property
    def models(self) -> list[ComparedModel]:
        """One entry per model that was compared, the study's own first; none where nothing was.

        Scores are by `aicc`, `bic` and `held_out` [m]: the value, difference to the best, interval of that
        (95 %) and whether it is as good as the best.
        """
        return [] if self.comparison is None else self.comparison.models

    def plain(self) -> dict[str, Any]:
        """As plain data, as much as the file holds."""
        return self.model_dump(by_alias=True, exclude_unset=True, warnings=False)
