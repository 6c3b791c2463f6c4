"""What logs said of a robot, as plain data: saved as estimate.json, and its report's only input."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from oed.foundation.errors import FileFlaw, RecordError
from oed.records.record import Part, Record, saved_file
from oed.records.stored.door import checked, read_object
from oed.records.stored.echo import checked_echo
from oed.records.stored.estimate import ComparedModel, Estimated, StoredEstimate

FORMAT = 1
FILE = "estimate.json"


@dataclass(frozen=True)
class EstimateRecord:
    """The outcome of a calibration. `data` is what estimate.json holds; SI, null where there is none.

    `file` is where it was read from, None of one that was made here.
    """

    data: Mapping[str, Any]
    file: Path | None = None

    @cached_property
    def parameters(self) -> tuple[Estimated, ...]:
        """The robot's parameters with their estimates."""
        return tuple(self._part(Estimated, one) for one in self.data["parameters"])

    @property
    def values(self) -> dict[str, float]:
        """Estimates by name, SI; NaN where there is none."""
        return {one.name: math.nan if one.value is None else one.value for one in self.parameters}

    @cached_property
    def models(self) -> tuple[ComparedModel, ...]:
        """One entry per model that was compared, the study's own first; none where nothing was.

        Each with name, kind, own, comparable, reason, doubt, parameters (name, unit, value, standard_error),
        unknowns, starts, log_likelihood and scores: by `aicc`, `bic` and `held_out` [m] the value, difference
        to the best, interval of that (95 %) and equal (whether as good as the best). What all have in common
        stands beside them in `data["comparison"]`: readings, inflation, inflation_by, best, agree,
        favourites (as good as the best by every measure).
        """
        found = (self.data.get("comparison") or {}).get("models") or ()
        return tuple(self._part(ComparedModel, one) for one in found)

    def _part(self, kind: type[Part], found: Mapping[str, Any]) -> Part:
        return checked(kind, found, self.file or Path(FILE))


def estimate_files(record: EstimateRecord) -> dict[str, str]:
    """The file of an estimate, by its name."""
    return {FILE: Record(record.data).to_json()}


def load_estimate(folder: str | Path) -> EstimateRecord:
    """Read the estimate in `folder` (or the file itself).

    Raises:
        RecordError: no estimate there, or not one of this format.
    """
    path = saved_file(folder, FILE)
    expected = f"expected an estimate of format {FORMAT}; make it again with `oed estimate`"
    data = read_object(path, "no estimate there; make one with `oed estimate`", expected)
    if data.get("format") != FORMAT or "parameters" not in data:
        raise RecordError([FileFlaw(str(path), 0, 0, "", expected)])
    return EstimateRecord(known_estimate(data, path), path)


def known_estimate(data: Mapping[str, Any], path: Path) -> dict[str, Any]:
    """What estimate.json holds as this version knows it.

    Raises:
        RecordError: as `load_estimate` does.
    """
    known = checked(StoredEstimate, data, path).plain()
    if "study" in known:
        known["study"] = checked_echo(known["study"], path)
    return known
