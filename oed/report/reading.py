"""What a report reads out of a record: the best result, and the drives as series to draw."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from oed.record import Record, drive_of
from oed.report.wording import Unit, common_units, words

Array = npt.NDArray[np.float64]
Entry = Mapping[str, Any]

PER_SAMPLE = 4
"""Points drawn per sample of a smooth input."""
MOST_POINTS = 1500
"""Points drawn per input at most."""
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
    return str(record.data["study"]["measurement"]["kind"]) == "displacements"


def sensors(record: Record) -> list[Mapping[str, Any]]:
    """The sensors that are read; [] where displacements are measured."""
    measurement = record.data["study"]["measurement"]
    if is_regression(record):
        return []
    return list(measurement["sensors"]) if measurement["kind"] == "several" else [measurement]


def beacons(record: Record) -> Array:
    """Positions (n, 2) [m] of all beacons that distances are measured to."""
    found = [place for sensor in sensors(record) for place in sensor.get("beacons", [])]
    return np.array(found, dtype=float).reshape(-1, 2)


def blocks(record: Record) -> list[str]:
    """Names of the regressions, in the order of the parameters."""
    return list(dict.fromkeys(parameter["block"] for parameter in record.data["parameters"]))


def segments(record: Record, samples: int) -> int | None:
    """Number of segments P of a displacement measurement of a drive of that many samples."""
    measurement = record.data["study"]["measurement"]
    given = measurement.get("segments")
    return samples if given == "samples" else given


def deviation_units(record: Record, entry: Entry) -> dict[str, Unit]:
    """The unit, and its factor from SI, in which each parameter's deviation is shown: as suits one drive."""
    units = {parameter["name"]: str(parameter["unit"]) for parameter in record.data["parameters"]}
    known = entry["standard_deviations"]
    return common_units({name: known.get(name) for name in units}, units)


def limit_bounds(record: Record, name: str) -> tuple[float, float] | None:
    """Bounds (min, max) of a limit on the inputs, SI; None where the study has no such limit."""
    limit = record.data["study"]["limits"].get(name)
    return None if limit is None else (limit["bounds"][0], limit["bounds"][1])


def solver_options(record: Record, entry: Entry) -> Mapping[str, Any]:
    """The study's options of the search that made a result; {} for anything but a search."""
    solvers = [] if entry["kind"] == "baseline" else record.data["study"]["solvers"]
    return next((one for one in solvers if (one.get("name") or one["kind"]) == entry["name"]), {})


@dataclass(frozen=True)
class Path:
    """A drive's path.

    Attributes:
        title: the result's name.
        x, y, heading: at the samples, (N + 1,) [m, m, rad].
        speed: mean over each period, (N,) [m/s], negative where the robot drives backwards.
        edges: sample indices at which segments meet, the ends left out.
        feasible: whether the drive keeps every limit.
    """

    title: str
    x: Array
    y: Array
    heading: Array
    speed: Array
    edges: npt.NDArray[np.int64]
    feasible: bool


def path_of(record: Record, entry: Entry) -> Path:
    """The path of a result that has a drive, from the poses saved with it."""
    drive = drive_of(entry)
    assert drive is not None
    x, y, heading_angle = np.array(entry["drive"]["poses"], dtype=float)[:, :3].T
    turn = np.diff(heading_angle)
    along = np.hypot(np.diff(x), np.diff(y)) / drive.period
    if record.data["study"]["trajectory"]["integration"] == "arc":
        along = along / np.sinc(np.clip(turn / (2 * np.pi), -0.75, 0.75))
    middle = heading_angle[:-1] + turn / 2
    forward = np.diff(x) * np.cos(middle) + np.diff(y) * np.sin(middle) >= 0
    speed, edges = np.where(forward, along, -along), _edges(record, drive.samples)
    return Path(heading(entry), x, y, heading_angle, speed, edges, bool(entry["feasible"]))


def _edges(record: Record, samples: int) -> npt.NDArray[np.int64]:
    count = segments(record, samples) or 1
    return np.rint(np.linspace(0, samples, count + 1)).astype(np.int64)[1:-1]


@dataclass(frozen=True)
class Series:
    """A drive's inputs, or their rates, over time.

    Attributes:
        title: the result's name.
        times: (k,) [s].
        values: (k, inputs).
        steps: whether each value holds until the next time.
    """

    title: str
    times: Array
    values: Array
    steps: bool = False


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


def inputs_of(entry: Entry) -> Series:
    """The inputs of a result that has a drive."""
    drive = drive_of(entry)
    assert drive is not None
    if drive.degree == 0:
        times = np.linspace(0.0, drive.duration, drive.samples + 1)
        return Series(heading(entry), times, np.vstack([drive.inputs, drive.inputs[-1:]]), steps=True)
    times = _drawn_times(drive.duration, drive.samples)
    return Series(heading(entry), times, drive.inputs_at(times))


def rates_of(entry: Entry) -> Series:
    """The inputs' rates of a result that has a drive; for a piecewise constant one, jumps over a period."""
    drive = drive_of(entry)
    assert drive is not None
    if drive.degree == 0:
        times = np.linspace(0.0, drive.duration, drive.samples + 1)[1:-1]
        return Series(heading(entry), times, drive.rates_at(times), steps=True)
    times = _drawn_times(drive.duration, drive.samples)
    return Series(heading(entry), times, drive.rates_at(times))


def _drawn_times(duration: float, samples: int) -> Array:
    return np.linspace(0.0, duration, min(PER_SAMPLE * samples, MOST_POINTS) + 1)
