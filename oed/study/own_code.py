"""Code of somebody's own in a study: read as the name it is until somebody trusts it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from oed.foundation.own.part import UNMADE, OwnPart
from oed.robots.own_parts import components
from oed.study.study import StudyFile


def unmade(data: Any) -> StudyFile:
    """A study of plain data; nobody's code is run, and parts that are code can do nothing.

    Raises:
        ValidationError, ProblemError: data of no study.
    """
    return StudyFile.model_validate(data, context=UNMADE)


def named_code(file: StudyFile) -> Iterator[tuple[str, OwnPart]]:
    """Every part of somebody's own that a study read as data names, with its key."""
    for key, part in components(file, ("study",)):
        if isinstance(part, OwnPart):
            yield ".".join(map(str, key)), part
