"""The study file: a Problem and what to do with it, read from YAML with every mistake named by its line."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal, Optional

import yaml
from pydantic import (
    BeforeValidator,
    Field,
    ValidationError,
    ValidationInfo,
    create_model,
    field_validator,
)
from pydantic_core import PydanticCustomError

from oed.estimation import CalibrationOptions, alternative_flaws
from oed.foundation.component import Component, OneOf
from oed.foundation.errors import FileFlaw, Flaw, NotFinite, ProblemError, StudyError
from oed.foundation.own.part import OwnCodeError, OwnPart
from oed.foundation.presenting import Card, Presented, given
from oed.kernel.criteria import CRITERION_CHOICES, Criterion, E
from oed.kernel.identifiability import require_identifiable
from oed.kernel.measurement.prior import Prior
from oed.kernel.problem import Problem
from oed.logs import AnyLogForm, CsvForm, LogForm
from oed.optimize import SOLVERS, Ipopt, Solver
from oed.robots.baselines import try_baselines
from oed.robots.limits import LIMITS, Limit, PythonLimit
from oed.robots.models import MODELS, Model
from oed.robots.own_parts import code_flaw, components, judge_flaws, measurement_flaws
from oed.robots.presets import preset_names, with_preset
from oed.robots.sensors import MEASUREMENTS, Measurement
from oed.robots.space import DesignSpace
from oed.simulation.trial import Trial, trial_flaws
from oed.study.cross_checks import file_flaws
from oed.study.parts import AnyBaseline, AnyPrior
from oed.study.parts import PathFile as PathFile
from oed.study.parts import PriorRecord as PriorRecord
from oed.study.parts import ValidationOptions as ValidationOptions
from oed.study.study_errors import explain
from oed.study.yaml_source import PlainSource, Source
from oed.uncertainty.robust import Robust
from oed.uncertainty.uncertainty import Uncertainty


def _limit_table() -> Any:
    fields: dict[str, Any] = {
        name: (Optional[kind], None)  # noqa: UP045
        for name, kind in LIMITS.items()
    }
    fields["own"] = (Optional[tuple[Annotated[Limit, OneOf((PythonLimit,))], ...]], None)  # noqa: UP045
    return create_model("Limits", __base__=Component, __doc__="Limits by name; all optional.", **fields)


_Limits = _limit_table()


def _sensor_list(value: Any) -> Any:
    # Several sensors are given as a list of them.
    return {"kind": "several", "sensors": value} if isinstance(value, list) else value


USUAL = DesignSpace(duration=20.0)
"""The drives of a study that designs none: as long and as often read as any."""


class StudyFile(Component):
    """The keys of a study file.

    Attributes:
        trajectory: the drives to choose from; without it nothing is designed, and parameters are estimated
            from logs alone.
        limits: of a drive that is designed.
    """

    format: Literal[1]
    name: Annotated[str, Field(min_length=1)]
    robot: Annotated[Model, OneOf(MODELS)]
    trajectory: DesignSpace | None = None
    measurement: Annotated[Measurement, OneOf(MEASUREMENTS), BeforeValidator(_sensor_list)]
    estimate: tuple[str, ...] | None = None
    prior: AnyPrior | None = None
    uncertainty: Uncertainty | None = None
    robust: Robust | None = None
    limits: Annotated[_Limits | None, Field(validate_default=True)] = None  # type: ignore[valid-type]
    criterion: Annotated[Criterion, OneOf(CRITERION_CHOICES)] = E()
    solvers: tuple[Annotated[Solver, OneOf(SOLVERS)], ...] = (Ipopt(),)
    baselines: tuple[AnyBaseline, ...] = ()
    same_length: bool = False
    bound: bool = False
    validation: ValidationOptions | None = None
    log: AnyLogForm | None = None
    calibration: CalibrationOptions | None = None
    physics: Trial | None = None
    seed: Annotated[int, Field(ge=0)] = 0

    @field_validator("limits")
    @classmethod
    def _limits_of_a_drive(cls, limits: Any, info: ValidationInfo) -> Any:
        if limits is None and info.data.get("trajectory") is not None:
            raise PydanticCustomError("missing", "Field required")
        return limits

    def __repr__(self) -> str:
        """Its name, its robot and the keys that were given."""
        return (
            f"StudyFile({self.name!r}, {self.robot.kind}; keys: {', '.join(sorted(self.model_fields_set))})"
        )

    __str__ = __repr__

    @property
    def space(self) -> DesignSpace:
        """The drives to choose from, or any where none is designed."""
        return USUAL if self.trajectory is None else self.trajectory

    def echo(self) -> dict[str, Any]:
        """The study as plain data, defaults filled in, SI numbers; itself a valid study."""
        plain: dict[str, Any] = self.model_dump(mode="json", exclude_none=True)
        return plain

    def named_code(self) -> Iterator[tuple[str, OwnPart]]:
        """Every part of somebody's own that a study read as data names, with its key."""
        for key, part in components(self, ("study",)):
            if isinstance(part, OwnPart):
                yield ".".join(map(str, key)), part


