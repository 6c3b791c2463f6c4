"""What studies take from estimates by their names, a discrepancy or a drift: numbers take the names' place,
so that a study stands on its own from here on.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from oed.foundation.errors import Issue, ProblemError
from oed.kernel.measurement.measurement import Sensors
from oed.kernel.measurement.sensor import Sensor
from oed.robots.sensors.drift import Drift as Drift
from oed.robots.sensors.drift import DriftRecord
from oed.robots.sensors.pose_noise import AbsoluteNoise, DiscrepancyRecord
from oed.robots.sensors.pose_noise import Discrepancy as Discrepancy
from oed.study.study_file import StudyFile

Key = tuple[str | int, ...]
File = TypeVar("File", bound=StudyFile)


class Estimates(NamedTuple):
    """How parts of sensors are found in an estimate's folder; each raises a `ProblemError` without keys.

    Attributes:
        discrepancy: what its residuals show.
        drift: how much its logs drift.
    """

    discrepancy: Callable[[Path], Discrepancy]
    drift: Callable[[Path], Drift]


def _none(folder: Path) -> Any:
    raise ProblemError.about((), f"expected numbers here, got those of an estimate: {folder.name}")


NO_ESTIMATES = Estimates(_none, _none)
"""Of studies that are to stand on their own: every name is refused."""


def with_estimates(file: File, folder: Path, estimates: Estimates) -> File:
    """A study whose sensors have numbers where they named estimates.

    Args:
        file: the study's keys.
        folder: from which estimates are found.
        estimates: how parts are found in them.

    Raises:
        ProblemError: every estimate that cannot be read, by its key.
    """
    issues, measurement = list[Issue](), file.measurement

    def read(key: Key, record: str, part: Callable[[Path], Any]) -> Any:
        try:
            return part(folder / record)
        except ProblemError as error:
            issues.extend(Issue((*key, "record"), issue.message) for issue in error.issues)
            return None

    def numbers(key: Key, sensor: Sensor) -> Sensor:
        noise, drift = getattr(sensor, "noise", None), getattr(sensor, "drift", None)
        if isinstance(noise, AbsoluteNoise) and isinstance(noise.discrepancy, DiscrepancyRecord):
            found = read((*key, "noise", "discrepancy"), noise.discrepancy.record, estimates.discrepancy)
            sensor = sensor.model_copy(update={"noise": noise.model_copy(update={"discrepancy": found})})
        if isinstance(drift, DriftRecord):
            found = read((*key, "drift"), drift.record, estimates.drift)
            sensor = sensor.model_copy(update={"drift": found})
        return sensor

    if isinstance(measurement, Sensor):
        measurement = numbers(("measurement",), measurement)
    elif isinstance(measurement, Sensors):
        each = tuple(numbers(("measurement", index), one) for index, one in enumerate(measurement.sensors))
        measurement = measurement.model_copy(update={"sensors": each})
    if issues:
        raise ProblemError(issues)
    return file.model_copy(update={"measurement": measurement})
