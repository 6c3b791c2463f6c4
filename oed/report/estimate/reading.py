"""What the page reads out of an estimate's data, whatever of it may be missing."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any

import numpy as np
import numpy.typing as npt

from oed.foundation.text import Unit, count, words
from oed.report.estimate.numbers import known, own_unit

Array = npt.NDArray[np.float64]
Data = Mapping[str, Any]

MOST_ROWS = 15
"""Rows of a table beyond which the others are told together."""


@dataclass(frozen=True)
class Run:
    """Dead reckoning of one log that the estimate did not know: numbers by name, SI."""

    log: str
    before: Mapping[str, Any]
    after: Mapping[str, Any]

    def pair(self, name: str) -> tuple[float, float] | None:
        """A number with nominal and with estimated parameters; None unless both are finite."""
        both = known(self.before.get(name)), known(self.after.get(name))
        if both[0] is None or both[1] is None or not all(map(math.isfinite, both)):  # type: ignore[arg-type]
            return None
        return both[0], both[1]


@dataclass(frozen=True)
class Reckoned:
    """One log's paths (n, 2) [m], NaN where they are interrupted."""

    title: str
    reference: Array
    before: Array
    after: Array

    @property
    def start(self) -> Array:
        """The first measured position."""
        told = np.isfinite(self.reference).all(axis=1)
        return np.asarray(self.reference[told][0])


def entries(data: Data, key: str) -> list[Mapping[str, Any]]:
    """A list of the data, [] where there is none."""
    return list(data.get(key) or [])


def runs_of(part: Mapping[str, Any]) -> list[Run]:
    """The logs of one part that was left out or kept apart."""
    return [Run(*one) for one in zip(part["logs"], part["before"], part["after"], strict=True)]


def left_out_runs(data: Data) -> list[Run]:
    """Every log against the estimate from the others."""
    return [run for part in entries(data, "left_out") for run in runs_of(part)]


def held_out_runs(data: Data) -> list[Run]:
    """The logs that were kept apart."""
    return runs_of(data["held_out"]) if data.get("held_out") else []


def means(runs: Sequence[Run], name: str) -> tuple[float, float] | None:
    """A number before and after, mean of the runs that have it."""
    pairs = [pair for run in runs if (pair := run.pair(name)) is not None]
    if not pairs:
        return None
    before, after = zip(*pairs, strict=True)
    return sum(before) / len(pairs), sum(after) / len(pairs)


def clocks(data: Data) -> list[Mapping[str, Any]]:
    """The clock offsets that were estimated, one a file."""
    return [one for one in entries(data, "nuisances") if one["name"] == "clock_offset"]


def clock_label(data: Data, clock: Mapping[str, Any]) -> str:
    """What a clock's offset belongs to: the log, or the file where that holds several."""
    file = clock.get("file") or ""
    names = [str(log["name"]) for log in entries(data, "logs") if log.get("file") == file]
    return names[0] if len(names) == 1 else PurePath(file).name or "all logs"


def units(data: Data) -> dict[str, Unit]:
    """The unit, and its factor from SI, in which each parameter is shown."""
    return {str(one["name"]): own_unit(str(one.get("unit") or "")) for one in entries(data, "parameters")}


def errors(data: Data) -> dict[str, float | None]:
    """Standard errors of the parameters, SI."""
    return {str(one["name"]): known(one.get("standard_error")) for one in entries(data, "parameters")}


def logs_text(data: Data) -> str:
    """`6 logs`."""
    return count(len(entries(data, "logs")), "log")


def study_of(data: Data) -> Mapping[str, Any]:
    """The study as it was read, {} where it is not known."""
    return data.get("study") or {}


def robot_text(data: Data) -> str:
    """The robot's kind in words."""
    return words(str(study_of(data).get("robot", {}).get("kind", "")))


def segment_text(data: Data) -> str:
    """`segments of 2 s (210 in all)`, or what else the logs were cut into."""
    segments, parts = data.get("segments") or {}, "windows" if by_windows(data) else "segments"
    seconds, number = known(segments.get("seconds")), segments.get("count")
    each = "whole logs" if seconds is None or math.isinf(seconds) else f"{parts} of {seconds:.3g} s"
    return f"{each} ({number} in all)" if number else each


def by_windows(data: Data) -> bool:
    """Whether motion between the ends of windows was compared, rather than all poses of segments."""
    return data.get("method") in ("gls", "two_stage")


def asked(data: Data, option: str) -> Any:
    """An option of the study's key `calibration`, "auto" where it does not say."""
    return (study_of(data).get("calibration") or {}).get(option, "auto")


def in_signs(text: str) -> str:
    """A message with the signs of formulas that a page can show."""
    return text.replace("F^-1", "F⁻¹").replace("+-", "±")