@dataclass(frozen=True, repr=False)
class Study(Presented):
    """A study: the problem, and what to do with it.

    Attributes:
        problem: what to design for.
        file: the checked study file.
        origin: what it was read from.
    """

    problem: Problem
    file: StudyFile
    origin: Source

    @property
    def text(self) -> str:
        """The YAML it was read from."""
        return self.origin.text

    @property
    def source(self) -> str:
        """Name of the file it was read from."""
        return self.origin.file

    @property
    def name(self) -> str:
        """The study's name."""
        return self.file.name

    @property
    def solvers(self) -> tuple[Solver, ...]:
        """The searches asked for."""
        return self.file.solvers

    @property
    def folder(self) -> Path:
        """Where the study's own files are looked for."""
        return Path(self.source).parent

    def _card(self) -> Card:
        asked = {"a bound": self.file.bound, "validation": self.file.validation, "physics": self.file.physics}
        paths = [one if isinstance(one, str) else one.label for one in self.file.baselines]
        facts = given(
            ("file", self.source),
            *self.problem.facts,
            ("solvers", ", ".join(one.label for one in self.solvers)),
            ("baselines", ", ".join(paths)),
            ("also", ", ".join(name for name, wanted in asked.items() if wanted)),
        )
        return Card(f"Study {self.name}", facts)

    @property
    def log(self) -> LogForm:
        """How the robot's logs are read."""
        return CsvForm() if self.file.log is None else self.file.log

    @property
    def calibration(self) -> CalibrationOptions:
        """How parameters are estimated from logs."""
        return self.file.calibration or CalibrationOptions()

    @property
    def seed(self) -> int:
        """Seed of every random draw."""
        return self.file.seed

    def require_designed(self) -> None:
        """Refuse a study that designs no drive.

        Raises:
            StudyError: names what is missing for one.
        """
        try:
            self.problem.require_designed()
        except ProblemError as error:
            raise self.error(error.flaws) from None

    def require_identifiable(self) -> None:
        """Refuse a study whose parameters no drive makes identifiable, or whose drives are not finite.

        Raises:
            StudyError: names what is not finite, or every combination that is not identifiable, with advice.
        """
        try:
            require_identifiable(self.problem)
        except ProblemError as error:
            raise self.error(error.flaws) from None
        except NotFinite as error:
            raise self.error([error.flaw]) from None

    def error(self, flaws: Sequence[Flaw]) -> StudyError:
        """Flaws of the study with the file and the lines that they stand in."""
        return StudyError([_placed(self.origin, flaw) for flaw in flaws])

    def changed(self, **keys: Any) -> Study:
        """The study with other values of some of its keys, checked anew.

        Args:
            keys: as a study file has them, or as parts: `measurement=[oed.Poses(...), MySensor()]`.

        Raises:
            StudyError: every mistake, by its key.
        """
        given = {name: getattr(self.file, name) for name in StudyFile.model_fields}
        study = read_study(PlainSource(self.source, "", {**given, **keys}))
        data = study.echo()
        return replace(study, origin=PlainSource(self.source, yaml.safe_dump(data, sort_keys=False), data))

    def echo(self) -> dict[str, Any]:
        """The study as plain data, defaults filled in, SI numbers; itself a valid study."""
        return self.file.echo()


PriorOf = Callable[[PriorRecord, Path], Prior]
"""The prior that an earlier study's record predicts; its folder is found from the one given."""


def no_records(wanted: PriorRecord, folder: Path) -> Prior:
    """The prior of no record: for studies that are to stand on their own.

    Raises:
        ProblemError: always.
    """
    text = f"expected a prior as numbers here, got one of the record {wanted.record}"
    raise ProblemError.about(("prior", "record"), text)


