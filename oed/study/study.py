"""The study file: a Problem and what to do with it, read from YAML with every mistake named by its line."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError

from oed.estimation import CalibrationOptions
from oed.foundation.errors import FileIssue, Issue, NotFinite, ProblemError, StudyError, UserMistake
from oed.foundation.own.part import OwnCodeError
from oed.foundation.presenting import Card, Presented, given
from oed.kernel.cards import problem_facts
from oed.kernel.criteria import TaskDrive
from oed.kernel.identifiability import require_identifiable
from oed.kernel.measurement.prior import Prior
from oed.kernel.problem import Problem
from oed.logs import CsvForm, LogForm
from oed.optimize import Solver
from oed.optimize.ipopt_options import with_shared_budget
from oed.robots.own_parts import code_issue, judge_issues
from oed.robots.presets import preset_names
from oed.simulation.trial import Trial
from oed.study.estimated import NO_ESTIMATES, Estimates, with_estimates
from oed.study.parts import PathFile as PathFile
from oed.study.parts import PriorRecord as PriorRecord
from oed.study.parts import ValidationOptions as ValidationOptions
from oed.study.robot_study import RobotStudyFile as RobotStudyFile
from oed.study.study_errors import explain
from oed.study.study_file import StudyFile as StudyFile
from oed.study.system_study import SystemStudyFile as SystemStudyFile
from oed.study.tasks import with_tasks
from oed.study.yaml_source import PlainSource, Source

AnyStudyFile = RobotStudyFile | SystemStudyFile
"""A study file of any domain."""


def of_robot(file: AnyStudyFile) -> RobotStudyFile:
    """The keys of a robot's study.

    Raises:
        UserMistake: the study is not of a robot.
    """
    if not isinstance(file, RobotStudyFile):
        raise UserMistake(f"{file.name}: this is for studies of robots, and the study is of a system")
    return file


@dataclass(frozen=True, repr=False)
class Study(Presented):
    """A study: the problem, and what to do with it.

    Attributes:
        problem: what to design for.
        file: the checked study file.
        origin: what it was read from.
    """

    problem: Problem
    file: AnyStudyFile
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
        """The searches asked for, each with its share of their budget."""
        return with_shared_budget(self.file.solvers)

    @property
    def folder(self) -> Path:
        """Where the study's own files are looked for."""
        return Path(self.source).parent

    def _card(self) -> Card:
        asked = {"a bound": self.file.bound, "validation": self.file.validation, "physics": self.physics}
        paths = [one if isinstance(one, str) else one.label for one in self.file.baselines]
        facts = given(
            ("file", self.source),
            *problem_facts(self.problem),
            ("solvers", ", ".join(one.label for one in self.solvers)),
            ("baselines", ", ".join(paths)),
            ("also", ", ".join(name for name, wanted in asked.items() if wanted)),
        )
        return Card(f"Study {self.name}", facts)

    @property
    def of_robot(self) -> RobotStudyFile:
        """The keys of a robot's study.

        Raises:
            UserMistake: the study is not of a robot.
        """
        return of_robot(self.file)

    @property
    def log(self) -> LogForm:
        """How the robot's logs are read."""
        return CsvForm() if self.of_robot.log is None else self.of_robot.log

    @property
    def calibration(self) -> CalibrationOptions:
        """How parameters are estimated from logs."""
        return self.of_robot.calibration or CalibrationOptions()

    @property
    def physics(self) -> Trial | None:
        """The simulated robot on which designs are tried, if any is asked for."""
        return self.file.physics if isinstance(self.file, RobotStudyFile) else None

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
            raise self.error(error.issues) from None

    def require_identifiable(self) -> None:
        """Refuse a study whose parameters no drive makes identifiable, or whose drives are not finite.

        Raises:
            StudyError: names what is not finite, or every combination that is not identifiable, with advice.
        """
        try:
            require_identifiable(self.problem)
        except ProblemError as error:
            raise self.error(error.issues) from None
        except NotFinite as error:
            raise self.error([error.issue]) from None

    def error(self, issues: Sequence[Issue]) -> StudyError:
        """Issues of the study with the file and the lines that they stand in."""
        return StudyError([_placed(self.origin, issue) for issue in issues])

    def changed(self, **keys: Any) -> Study:
        """The study with other values of some of its keys, checked anew.

        Args:
            keys: as a study file has them, or as parts: `measurement=[oed.Poses(...), MySensor()]`.

        Raises:
            StudyError: every mistake, by its key.
        """
        given = {name: getattr(self.file, name) for name in type(self.file).model_fields}
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


