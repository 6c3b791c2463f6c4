"""What record.json holds."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, PrivateAttr

from oed.bounds.certificate import with_common
from oed.foundation import views
from oed.foundation.presenting import (
    PARAMETER_COLUMNS,
    Card,
    Presented,
    dataframe,
    given,
    number,
    parameter_rows,
)
from oed.foundation.text import Unit, count, listing, own_unit
from oed.kernel.dynamics.system import FORCES
from oed.records.stored.departures import StoredDepartures
from oed.records.stored.door import SavedFile, read_echo
from oed.records.stored.parts import (
    Count,
    Entries,
    Identifier,
    Matrix,
    Name,
    Number,
    Positive,
    Seconds,
    Seed,
    Stored,
    require_alike,
    require_different,
    require_known,
)
from oed.records.stored.result import Result
from oed.records.stored.simulation import StoredRobustness, StoredTrial, StoredValidation
from oed.study.study import AnyStudyFile, RobotStudyFile, of_robot


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

    @property
    def every_assumption(self) -> tuple[str, ...]:
        """What the bound rests on, of records by earlier versions, too."""
        return with_common(self.assumptions)


class Provenance(Stored):
    """What made the file; `study` is the name of the study's file, "" of one that was made in Python."""

    packages: dict[str, str]
    python: str
    platform: str
    finished: str
    study: str = ""


COLUMNS = (
    "name",
    "kind",
    "status",
    "feasible",
    "objective",
    "lambda_min",
    "condition_number",
    "path_length",
    "wall_seconds",
)
"""Of a result, in a table of all."""


def _results_text(results: Sequence[Result]) -> str:
    names = [one.name for one in results if one.origin != "baseline"]
    baselines = [one.name for one in results if one.origin == "baseline"]
    others = len([name for name in baselines if not name.endswith("_same_length")])
    return listing([*names, *([count(others, "baseline")] if others else [])])


def _bound_text(found: StoredCertificate) -> str:
    gap = "" if found.gap is None else f", {number(100 * found.gap, '%', 2)} above the best"
    return number(found.upper_bound) + gap


