"""What logs said of a robot: saved as estimate.json, and its report's only input."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from oed.foundation.errors import FileFlaw, RecordError
from oed.records.record import saved_file
from oed.records.stored.door import checked, json_text, read_object
from oed.records.stored.echo import checked_echo
from oed.records.stored.estimate import EstimateRecord as EstimateRecord

FORMAT = 1
FILE = "estimate.json"


def estimate_files(record: EstimateRecord) -> dict[str, str]:
    """The file of an estimate, by its name."""
    return {FILE: json_text(record.plain())}


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
    return known_estimate(data, path)


def known_estimate(data: Mapping[str, Any], path: Path) -> EstimateRecord:
    """What estimate.json holds as this version knows it.

    Raises:
        RecordError: as `load_estimate` does.
    """
    found = checked(EstimateRecord, data, path)
    if found.study is not None:
        found = found.model_copy(update={"study": checked_echo(found.study, path)})
    return found.at(path)
