"""Robots of somebody's own in a study: code, which is read as the name it is until somebody trusts it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel

from oed.robots.models import PythonRobot
from oed.robots.models.python_robot import UNMADE
from oed.study.study import StudyFile


def unmade(data: Any) -> StudyFile:
    """A study of plain data; nobody's code is run, and robots of code cannot move.

    Raises:
        ValidationError, ProblemError: data of no study.
    """
    return StudyFile.model_validate(data, context=UNMADE)


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
