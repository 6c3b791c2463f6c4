"""Simulated drives of a differential drive, and the tables that a robot would have logged of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter

from oed.foundation.errors import FileIssue, LogError
from oed.logs import AnyLogForm, Log, LogForm, read_logs
from oed.robots.models import DifferentialDrive, Model

ROBOT = DifferentialDrive(wheel_radius=0.05, track=0.2)
INPUTS = ("wheel_speed_right", "wheel_speed_left")
HEADER = ("t", *INPUTS, "x", "y", "heading")
PERIOD = 0.05


FORMS = TypeAdapter(AnyLogForm)


def form(**keys: Any) -> LogForm:
    return FORMS.validate_python(keys)


def drive(rows: int = 200, period: float = PERIOD, seed: int = 0) -> np.ndarray:
    """Columns t, right, left speed (held to the next row), x, y, heading; midpoint steps suffice here."""
    times = period * np.arange(rows)
    right = 4 + 2 * np.sin(0.7 * times + seed)
    left = 3 - 2 * np.cos(0.5 * times + seed)
    turned = 0.05 * (right - left) / 0.2 * period
    heading = np.concatenate([[0.0], np.cumsum(turned)[:-1]])
    step = 0.05 * (right + left) / 2 * period
    middle = heading + turned / 2
    x = np.concatenate([[0.0], np.cumsum(step * np.cos(middle))[:-1]])
    y = np.concatenate([[0.0], np.cumsum(step * np.sin(middle))[:-1]])
    return np.column_stack([times, right, left, x, y, heading])


def cells(table: np.ndarray) -> list[list[str]]:
    return [[repr(float(value)) for value in row] for row in table]


def write(
    file: Path, rows: Sequence[Sequence[str]], header: Sequence[str] | None = HEADER, mark: str = ","
) -> Path:
    lines = ([header] if header else []) + list(rows)
    file.write_text("\n".join(mark.join(line) for line in lines) + "\n", encoding="utf-8")
    return file


def read_one(file: Path, model: Model = ROBOT, **keys: Any) -> Log:
    (log,) = read_logs([file], form(**keys), model)
    return log


def issues_of(*files: Path, model: Model = ROBOT, **keys: Any) -> list[FileIssue]:
    with pytest.raises(LogError) as caught:
        read_logs(files, form(**keys), model)
    return list(caught.value.issues)


def issue_of(file: Path, **keys: Any) -> FileIssue:
    (issue,) = issues_of(file, **keys)
    assert issue.file == str(file)
    return issue


def found(log: Log) -> Mapping[str, str]:
    """Messages of the findings by name."""
    names = [finding.name for finding in log.findings]
    assert len(set(names)) == len(names)
    return {finding.name: finding.message for finding in log.findings}


def doubtful(log: Log) -> set[str]:
    return {finding.name for finding in log.findings if finding.doubtful}
