"""What is to be exported: a result of a saved record, at a rate, to a place."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from oed.exporters.commands import Commands, commands, commands_along
from oed.exporters.vehicle import Vehicle, motions_of, recorded_vehicle, vehicle_of
from oed.foundation.errors import RecordError, UserMistake
from oed.foundation.files import file_stem, inside
from oed.kernel.problem import Problem
from oed.records.record import FILE, Record
from oed.records.recorded_study import recorded_study
from oed.records.stored.result import Result, StoredDrive
from oed.robots.models import PythonRobot
from oed.robots.models.model import robot_of

MOST_COMMANDS = 1_000_000
"""Commands of one run; more are a mistyped rate."""


@dataclass(frozen=True)
class Request:
    """One export, as `oed.export` is asked for it.

    Attributes:
        folder: where the record lies; and where to write, unless `out` says it.
        record: the record.
    """

    folder: Path
    record: Record
    result: str | None
    rate: float | None
    out: Path | None
    storage: str
    force: bool
    trust: bool = False
    message: str | None = None

    @cached_property
    def problem(self) -> Problem:
        """The problem of the record's study.

        Raises:
            RecordError: it names code that is not trusted.
        """
        return recorded_study(self.record, trust=self.trust).problem

    @cached_property
    def vehicle(self) -> Vehicle:
        """What drives: as its model says, or of code that is not trusted as the record says."""
        robot = self.record.robot_study.robot
        if not isinstance(robot, PythonRobot):
            return vehicle_of(robot)
        if self.trust or self.record.file is None:
            return vehicle_of(robot_of(self.problem.model))
        return recorded_vehicle(self.record, self.drive)

    @cached_property
    def entry(self) -> Result:
        """The result in the record.

        Raises:
            RecordError: no such result; the names of those there are, are listed.
        """
        found = self.record.result(self.result)
        if found is None:
            asked = "no feasible result" if self.result is None else f"no result {self.result!r}"
            names = ", ".join(one.name for one in self.record.results) or "none"
            raise self._issue(f"{asked}; the record has {names}")
        return found

    @property
    def name(self) -> str:
        """The result's name."""
        return self.entry.name

    @property
    def departures(self) -> dict[str, Any] | None:
        """Robots that leave the workspace on the drive, as the record says; None where it says nothing."""
        departures = self.record.departures
        return None if departures is None else departures.exported(self.name)

    @property
    def drive(self) -> StoredDrive:
        """The result's drive.

        Raises:
            RecordError: it has none; names those that do.
        """
        drive = self.entry.drive
        if drive is None:
            names = ", ".join(one.name for one in self.record.results if one.drive is not None)
            raise self._issue(f"the result {self.name} holds no drive; those that do: {names or 'none'}")
        return drive

    @cached_property
    def runs(self) -> tuple[Commands, ...]:
        """The commands of every run.

        Raises:
            RecordError: no such result, or one that is no drive.
            UserMistake: a rate that makes too many commands.
        """
        drive = self.drive.trajectory
        if self.rate is not None and self.rate * drive.duration / drive.runs > MOST_COMMANDS:
            text = f"more than {MOST_COMMANDS} commands in {drive.duration / drive.runs:g} s"
            raise UserMistake(f"rate: {self.rate:g} Hz would be {text}")
        model = self.vehicle.model
        if model is not None:
            return commands(model.system(self.record.robot_study.space.integration), drive, self.rate)
        motions = [one.driven for one in motions_of(self.record, self.drive, drive.period)]
        return commands_along(self.vehicle.inputs, motions, drive, self.rate)

    def path(self, ending: str) -> Path:
        """Where to write: `out`, or the folder's file named after the result and `ending`."""
        return self.out if self.out is not None else inside(self.folder, f"{file_stem(self.name)}_{ending}")

    def _issue(self, text: str) -> RecordError:
        return RecordError.about(self.folder / FILE, text)


def require_rate(rate: float | None) -> None:
    """Refuse a rate that is none.

    Raises:
        UserMistake: it is not above 0, or not finite.
    """
    if rate is not None and not (math.isfinite(rate) and rate > 0):
        raise UserMistake(f"rate: expected more than 0 Hz, got {rate:g}")
