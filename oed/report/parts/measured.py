"""What is measured, what is estimated along and what is known beforehand, in words."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

from oed.foundation.text import count, deviation_text, given_text, listing, words
from oed.records.record import Record
from oed.report.parts.reading import blocks, is_regression, runs_of, segments, sensors

Sensor = Mapping[str, Any]

STATE_UNITS = {"x": "m", "y": "m", "heading": "rad"}
COORDINATES = ("x", "y")


def measured_as(record: Record) -> str:
    """`displacements of 10 segments`, `201 poses (x, y and heading)`; "" where nothing is known of it."""
    if is_regression(record):
        parts = segments(record, samples_of(record))
        return f"the {_regressor(record)} of {count(parts, 'segment')}{_each_run(record)}" if parts else ""
    return f"{listing([_brief(sensor, samples_of(record)) for sensor in sensors(record)])}{_each_run(record)}"


def _each_run(record: Record) -> str:
    return " in each run" if runs_of(record) > 1 else ""


def samples_of(record: Record) -> int:
    """Samples of each run of the designed drives."""
    return int(record.data["study"]["trajectory"]["samples"])


def _regressor(record: Record) -> str:
    return {"position": "displacements", "heading": "turns"}.get(
        "/".join(blocks(record)), "displacements and turns"
    )


def readings(sensor: Sensor, samples: int) -> int:
    """How often a sensor is read on a drive of that many samples."""
    moments = samples if sensor["kind"] == "yaw_rate" else samples + 1
    return math.ceil(moments / int(sensor.get("every", 1)))


def _brief(sensor: Sensor, samples: int) -> str:
    times = readings(sensor, samples)
    if sensor["kind"] == "poses":
        noun, names = count(times, _pose_noun(sensor)), listing(sensor["quantities"])
        return noun if names == "heading" else f"{noun} ({names})"
    if sensor["kind"] == "ranges":
        return f"the distances to {count(len(sensor['beacons']), 'beacon')} at {count(times, 'time')}"
    return count(times, words(sensor["kind"]))


def _pose_noun(sensor: Sensor) -> str:
    given = set(sensor["quantities"])
    return "pose" if len(given) == len(STATE_UNITS) else "heading" if given == {"heading"} else "position"


def readings_text(record: Record) -> str:
    """All sensors, with when they are read and their noise."""
    samples = samples_of(record)
    sentences = [_sentence(sensor, samples) for sensor in sensors(record)]
    return f"What is read{_each_run(record)}: {'; '.join(sentences)}."


def _sentence(sensor: Sensor, samples: int) -> str:
    tell = {"poses": _poses, "ranges": _ranges, "yaw_rate": _yaw_rate}.get(sensor["kind"])
    what = tell(sensor) if tell else words(sensor["kind"])
    times = readings(sensor, samples)
    return what.replace("WHEN", f"{_when(sensor)} ({count(times, 'time')})")


def _when(sensor: Sensor) -> str:
    every = int(sensor.get("every", 1))
    unit = "period" if sensor["kind"] == "yaw_rate" else "sample"
    where = "in" if unit == "period" else "at"
    return f"{where} every {unit}" if every == 1 else f"{where} every {_ordinal(every)} {unit}"


def _ordinal(number: int) -> str:
    if number % 100 in (11, 12, 13):
        return f"{number}th"
    return f"{number}{ {1: 'st', 2: 'nd', 3: 'rd'}.get(number % 10, 'th') }"


def _poses(sensor: Sensor) -> str:
    names = sensor["quantities"]
    return f"{listing(names)} WHEN with {_pose_noise(sensor)}{_place(sensor)}"


def _pose_noise(sensor: Sensor) -> str:
    names, noise = sensor["quantities"], sensor["noise"]
    covariance = noise.get("covariance")
    if covariance:
        of = "one reading" if len(covariance) == len(names) else "all readings together"
        sizes = [math.sqrt(covariance[index][index]) for index in range(len(names))]
        alone = [_sized(name, size) for name, size in zip(names, sizes, strict=True)]
        return f"correlated noise, its covariance given for {of} (standard deviations {listing(alone)})"
    deviations = {name: _deviation(noise, name) for name in names}
    if {"x", "y"} <= set(names) and deviations["x"] == deviations["y"]:
        sizes_told = [f"{given_text(deviations.pop('x'), 'm')} per coordinate"]
        del deviations["y"]
    else:
        sizes_told = []
    sizes_told += [_sized(name, size) for name, size in deviations.items()]
    noun = "a standard deviation" if len(sizes_told) == 1 else "standard deviations"
    return f"{noun} of {listing(sizes_told)}{_growth(noise, names)}"


def _deviation(noise: Mapping[str, Any], name: str) -> float:
    own = noise.get(name)
    return float((noise.get("position") or 0.0) if own is None else own)


def _sized(name: str, size: float) -> str:
    return f"{given_text(size, STATE_UNITS[name])} in {name}"


def _growth(noise: Mapping[str, Any], names: Sequence[str]) -> str:
    # The variance is sigma^2 + (k_v V)^2 + (k_w Omega)^2 at speed V and yaw rate Omega.
    parts = [
        ("per_speed", "the speed V", "(kV)²", "k", "m/s"),
        ("per_yaw_rate", "the yaw rate Ω", "(k'Ω)²", "k'", "rad/s"),
    ]
    causes, terms, rates = list[str](), list[str](), list[str]()
    for key, cause, term, factor, unit in parts:
        found = []
        if noise.get(f"position_{key}") and set(names) & set(COORDINATES):
            found.append(f"{given_text(noise[f'position_{key}'], 'm')} per {unit} in position")
        if noise.get(f"heading_{key}") and "heading" in names:
            found.append(f"{given_text(noise[f'heading_{key}'], 'rad')} per {unit} in heading")
        if found:
            causes.append(cause)
            terms.append(term)
            rates.append(f"{factor} = {listing(found)}")
    if not rates:
        return ""
    return f", growing with {listing(causes)} as √(σ² + {' + '.join(terms)}), {', '.join(rates)}"


def _ranges(sensor: Sensor) -> str:
    places = [f"({x:g}, {y:g}) m" for x, y in sensor["beacons"]]
    where = f" at {listing(places)}" if len(places) <= 6 else ""
    noise = given_text(sensor["noise"], "m")
    beacons = count(len(places), "beacon")
    return f"the distances to {beacons}{where} WHEN with a standard deviation of {noise}{_place(sensor)}"


def _yaw_rate(sensor: Sensor) -> str:
    bias = " and no bias" if sensor.get("bias") == "known" else ""
    return f"the yaw rate WHEN with a standard deviation of {given_text(sensor['noise'], 'rad/s')}{bias}"


def _place(sensor: Sensor) -> str:
    arm = sensor.get("lever_arm") or {}
    sides = (("ahead of", "behind", "x"), ("to the left of", "to the right of", "y"))
    parts = [
        f"{given_text(abs(arm[axis]), 'm')} {plus if arm[axis] > 0 else minus}"
        for plus, minus, axis in sides
        if arm.get(axis)
    ]
    return f", taken {listing(parts)} the robot's origin" if parts else ""


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
        groups.setdefault(name if last in STATE_UNITS else full, []).append(entry)
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
