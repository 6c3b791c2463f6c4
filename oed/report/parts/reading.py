"""What a report reads out of a record: its results, what is measured, how long and in how many runs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from oed.foundation.component import Component
from oed.foundation.text import Unit, common_units, words
from oed.records.record import Record
from oed.robots.sensors import Displacements

Array = npt.NDArray[np.float64]
Entry = Mapping[str, Any]

NOWHERE = 1e-3
"""Path length [m] below which a drive goes nowhere."""


def with_drive(record: Record) -> list[Entry]:
    """The results that have a drive, feasible or not."""
    return [entry for entry in record.results if entry["drive"] is not None]


def value(entry: Entry, key: str) -> float | None:
    """A number of a result; infinite where a drive was scored but JSON could not hold the number."""
    number = entry[key]
    if number is not None:
        return float(number)
    scored_infinite = entry["drive"] is not None and key in ("condition_number", "lambda_max")
    return np.inf if scored_infinite else None


def heading(entry: Entry) -> str:
    """A result's name in words, and below it what is special about it: its variant, limits it breaks."""
    name, variant, _ = str(entry["name"]).partition("_same_length")
    broken = [words(limit) for limit in entry["violations"]]
    what = broken[0] if len(broken) == 1 else f"{len(broken)} limits"
    notes = ["same length"] if variant else []
    notes += ["on the spot"] if on_the_spot(entry) else []
    return "\n".join(filter(None, [words(name), ", ".join(notes), f"breaks {what}" if broken else ""]))


def on_the_spot(entry: Entry) -> bool:
    """Whether a drive goes nowhere: it turns, or rests."""
    length = value(entry, "path_length")
    return length is not None and length < NOWHERE


def is_regression(record: Record) -> bool:
    """Whether the displacements of segments are measured, the paper's way, rather than sensors read."""
    return isinstance(record.study.measurement, Displacements)


def beacons(record: Record) -> Array:
    """Positions (n, 2) [m] of all beacons that distances are measured to."""
    found = [
        place for sensor in record.study.measurement.joint_sensors for place in getattr(sensor, "beacons", ())
    ]
    return np.array(found, dtype=float).reshape(-1, 2)


def blocks(record: Record) -> list[str]:
    """Names of the regressions, in the order of the parameters."""
    return list(dict.fromkeys(parameter["block"] for parameter in record.data["parameters"]))


def runs_of(record: Record) -> int:
    """How many runs the designed drives consist of."""
    return int(record.data["study"]["trajectory"].get("runs", 1))


def whole_duration(record: Record) -> float:
    """Duration of the designed drives, all runs together [s]."""
    return runs_of(record) * float(record.data["study"]["trajectory"]["duration"])


def duration_text(record: Record) -> str:
    """How long the designed drives last: `8 s`, `3 runs of 8 s`."""
    duration, runs = f"{record.data['study']['trajectory']['duration']:g} s", runs_of(record)
    return duration if runs == 1 else f"{runs} runs of {duration}"


def segments(record: Record, samples: int) -> int | None:
    """Number of segments P of a displacement measurement of a run of that many samples."""
    measurement = record.study.measurement
    return measurement.segment_count(samples) if isinstance(measurement, Displacements) else None


def deviation_units(record: Record, entry: Entry) -> dict[str, Unit]:
    """The unit, and its factor from SI, in which each parameter's deviation is shown: as suits one drive."""
    units = {parameter["name"]: str(parameter["unit"]) for parameter in record.data["parameters"]}
    known = entry["standard_deviations"]
    return common_units({name: known.get(name) for name in units}, units)


def solver_of(record: Record, entry: Entry) -> Component | None:
    """The search that made a result; None for anything but a search."""
    solvers = () if entry["kind"] == "baseline" else record.study.solvers
    return next((one for one in solvers if one.label == entry["name"]), None)


@dataclass(frozen=True)
class Cloud:
    """Simulated estimates of two parameters.

    Attributes:
        title: the result's name.
        labels: of the two axes, with units.
        points: estimates, (k, 2).
        true: (2,).
        promised, sampled: covariances, (2, 2).
        alike: whether both axes are of one unit.
    """

    title: str
    labels: tuple[str, ...]
    points: Array
    true: Array
    promised: Array
    sampled: Array
    alike: bool = True
