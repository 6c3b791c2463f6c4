"""Discrepancies by the names of estimates: the numbers that residuals show take the names' place, so that a
study stands on its own from here on.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from oed.foundation.errors import Flaw, ProblemError
from oed.kernel.measurement.measurement import Measurement
from oed.robots.sensors.pose_noise import AbsoluteNoise, DiscrepancyRecord
from oed.robots.sensors.pose_noise import Discrepancy as Discrepancy
from oed.study.study_file import StudyFile

DiscrepancyOf = Callable[[Path], Discrepancy]
"""What residuals of the estimate in a folder show; raises a `ProblemError` without keys."""
Key = tuple[str | int, ...]
File = TypeVar("File", bound=StudyFile)


def no_estimates(folder: Path) -> Discrepancy:
    """The discrepancy of no estimate: for studies that are to stand on their own.

    Raises:
        ProblemError: always.
    """
    raise ProblemError.about((), f"expected a discrepancy as numbers here, got one of {folder.name}")


def with_discrepancies(file: File, folder: Path, discrepancy_of: DiscrepancyOf) -> File:
    """A study whose poses have numbers where they named estimates.

    Args:
        file: the study's keys.
        folder: from which estimates are found.
        discrepancy_of: what residuals of an estimate show.

    Raises:
        ProblemError: every estimate that cannot be read, by its key.
    """
    flaws = list[Flaw]()

    def read(key: Key, sensor: Measurement) -> Measurement:
        noise = getattr(sensor, "noise", None)
        if not isinstance(noise, AbsoluteNoise) or not isinstance(noise.discrepancy, DiscrepancyRecord):
            return sensor
        place = folder / noise.discrepancy.record
        try:
            found = noise.model_copy(update={"discrepancy": discrepancy_of(place)})
        except ProblemError as error:
            whole = (*key, "noise", "discrepancy", "record")
            flaws.extend(Flaw(whole, flaw.message) for flaw in error.flaws)
            return sensor
        return sensor.model_copy(update={"noise": found})

    measurement = file.measurement
    several = getattr(measurement, "sensors", None)
    if several is None:
        measurement = read(("measurement",), measurement)
    else:
        each = tuple(read(("measurement", index), one) for index, one in enumerate(several))
        measurement = measurement.model_copy(update={"sensors": each})
    if flaws:
        raise ProblemError(flaws)
    return file.model_copy(update={"measurement": measurement})
