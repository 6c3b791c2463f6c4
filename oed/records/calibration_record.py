"""What logs said of a robot: saved as estimate.json, and its report's only input."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from oed.records.record import saved_file
from oed.records.stored.door import checked, read_file
from oed.records.stored.echo import read_echo
from oed.records.stored.estimate import EstimateRecord as EstimateRecord

FILE = "estimate.json"


def estimate_files(record: EstimateRecord) -> dict[str, str]:
    """The file of an estimate, by its name."""
    return {FILE: record.to_json()}


def load_estimate(folder: str | Path) -> EstimateRecord:
    """Read the estimate in `folder` (or the file itself).

    Raises:
        RecordError: no estimate there, or not one of this format.
    """
    path = saved_file(folder, FILE)
    return known_estimate(read_file(path, "an estimate", "oed estimate", "parameters"), path)


def known_estimate(data: Mapping[str, Any], path: Path) -> EstimateRecord:
    """What estimate.json holds as this version knows it.

    Raises:
        RecordError: as `load_estimate` does.
    """
    found = checked(EstimateRecord, data, path)
    if found.study is not None:
        found = found.model_copy(update={"study": read_echo(found.study, path).echo()})
    return found.at(path)
