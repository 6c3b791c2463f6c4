"""Everything a study produced, as plain data: saved as JSON, and a report's only input."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

from oed.foundation.errors import UserMistake
from oed.foundation.files import write_text
from oed.foundation.work.folders import in_order, interrupted_runs
from oed.records.stored.certificate import StoredCertificate
from oed.records.stored.consistency import require_one_study
from oed.records.stored.door import checked, json_text, read_file
from oed.records.stored.echo import checked_echo, read_echo
from oed.records.stored.parts import Stored
from oed.records.stored.result import Result
from oed.records.stored.simulation import StoredRobustness, StoredValidation
from oed.records.stored.study_record import (
    Provenance,
    StoredInput,
    StoredNuisance,
    StoredParameter,
    StoredState,
    StudyRecord,
)
from oed.records.stored.trial import StoredTrial
from oed.study.study import StudyFile

Part = TypeVar("Part", bound=Stored)

FILE = "record.json"
REPORT, ESTIMATE = "report", "estimate"
"""Names, without suffix, of the pages on a design and on an estimate; the latter's figures begin with it."""
RESULTS = (FILE, "estimate.json", "sweep.json")
"""Names of the files that hold what a run, an estimate and a sweep found."""


@dataclass(frozen=True)
class Record:
    """A study's outcome. `data` is what record.json holds; numbers are SI, null where there is none.

    `file` is where it was read from, None of a record that was made here: what a file names is data, and
    code that it names is run only for those who trust it. `folder` is where it was saved, None where it was
    not. `asked` is the study that it was made of, None of a record that was read.
    """

    data: Mapping[str, Any]
    file: Path | None = None
    folder: Path | None = field(default=None, compare=False)
    asked: StudyFile | None = field(default=None, compare=False, repr=False)

    @cached_property
    def study(self) -> StudyFile:
        """The study, its parts as objects that describe themselves; robots of code that was not run yet
        cannot move.
        """
        return self.asked or read_echo(self.echo, self.file or Path(FILE))

    def __getstate__(self) -> dict[str, Any]:
        """Without the objects that are made of the data again."""
        return {name: getattr(self, name) for name in ("data", "file", "folder")}

    @cached_property
    def results(self) -> tuple[Result, ...]:
        """One of every solver and baseline."""
        return tuple(self._part(Result, one) for one in self.data["results"])

    @property
    def best(self) -> Result | None:
        """The best feasible result, None where nothing is feasible.

        A record that does not name it was not made by this package: then the largest objective.
        """
        feasible = [one for one in self.results if one.feasible and one.objective is not None]
        named = [one for one in feasible if one.name == self.data.get("best")]
        return max(named or feasible, key=lambda one: one.objective or 0.0, default=None)

    def result(self, name: str | None) -> Result | None:
        """The result of that name, the best for None; None where there is no such result."""
        if name is None:
            return self.best
        return next((one for one in self.results if one.name == name), None)

    @cached_property
    def certificate(self) -> StoredCertificate | None:
        """What is proved of all drives, None where nothing is."""
        return self._part_or_none(StoredCertificate, "certificate")

    @cached_property
    def robustness(self) -> StoredRobustness | None:
        """How many robots leave the limits on the drives, None for a study that is not robust."""
        return self._part_or_none(StoredRobustness, "robustness")

    @cached_property
    def validation(self) -> StoredValidation | None:
        """Whether simulated estimates scatter as predicted, None where none were simulated."""
        return self._part_or_none(StoredValidation, "validation")

    @cached_property
    def parameters(self) -> tuple[StoredParameter, ...]:
        """The estimated parameters."""
        return tuple(self._part(StoredParameter, one) for one in self.data["parameters"])

    @cached_property
    def inputs(self) -> tuple[StoredInput, ...]:
        """The robot's inputs; none in older records."""
        return tuple(self._part(StoredInput, one) for one in self.data.get("inputs") or ())

    @cached_property
    def states(self) -> tuple[StoredState, ...]:
        """The robot's states; none in older records."""
        return tuple(self._part(StoredState, one) for one in self.data.get("states") or ())

    @cached_property
    def nuisances(self) -> tuple[StoredNuisance, ...]:
        """The nuisance parameters, which are unknown too."""
        return tuple(self._part(StoredNuisance, one) for one in self.data.get("nuisances") or ())

    @cached_property
    def trial(self) -> StoredTrial | None:
        """Drives of a simulated robot with slip, None where none were."""
        return self._part_or_none(StoredTrial, "physics")

    @cached_property
    def provenance(self) -> Provenance:
        """What made it."""
        return self._part(Provenance, self.data["provenance"])

    @property
    def version(self) -> str:
        """Of the package that made it."""
        return str(self.data["oed_version"])

    @property
    def echo(self) -> Mapping[str, Any]:
        """The study as plain data, SI, defaults filled in."""
        found: Mapping[str, Any] = self.data["study"]
        return found

    @property
    def study_text(self) -> str:
        """The study as it was written."""
        return str(self.data.get("study_text", ""))

    def with_validation(self, found: StoredValidation) -> Record:
        """The record with other simulated experiments."""
        return replace(self, data={**self.data, "validation": found.plain()})

    @property
    def interrupted(self) -> bool:
        """Whether the run was cut short."""
        return bool(self.data.get("interrupted", False))

    @property
    def notes(self) -> tuple[str, ...]:
        """What else is to be known of the run."""
        return tuple(self.data["notes"])

    @property
    def seed(self) -> int:
        """Seed of every random draw."""
        return int(self.data["seed"])

    def _part_or_none(self, kind: type[Part], key: str) -> Part | None:
        found = self.data.get(key)
        return None if found is None else self._part(kind, found)

    def _part(self, kind: type[Part], found: Mapping[str, Any]) -> Part:
        # Files have been checked as a whole when they were read.
        return checked(kind, found, self.file or Path(FILE))

    def to_json(self) -> str:
        """The text of record.json, every list of numbers on a line of its own."""
        return json_text(self.data)


