"""Records of data of which parts may be left out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from oed.records.record import Record
from oed.records.stored.result import Result

REST = {
    "format": 1,
    "oed_version": "1.2.3",
    "study": {},
    "study_text": "",
    "seed": 7,
    "parameters": [{"name": "track", "nominal": 0.2, "unit": "m", "block": "poses", "noise": None}],
    "results": [],
    "certificate": None,
    "validation": None,
    "notes": [],
    "provenance": {
        "packages": {"casadi": "3.8.2", "numpy": "2.4.6"},
        "python": "3.11.7",
        "platform": "Linux x86_64",
        "finished": "2026-01-02T03:04:05+00:00",
    },
}


def record_from(data: Mapping[str, Any]) -> Record:
    """The record that holds this data, and where it is silent what is usual; as if it was made here.

    Its parts are checked one by one, and nothing against the study.
    """
    return Record.model_validate({**REST, **data})


def keep_results(data: dict[str, Any], *names: str) -> None:
    """Leave results of other names out of a record's data, and what was simulated on their drives."""
    data["results"] = [result for result in data["results"] if result["name"] in names]
    for key in ("validation", "robustness", "departures"):
        part = data.get(key)
        if part is not None:
            part["results"] = [result for result in part["results"] if result["name"] in names]
    # Paths of some robots on a drive.
    departures = data.get("departures")
    if departures is not None and departures["bundle"] and departures["bundle"]["name"] not in names:
        departures["bundle"] = None


def exceeding(result: Result, **shares: float) -> Result:
    """A result that exceeds limits by shares of their sizes."""
    margins = [
        one.model_copy(update={"margin": -shares[one.limit] * one.size, "satisfied": False})
        if one.limit in shares
        else one
        for one in result.margins
    ]
    return result.model_copy(update={"feasible": False, "margins": margins, "violations": shares})