def read_study(source: Source, prior_of: PriorOf = no_records) -> Study:
    """The study that `source` describes.

    Args:
        source: its keys.
        prior_of: what stands for a prior by the name of a record; raises a `ProblemError` where nothing does.

    Raises:
        StudyError: every mistake in the source, each with its line and key.
    """
    if not isinstance(source.data, dict):
        got = "nothing; `oed init` makes a first one" if source.data is None else "something else"
        raise StudyError([source.flaw((), f"expected a study (keys and values), got {got}")])
    try:
        file = StudyFile.model_validate(_with_folder(with_preset(source.data), Path(source.file).parent))
    except ProblemError as error:
        raise StudyError([source.flaw(flaw.key, flaw.message) for flaw in error.flaws]) from None
    except ValidationError as error:
        raise StudyError(explain(error, StudyFile, source)) from None
    flaws = file_flaws(file)
    if file.uncertainty is not None and file.robust is None:
        text = "is what a robust drive has to survive, and none is asked for: add `robust: {kind: chance}`"
        flaws.append(Flaw(("uncertainty",), text))
    if file.calibration is not None:
        flaws += alternative_flaws(file.robot, file.calibration.models)
    try:
        file = _with_prior(file, Path(source.file).parent, prior_of)
        problem = _problem(file)
        flaws += judge_flaws(file, problem)
        if problem.designed:
            try_baselines(problem, file.baselines)
            flaws += trial_flaws(problem, file.physics)
    except ProblemError as error:
        flaws = [*error.flaws, *flaws]
    except OwnCodeError as error:
        flaws = [code_flaw(file, error), *flaws]
    if flaws:
        found = [_placed(source, flaw) for flaw in flaws]
        raise StudyError(sorted(found, key=lambda flaw: (flaw.line, flaw.column)))
    return Study(problem, file, source)


def _placed(source: Source, flaw: Flaw) -> FileFlaw:
    # What is wrong with a key that the study has not is said of its name.
    if flaw.key and flaw.key[0] not in source.data:
        return source.flaw((), flaw.message, missing=".".join(map(str, flaw.key)))
    return source.flaw(flaw.key, flaw.message)


def _with_folder(data: Any, folder: Path) -> Any:
    # Code of the user's own stands beside the study, or in a folder named relative to it.
    if isinstance(data, list):
        return [_with_folder(one, folder) for one in data]
    if not isinstance(data, dict):
        return data
    placed = {key: _with_folder(one, folder) for key, one in data.items()}
    if data.get("kind") == "python":
        placed["folder"] = str((folder / str(data.get("folder") or "")).resolve())
    return placed


def _with_prior(file: StudyFile, folder: Path, prior_of: PriorOf) -> StudyFile:
    # A prior taken from a record becomes its numbers, so that the study stands on its own from here on.
    if not isinstance(file.prior, PriorRecord):
        return file
    return file.model_copy(update={"prior": prior_of(file.prior, folder)})


def _problem(file: StudyFile) -> Problem:
    assert not isinstance(file.prior, PriorRecord)
    flaws = measurement_flaws(file)
    if flaws:
        raise ProblemError(flaws)
    return Problem(
        model=file.robot,
        design=file.space,
        measurement=file.measurement,
        limits=_limits(file),
        criterion=file.criterion,
        name=file.name,
        estimate=file.estimate,
        prior=file.prior,
        uncertainty=file.uncertainty,
        robust=file.robust,
        designed=file.trajectory is not None,
    )


def _limits(file: StudyFile) -> tuple[Limit, ...]:
    given = [getattr(file.limits, name, None) for name in LIMITS]
    return (*(limit for limit in given if limit is not None), *(getattr(file.limits, "own", None) or ()))


@cache
def json_schema() -> dict[str, Any]:
    """The JSON schema of a study file, for editors."""
    schema = StudyFile.model_json_schema()
    from_preset = {
        "type": "object",
        "properties": {"preset": {"enum": list(preset_names())}},
        "required": ["preset"],
        "description": "A robot that can be bought; every further key overrides its own.",
    }
    schema["properties"]["robot"] = {"anyOf": [schema["properties"]["robot"], from_preset]}
    schema["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    schema["title"] = "oed study"
    return schema
