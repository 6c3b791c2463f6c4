"""Code that files name: found before it is run."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from oed.errors import FileFlaw, RecordError
from oed.models import PythonRobot


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
            f"{robot.object} is code, of {robot.module_file}, and would be run; read it, and if you trust it "
            "give --trust (in Python trust=True): it holds for this one call",
        )
        for key, robot in robots_of_code(part)
    ]
    if flaws:
        raise RecordError(flaws)