class Record(Presented, SavedFile):
    """A study's outcome, as record.json holds it; numbers are SI, None where there is none.

    Attributes:
        version: of the package that made it.
        echo: the study as plain data, SI, defaults filled in.
        study_text: the study as it was written.
        seed: of every random draw.
        inputs, states: the robot's; none in older records.
        nuisances: parameters that are unknown too.
        results: one of every solver and baseline.
        named: name of the best feasible result.
        certificate: what is proved of all drives.
        robustness: how many robots violate the limits on the drives; of a study that is robust.
        departures: how many robots leave the workspace or hit an obstacle; None of other systems, and in
            records of earlier versions.
        validation: whether simulated estimates scatter as predicted.
        trial: drives of a simulated robot with slip.
        interrupted: whether the run was cut short.
        notes: what else is to be known of the run.
        failures: steps after the searches that failed, a sentence about each.
        provenance: what made it.
    """

    format: Literal[1]
    version: str = Field(alias="oed_version")
    echo: dict[str, Any] = Field(alias="study")
    study_text: str
    seed: Seed
    inputs: Entries[StoredInput]
    states: Entries[StoredState]
    parameters: Annotated[list[StoredParameter], Field(min_length=1)]
    nuisances: Entries[StoredNuisance]
    results: list[Result]
    named: str | None = Field(default=None, alias="best")
    certificate: StoredCertificate | None
    robustness: StoredRobustness | None = None
    departures: StoredDepartures | None = None
    validation: StoredValidation | None
    trial: StoredTrial | None = Field(default=None, alias="physics")
    interrupted: bool = False
    notes: list[str]
    failures: list[str] = Field(default_factory=list)
    provenance: Provenance
    _study: AnyStudyFile | None = PrivateAttr(default=None)
    _folder: Path | None = PrivateAttr(default=None)

    @property
    def study(self) -> AnyStudyFile:
        """The study, its parts as objects that describe themselves; robots of code that was not run yet
        cannot move.
        """
        if self._study is None:
            self._study = read_echo(self.echo, self.file or Path("record.json"))
        return self._study

    @property
    def robot_study(self) -> RobotStudyFile:
        """The study, of a robot.

        Raises:
            UserMistake: it is of another system.
        """
        return of_robot(self.study)

    def require_robot(self) -> None:
        """Refuse a record of another system than a robot.

        Raises:
            UserMistake: it is one.
        """
        of_robot(self.study)

    @property
    def states_are_none(self) -> bool:
        """Whether it is of a system without states, whose experiments are settings and take no time."""
        return self.study.domain != "robots" and not self.states

    def shown_unit(self, name: str, unit: str) -> Unit:
        """The unit, and its factor from SI, in which a quantity is shown: that in which the study gives it.

        Args:
            name: of a parameter, state, input or output.
            unit: SI unit.
        """
        return self.study.shown_units.get(name) or own_unit(unit)

    @property
    def folder(self) -> Path | None:
        """Where it was saved, None where it was not."""
        return self._folder

    @property
    def pushed(self) -> bool:
        """Whether a force drives the robot, as a throttle does."""
        return any(one.quantity in FORCES for one in self.inputs)

    @property
    def best(self) -> Result | None:
        """The best feasible result, None where nothing is feasible.

        A record that does not name it was not made by this package: then the largest objective.
        """
        feasible = [one for one in self.results if one.feasible and one.objective is not None]
        named = [one for one in feasible if one.name == self.named]
        return max(named or feasible, key=lambda one: one.objective or 0.0, default=None)

    def result(self, name: str | None) -> Result | None:
        """The result of that name, the best for None; None where there is no such result."""
        if name is None:
            return self.best
        return next((one for one in self.results if one.name == name), None)

    def plot(self, what: str | None = None) -> Any:
        """A figure (matplotlib's) of the report.

        Args:
            what: the figure's name in the report, e.g. "paths", "wheel_speeds", "convergence"; the first by
                default.

        Raises:
            UserMistake: the report has no such figure; names those that it has.
        """
        return views.make("figure", self, what)

    def to_dataframe(self) -> Any:
        """A pandas DataFrame with a row per result: what was reached, and predicted standard errors by
        parameter, SI.

        Raises:
            UserMistake: pandas is not installed.
        """
        columns = {name: [getattr(one, name) for one in self.results] for name in COLUMNS}
        for one in self.parameters:
            columns[one.name] = [result.standard_deviations.get(one.name) for result in self.results]
        units = {one.name: one.unit for one in self.parameters}
        return dataframe(columns, {"path_length": "m", "wall_seconds": "s", **units})

    def _card(self) -> Card:
        best, bound = self.best, self.certificate
        nominal = {one.name: one.nominal for one in self.parameters}
        units = {one.name: one.unit for one in self.parameters}
        facts = given(
            ("best feasible", "none" if best is None else f"{best.name}, objective {number(best.objective)}"),
            ("results", _results_text(self.results)),
            ("upper bound", "" if bound is None else _bound_text(bound)),
            ("simulated", "" if self.validation is None else "yes"),
            ("interrupted", "yes" if self.interrupted else ""),
            ("file", str(self.file or "")),
        )
        errors = {} if best is None else best.standard_deviations
        return Card(
            f"Record of {self.echo.get('name', 'a study')}",
            facts,
            PARAMETER_COLUMNS,
            parameter_rows(tuple(errors), nominal, errors, units),
            leads=True,
        )

    def with_validation(self, found: StoredValidation) -> Self:
        """The record with other simulated experiments."""
        return self.model_copy(update={"validation": found})

    def of_study(self, study: AnyStudyFile) -> Self:
        """The record with the study that it was made of, or that its file holds; defaults filled in."""
        found = self.model_copy(update={"echo": study.echo()})
        found._study = study
        return found

    def saved_in(self, folder: Path | None) -> Self:
        """The record with where it was saved."""
        found = self.model_copy()
        found._folder = folder
        return found

    def __eq__(self, other: object) -> bool:
        """Whether both hold the same, of the same file."""
        return isinstance(other, Record) and (self.plain(), self.file) == (other.plain(), other.file)

    def __getstate__(self) -> dict[Any, Any]:
        """Without the objects that are made of the plain study again."""
        state = super().__getstate__()
        return {**state, "__pydantic_private__": {**state["__pydantic_private__"], "_study": None}}

    def _require(self) -> None:
        names, parameters = [one.name for one in self.results], [one.name for one in self.parameters]
        require_different("results", names)
        require_different("parameters", parameters)
        require_known("best", [self.named] if self.named is not None else [], names)
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
        states = len(self.states) or len(first.poses[0])
        require_alike(states, **{f"{what}.drive.poses.0": one.drive.poses[0]})

    def _require_simulated(self, names: list[str], parameters: list[str]) -> None:
        drives = {one.name: one.drive for one in self.results if one.drive is not None}
        if self.validation is not None:
            for place, one in enumerate(self.validation.results):
                require_known(f"validation.results.{place}.name", [one.name], names)
                require_known(f"validation.results.{place}.parameters", one.parameters, parameters)
        for key in ("robustness", "departures"):
            simulated = getattr(self, key)
            named = (one.name for one in simulated.results) if simulated else ()
            require_known(f"{key}.results", named, drives)
        bundles = [*self.robustness.bundles] if self.robustness is not None else []
        if self.departures is not None and self.departures.bundle is not None:
            bundles.append(self.departures.bundle)
        for bundle in bundles:
            for robot in bundle.paths:
                require_alike(drives[bundle.name].runs, **{f"paths of robots on {bundle.name}": robot})
