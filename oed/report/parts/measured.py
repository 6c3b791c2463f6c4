"""What is measured, what is estimated along and what is known beforehand, in words."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

from oed.foundation.text import deviation_text, given_text, listing, words
from oed.records.record import Record
from oed.report.parts.reading import runs_of

STATES = ("x", "y", "heading")


def measured_as(record: Record) -> str:
    """`the displacements of 10 segments`, `201 poses (x, y and heading)`."""
    return f"{record.study.measurement.brief(record.study.trajectory.samples)}{_each_run(record)}"


def readings_text(record: Record) -> str:
    """All sensors, with when they are read and their noise."""
    sentence = record.study.measurement.sentence(record.study.trajectory.samples)
    return f"What is read{_each_run(record)}: {sentence}."


def _each_run(record: Record) -> str:
    return " in each run" if runs_of(record) > 1 else ""


def along_text(record: Record) -> str:
    """What is estimated along with the parameters; "" for nothing."""
    told = [f"{_called(name)}{_known(entries)}" for name, entries in _grouped(record).items()]
    return f"Estimated along, as nobody knows them exactly: {listing(told)}." if told else ""


def nuisance_names(record: Record) -> list[str]:
    """What is estimated along, each with its article."""
    return [_called(name) for name in _grouped(record)]


def _grouped(record: Record) -> dict[str, list[Mapping[str, Any]]]:
    # initial_pose.x, initial_pose.y -> initial_pose; poses.lever_arm.x -> poses.lever_arm; yaw_rate.bias.
    groups: dict[str, list[Mapping[str, Any]]] = {}
    for entry in record.data.get("nuisances", []):
        full = re.sub(r"^initial_pose_\d+\.", "initial_pose_of_each_run.", str(entry["name"]))
        name, _, last = full.rpartition(".")
        groups.setdefault(name if last in STATES else full, []).append(entry)
    return groups


def _called(name: str) -> str:
    owner, _, what = name.rpartition(".")
    return f"the {words(what)} of the {words(owner)}" if owner else f"the {words(name)}"


def _known(entries: Sequence[Mapping[str, Any]]) -> str:
    known = [(entry["deviation"], entry["unit"]) for entry in entries if entry["deviation"] is not None]
    sizes = list(dict.fromkeys(given_text(size, unit) for size, unit in known))
    return f" (known beforehand to {listing(sizes)})" if sizes else ""


def prior_text(record: Record) -> str:
    """What is known of the parameters beforehand; "" where nothing is."""
    known = prior_of(record)
    if not known:
        return ""
    told = [f"{words(name)} to {size}" for name, size in known.items()]
    correlated = " (with their correlations)" if record.data["study"]["prior"].get("covariance") else ""
    return f"Known beforehand, and part of every number here: {listing(told)}{correlated}."


def prior_of(record: Record) -> dict[str, str]:
    """Standard deviations known beforehand, by parameter, as they are shown; {} without a prior."""
    prior = record.data["study"].get("prior") or {}
    table = {parameter["name"]: parameter for parameter in record.data["parameters"]}
    given = {
        name: _given(size, table.get(name)) for name, size in prior.get("standard_deviations", {}).items()
    }
    for index, name in enumerate(prior.get("parameters", [])):
        size = math.sqrt(prior["covariance"][index][index])
        given[name] = deviation_text(size, table[name]["unit"])
    return given


def _given(size: float | str, parameter: Mapping[str, Any] | None) -> str:
    # As the study says it; a bare number is in SI units.
    if isinstance(size, str) or parameter is None:
        return str(size)
    return deviation_text(size, parameter["unit"])
