"""What every form of log has in common, the study's key `log`; and reading: every file, every issue of each
at once, and what only shows across all of them.
"""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from oed.foundation.arguments import typed
from oed.foundation.component import Component
from oed.foundation.errors import FileIssue, Issue, LogError, ProblemError
from oed.foundation.quantities import Duration
from oed.foundation.text import listing
from oed.kernel.dynamics.system import System
from oed.kernel.measurement.measurement import Measurement, measurement_of, sensors_of
from oed.kernel.measurement.sensor import Sensor
from oed.logs.log import Log
from oed.logs.series import together

Repeats = Literal["keep", "drop"]
"""What is done with poses that repeat the one before while the wheels turn, as a slower sensor's do."""
POSES, PLANE = "poses", ("x", "y", "heading")
"""Kind of sensor that reads a robot's pose, and what that may be."""
BAG_ENDINGS = (".mcap", ".db3", ".bag")
"""By which a file is known to be a ROS bag."""


class LogForm(Component, ABC):
    """How a robot's logs are read.

    Attributes:
        gap: longer steps in time are gaps [s], at which segments end. By default five median steps, but where
            only poses are missing for up to `oed.logs.log.BRIDGED` the wheels carry segments on.
        skip_stationary: whether to cut off standing before and after the drive, but for a second.
        skip_invalid_rows: whether inputs and poses of rows (in a bag: messages) that have no finite number
            there are left out, and counted, instead of refused.
        thin: of the poses one in so many is used, of those that are not left out for another reason.
    """

    kind: str
    gap: Annotated[Duration, Field(gt=0)] | None = None
    skip_stationary: bool = False
    skip_invalid_rows: bool = False
    thin: Annotated[int, Field(ge=1)] = 1

    @property
    def clock_hint(self) -> str:
        """Which keys may mend times that do not rise; "" where none does."""
        return ""

    @property
    def named_states(self) -> frozenset[str]:
        """States of the robot whose place in the log the study names."""
        return frozenset()

    @abstractmethod
    def read(self, file: Path, model: System) -> list[Log]:
        """The drives in a file.

        Raises:
            LogError: every mistake in the file, each with its line.
        """

    @abstractmethod
    def issues(self, model: System) -> list[Issue]:
        """What in this form does not fit the robot."""

    def require_installed(self) -> None:
        """Make sure that what reads such logs is installed.

        Raises:
            UserMistake: an extra is missing; says how to install it.
        """
        return

    def sensor_issues(self, measurement: Measurement | None) -> list[Issue]:
        """What in this form does not fit the sensors of a study."""
        return []

    def sensed(self, file: Path, logs: list[Log], measurement: Measurement | None) -> list[Log]:
        """The drives in a file with what sensors beside the poses read.

        Args:
            file: that was read.
            logs: the drives in it.
            measurement: the study's.

        Raises:
            LogError: every mistake in their readings, each with its line.
        """
        return logs


def read_twice(each: Mapping[tuple[str, ...], tuple[str | int, ...]]) -> list[Issue]:
    """Places of a log that are read as two quantities: two wheels by one of them would turn alike.

    Args:
        each: the place, such as ("column", 3), by the path of the study's key that names it.
    """
    known, issues = dict[tuple[str | int, ...], str](), list[Issue]()
    for key, place in each.items():
        if place in known:
            text = f"{' '.join(map(str, place))} is read as {known[place]} already; name another"
            issues.append(Issue(key, text))
        known.setdefault(place, ".".join(key[1:]))
    return issues


def is_bag(file: Path) -> bool:
    """Whether a path is a ROS bag's, by its ending or its metadata."""
    return file.suffix.lower() in BAG_ENDINGS or (file / "metadata.yaml").is_file()


@typed
def read_logs(
    files: Sequence[str | Path], form: LogForm, model: System, measurement: Measurement | Sensor | None = None
) -> list[Log]:
    """The drives in robots' logs, in the order of the files, one `Log` for each run.

    Args:
        files: to read.
        form: what is where in them: the study's key `log`.
        model: the robot, which says what its inputs and states are.
        measurement: the study's, whose sensors `form` may name.

    Raises:
        ProblemError: the form does not fit the robot.
        LogError: every mistake in any of the files, each with its line, or no files at all.
    """
    measured = None if measurement is None else measurement_of(measurement)
    issues = [*form.issues(model), *form.sensor_issues(measured)]
    if issues:
        raise ProblemError(issues)
    if not files:
        raise LogError.about("", "no logs were given")
    logs = itertools.chain(*together(partial(_read, Path(file), form, model, measured) for file in files))
    return _distinct(_with_wheels_checked(list(logs), model))


def _read(file: Path, form: LogForm, model: System, measurement: Measurement | None) -> list[Log]:
    logs = [_as_measured(log, form, measurement) for log in form.read(file, model)]
    return form.sensed(file, logs, measurement)


def _as_measured(log: Log, form: LogForm, measurement: Measurement | None) -> Log:
    # A column or message may have more than the study's poses measure, of another instrument for example.
    sensors = sensors_of(measurement)
    measured = [
        name for sensor in sensors if sensor.kind == POSES for name in getattr(sensor, "quantities", ())
    ]
    unmeasured = [
        name for name in log.quantities if name in PLANE and name not in {*measured, *form.named_states}
    ]
    columns = [place for place, name in enumerate(log.quantities) if name not in unmeasured]
    if not measured or not unmeasured or not columns or log.motions is not None:
        return log
    text = (
        f"{listing(unmeasured)} left out: the study's poses measure {listing(measured)} alone; to use more, "
        "name it under `log: poses` or in `quantities`"
    )
    findings = tuple(
        finding for finding in log.findings if not any(name in finding.name.split("_") for name in unmeasured)
    )
    quantities = tuple(log.quantities[place] for place in columns)
    kept = replace(log, poses=log.poses[:, columns], quantities=quantities, findings=findings)
    return kept.found("not_measured", text)


def _with_wheels_checked(logs: Sequence[Log], model: System) -> list[Log]:
    # A robot may well drive on one wheel for once, but not in all of its drives.
    driving = [place for place, entry in enumerate(model.inputs) if entry.drives]
    turning = np.array([np.any(log.integrals[:, driving] != 0, axis=0) for log in logs])
    names = [model.inputs[place].name for place in driving]
    ever = np.atleast_1d(turning.any(axis=0))
    dead = [name for name, turns in zip(names, ever, strict=True) if not turns]
    if dead:
        text = f"{' and '.join(dead)} never turn(s) in any of the logs; is it the right column?"
        files = dict.fromkeys(log.file for log in logs)
        raise LogError([FileIssue(file, 0, 0, "", text) for file in files])
    checked = []
    for log, turns in zip(logs, turning, strict=True):
        still = [name for name, moves in zip(names, turns, strict=True) if not moves]
        if still and turns.any():
            log = log.found(
                "wheel_still", f"{' and '.join(still)} never turn(s) in this drive", doubtful=True
            )
        checked.append(log)
    return checked


def _distinct(logs: Sequence[Log]) -> list[Log]:
    # Logs of one name from several folders also have the folder's.
    counts = Counter(log.name for log in logs)
    return [
        replace(log, name=f"{Path(log.file).parent.name}/{log.name}") if counts[log.name] > 1 else log
        for log in logs
    ]
