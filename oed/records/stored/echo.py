"""The study within a record, by the reader of studies; its keys are told as the record's."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from oed.foundation.errors import FileFlaw, ProblemError, RecordError
from oed.study.own_code import unmade
from oed.study.study import StudyFile
from oed.study.study_errors import explain
from oed.study.yaml_source import PlainSource


def read_echo(data: Any, file: Path) -> StudyFile:
    """A saved study; no robot of somebody's code is made of it.

    Raises:
        RecordError: names the file and the study's key of every mistake.
    """
    source = PlainSource(str(file), "", data)
    try:
        return unmade(data)
    except ValidationError as error:
        raise in_record(explain(error, StudyFile, source)) from None
    except ProblemError as error:
        raise in_record([source.flaw(flaw.key, flaw.message) for flaw in error.flaws]) from None


def in_record(flaws: Sequence[FileFlaw]) -> RecordError:
    """Flaws of a study as those of the record that holds it."""
    return RecordError(
        [FileFlaw(flaw.file, 0, 0, f"study.{flaw.key}".rstrip("."), flaw.message) for flaw in flaws]
    )