def save_record(record: Record, folder: str | Path) -> Path:
    """Write record.json into `folder`; returns the file."""
    path = Path(folder) / FILE
    write_text(path, record.to_json())
    return path


def require_no_results(path: str | Path) -> None:
    """Refuse to have a file of another kind take the place of results.

    Raises:
        UserMistake: it would.
    """
    if Path(path).name.lower() in RESULTS and os.path.lexists(path):
        raise UserMistake(f"{path}: cannot be written: it holds results, which would be lost; name another")


def load_record(folder: str | Path) -> Record:
    """Read the record in `folder` (or the record file itself); no code that it names is run.

    Raises:
        RecordError: no record there, or one with keys that are missing or something else than they are to be.
    """
    path = saved_file(folder, FILE)
    hint = "" if path.exists() else beside(folder)
    data = read_file(path, "a record", "oed run", "results", hint)
    return Record(known_record(data, path), path)


def known_record(data: Mapping[str, Any], path: Path) -> dict[str, Any]:
    """What record.json holds as this version knows it, defaults filled in.

    Raises:
        RecordError: as `load_record` does.
    """
    found = checked(StudyRecord, data, path)
    found = found.model_copy(update={"study": checked_echo(found.study, path)})
    require_one_study(found, path)
    return found.plain()


def saved_file(folder: str | Path, name: str) -> Path:
    """The file of that name in a folder, or the file itself where it is given.

    A folder that a process was about to swap when it was killed is put in order first.
    """
    path = in_order(folder)
    return path / name if path.is_dir() else path


def beside(folder: str | Path) -> str:
    """That runs that were cut short are kept beside a folder, in words; "" where there are none."""
    kept = ", ".join(map(str, interrupted_runs(folder)))
    return f"; a run that was cut short is kept in {kept}" if kept else ""


def pages(folder: Path, name: str = REPORT) -> set[str]:
    """Names, relative to a folder, of the files of a report (or an estimate's page) that is there."""
    figures = {
        path.relative_to(folder).as_posix()
        for path in folder.glob("figures/*.svg")
        if path.name.startswith(f"{ESTIMATE}_") == (name == ESTIMATE)
    }
    return figures | {file for file in (f"{name}.html", f"{name}.md") if (folder / file).exists()}
