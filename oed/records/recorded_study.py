"""The study that a record holds: data, of which no code is run unless it is trusted."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from oed.foundation.errors import FileFlaw, ProblemError, RecordError, StudyError
from oed.foundation.shown import shown
from oed.logs import CsvForm
from oed.records.record import Record
from oed.robots.models import PythonRobot
from oed.robots.models.python_robot import UNMADE
from oed.study.study import PriorRecord, Study, StudyFile, parse_study
from oed.study.study_errors import explain
from oed.study.yaml_source import parse_yaml

TRUST = "if you trust it give --trust (in Python trust=True): it holds for this one call"
"""What to do with a record that asks for more than to be read."""


def recorded_study(record: Record, *, trust: bool = False) -> Study:
    """The study that a record was made of.

    Args:
        record: the record.
        trust: whether Python code that a record names which was read from a file may be run, and other files
            that it names be read.

    Raises:
        RecordError: a study that this version does not understand, or code that is not trusted, or a prior
            of another file.
    """
    place = record.file or Path("record")
    if record.file is not None and not trust:
        file = recorded_file(record)
        refuse_code(file, place)
        _refuse_prior(file, place)
    try:
        return parse_study(json.dumps(record.data["study"], ensure_ascii=False), str(place))
    except StudyError as error:
        raise _in_record(error, None, place) from None


def recorded_file(record: Record) -> StudyFile:
    """The study of a record as it was written; nobody's code is run, and robots of code cannot move.

    Raises:
        RecordError: as `checked_echo` does.
    """
    return _read(record.data["study"], record.file or Path("record"))


def checked_echo(data: Any, file: Path) -> dict[str, Any]:
    """A saved study as plain data, defaults filled in, by the reader of studies; no robot is made of it.

    Raises:
        RecordError: names the file and the study's key of every mistake.
    """
    plain: dict[str, Any] = _read(data, file).model_dump(mode="json", exclude_none=True)
    return plain


def _read(data: Any, file: Path) -> StudyFile:
    try:
        return StudyFile.model_validate(data, context=UNMADE)
    except (ValidationError, ProblemError) as error:
        raise _in_record(error, data, file) from None


def _in_record(error: ValidationError | ProblemError | StudyError, data: Any, file: Path) -> RecordError:
    # Lines mean nothing in a record: a study's keys are told as the record's.
    if isinstance(error, ValidationError):
        flaws = [
            (one.key, one.message)
            for one in explain(error, StudyFile, parse_yaml(json.dumps(data), str(file)))
        ]
    elif isinstance(error, StudyError):
        flaws = [(one.key, one.message) for one in error.flaws]
    else:
        flaws = [(".".join(map(str, one.key)), one.message) for one in error.flaws]
    return RecordError(
        [FileFlaw(str(file), 0, 0, f"study.{key}" if key else "study", text) for key, text in flaws]
    )


def robots_of_code(part: Any, key: str = "study") -> Iterator[tuple[str, PythonRobot]]:
    """Every robot of somebody's own in a part of a study, with its key."""
    if isinstance(part, PythonRobot):
        yield key, part
    elif isinstance(part, BaseModel):
        for name in type(part).model_fields:
            yield from robots_of_code(getattr(part, name), f"{key}.{name}")
    elif isinstance(part, tuple | list):
        for place, one in enumerate(part):
            yield from robots_of_code(one, f"{key}.{place}")


def refuse_code(part: BaseModel, file: Path) -> None:
    """Refuse a study read from a file that would run somebody's code.

    Raises:
        RecordError: names the code and what to do.
    """
    flaws = [
        FileFlaw(
            str(file),
            0,
            0,
            key,
            f"{robot.object} is code, of {robot.module_file}, and would be run; read it, and {TRUST}",
        )
        for key, robot in robots_of_code(part)
    ]
    if flaws:
        raise RecordError(flaws)


def _refuse_prior(study: StudyFile, file: Path) -> None:
    # Records hold priors as numbers: one that names another record has been written by somebody else.
    if isinstance(study.prior, PriorRecord):
        text = f"would be read from {shown(study.prior.record)}, another file than this one; {TRUST}"
        raise RecordError([FileFlaw(str(file), 0, 0, "study.prior.record", text)])


def refuse_outside(record: Record, logs: Iterable[str | Path]) -> None:
    """Refuse a record from a file whose study would have poses read from elsewhere than beside the logs.

    Raises:
        RecordError: names the file that it leads to and what to do.
    """
    form = recorded_file(record).log
    if record.file is None or not isinstance(form, CsvForm):
        return
    for log in map(Path, logs):
        found = form.poses.beside(log)
        if found is not None and not found.resolve().is_relative_to(log.parent.resolve()):
            text = f"leads to {found}, out of the folder of the log; {TRUST}"
            raise RecordError([FileFlaw(str(record.file), 0, 0, "study.log.poses.file", text)])
