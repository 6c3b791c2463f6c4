"""What record.json holds."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from oed.records.stored.certificate import StoredCertificate
from oed.records.stored.parts import (
    Identifier,
    Number,
    Positive,
    Seed,
    Stored,
    require_alike,
    require_different,
    require_known,
)
from oed.records.stored.result import Result
from oed.records.stored.simulation import StoredRobustness, StoredValidation
from oed.records.stored.trial import StoredTrial


class StoredInput(Stored):
    """An input of the robot."""

    name: Identifier
    quantity: Identifier
    unit: str


class StoredState(Stored):
    """A state of the robot."""

    name: Identifier
    unit: str


class StoredParameter(Stored):
    """An estimated parameter: nominal value, SI unit, the block of readings that it follows from and their
    noise, and whether the criterion judges it.
    """

    name: Identifier
    nominal: Number
    unit: str
    block: str
    noise: Positive | None
    judged: bool = True


class StoredNuisance(Stored):
    """A nuisance parameter: SI unit, the block of readings that it is of, its prior standard deviation."""

    name: str
    unit: str
    block: str
    deviation: Positive | None


class Provenance(Stored):
    """What made the file."""

    packages: dict[str, str]
    python: str
    platform: str
    finished: str


class StudyRecord(Stored):
    """A study's outcome; the study itself is checked by its own reader."""

    format: Literal[1]
    oed_version: str
    study: dict[str, Any]
    study_text: str
    seed: Seed
    inputs: list[StoredInput] | None = None
    states: list[StoredState] | None = None
    parameters: Annotated[list[StoredParameter], Field(min_length=1)]
    nuisances: list[StoredNuisance] = Field(default_factory=list)
    results: list[Result]
    best: str | None = None
    certificate: StoredCertificate | None
    robustness: StoredRobustness | None = None
    validation: StoredValidation | None
    physics: StoredTrial | None = None
    interrupted: bool = False
    notes: list[str]
    provenance: Provenance

    def _require(self) -> None:
        names, parameters = [one.name for one in self.results], [one.name for one in self.parameters]
        require_different("results", names)
        require_different("parameters", parameters)
        require_known("best", [self.best] if self.best is not None else [], names)
        for place, one in enumerate(self.results):
            what = f"results.{place}"
            require_known(f"{what}.standard_deviations", one.standard_deviations, parameters)
            for covariance in one.covariances:
                require_known(f"{what}.covariances", covariance.parameters, parameters)
            self._require_inputs(what, one)
        self._require_simulated(names, parameters)

    def _require_inputs(self, what: str, one: Result) -> None:
        driven = [other for other in self.results if other.drive is not None]
        if one.drive is None:
            return
        first = driven[0].drive
        assert first is not None
        width = len(first.coefficients[0]) if not self.inputs else len(self.inputs)
        require_alike(width, **{f"{what}.drive.coefficients.0": one.drive.coefficients[0]})
        states = len(self.states) if self.states else len(first.poses[0])
        require_alike(states, **{f"{what}.drive.poses.0": one.drive.poses[0]})

    def _require_simulated(self, names: list[str], parameters: list[str]) -> None:
        driven = [one.name for one in self.results if one.drive is not None]
        if self.validation is not None:
            for place, one in enumerate(self.validation.results):
                require_known(f"validation.results.{place}.name", [one.name], names)
                require_known(f"validation.results.{place}.parameters", one.parameters, parameters)
        if self.robustness is not None:
            require_known("robustness.results", (one.name for one in self.robustness.results), driven)