DrivesOf = Callable[[Path, AnyStudyFile], Sequence[TaskDrive]]
"""The drives that a trajectory CSV has, for a study's system."""


def no_files(file: Path, study: AnyStudyFile) -> Sequence[TaskDrive]:
    """The drives of no file: for studies that are to stand on their own.

    Raises:
        ProblemError: always; the key is for the caller to say.
    """
    raise ProblemError.about((), f"expected drives as numbers here, got the file {file.name}")


def kind_of(data: Mapping[str, Any]) -> type[AnyStudyFile]:
    """The keys that a study may have, by those that it has."""
    return SystemStudyFile if "system" in data and "robot" not in data else RobotStudyFile


def read_study(
    source: Source,
    prior_of: PriorOf = no_records,
    drives_of: DrivesOf = no_files,
    estimates: Estimates = NO_ESTIMATES,
) -> Study:
    """The study that `source` describes.

    Args:
        source: its keys.
        prior_of: what stands for a prior by the name of a record; raises a `ProblemError` where nothing does.
        drives_of: what stands for a task by the name of a file; alike.
        estimates: what stands for a discrepancy or a drift by the name of an estimate; alike.

    Raises:
        StudyError: every mistake in the source, each with its line and key.
    """
    if not isinstance(source.data, dict):
        got = "nothing; `oed init` makes a first one" if source.data is None else "something else"
        raise StudyError([source.issue((), f"expected a study (keys and values), got {got}")])
    if {"robot", "system"} <= source.data.keys():
        text = "a study is of a robot (robot, trajectory) or of a system (system, experiment), not of both"
        raise StudyError([source.issue(("system",), text, of_key=True)])
    kind = kind_of(source.data)
    try:
        file = kind.model_validate(_with_folder(kind.completed(source.data), Path(source.file).parent))
    except ProblemError as error:
        raise StudyError([source.issue(issue.key, issue.message) for issue in error.issues]) from None
    except ValidationError as error:
        raise StudyError(explain(error, kind, source)) from None
    issues = file.issues()
    try:
        folder = Path(source.file).parent
        file = _with_prior(file.in_numbers(folder), folder, prior_of)
        file = with_estimates(with_tasks(file, folder, drives_of), folder, estimates)
        problem = file.problem()
        issues += [*judge_issues(file, problem), *file.problem_issues(problem)]
    except ProblemError as error:
        issues = [*error.issues, *issues]
    except OwnCodeError as error:
        issues = [code_issue(file, error), *issues]
    if issues:
        found = [_placed(source, issue) for issue in issues]
        raise StudyError(sorted(found, key=lambda issue: (issue.line, issue.column)))
    return Study(problem, file, source)


def _placed(source: Source, issue: Issue) -> FileIssue:
    # What is wrong with a key that the study has not is said of its name.
    if issue.key and issue.key[0] not in source.data:
        return source.issue((), issue.message, missing=".".join(map(str, issue.key)))
    return source.issue(issue.key, issue.message)


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


def _with_prior(file: AnyStudyFile, folder: Path, prior_of: PriorOf) -> AnyStudyFile:
    # A prior taken from a record becomes its numbers, so that the study stands on its own from here on.
    if not isinstance(file.prior, PriorRecord):
        return file
    return file.model_copy(update={"prior": prior_of(file.prior, folder)})


@cache
def json_schema() -> dict[str, Any]:
    """The JSON schema of a study file, for editors: of a system where it has one, else of a robot."""
    robots, systems = (one.model_json_schema() for one in (RobotStudyFile, SystemStudyFile))
    from_preset = {
        "type": "object",
        "properties": {"preset": {"enum": list(preset_names())}},
        "required": ["preset"],
        "description": "A robot that can be bought; every further key overrides its own.",
    }
    robots["properties"]["robot"] = {"anyOf": [robots["properties"]["robot"], from_preset]}
    parts = {**systems.pop("$defs"), **robots.pop("$defs")}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "oed study",
        "if": {"required": ["system"], "not": {"required": ["robot"]}},
        "then": systems,
        "else": robots,
        "$defs": parts,
    }
