"""Random experiments within a study, by the study's own keys."""

from __future__ import annotations

from collections.abc import Mapping
from math import gcd
from typing import Any

import numpy as np

from ..oracle.experiments import Trial, sensors_of
from ..oracle.signals import held, unknowns_of

Rng = np.random.Generator
Array = np.ndarray[Any, Any]

FARTHER, BY = 0.25, 1.2
"""Share of trials whose inputs may leave their ranges, upwards by a fifth."""


def settings_of(study: Mapping[str, Any]) -> Array:
    """The rows of a study's candidates, (n, inputs)."""
    candidates, names = study["experiment"]["candidates"], study["system"]["inputs"]
    if "rows" in candidates:
        return np.array([candidates["rows"][name] for name in names]).T
    axes = []
    for name in names:
        one = candidates["grid"][name]
        axes.append(
            np.linspace(one["least"], one["largest"], one["count"]) if isinstance(one, Mapping) else one
        )
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))


def signals_of(study: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """What every input of a study does, usual ones filled in."""
    experiment = study["experiment"]
    samples = samples_of(study)
    pieces = samples if "points" in experiment else min(samples, 20)
    usual = {"kind": "piecewise_constant", "pieces": pieces}
    return {
        name: experiment["inputs"][name].get("signal", usual) for name in study["system"].get("inputs", {})
    }


def samples_of(study: Mapping[str, Any]) -> int:
    """Of one trial."""
    experiment = study["experiment"]
    return int(experiment.get("points") or experiment.get("samples", 100))


def draw_unknowns(rng: Rng, signal: Mapping[str, Any], low: float, high: float) -> Array:
    """Of a signal that stays in a range."""
    count = unknowns_of(signal)
    if signal["kind"] != "fourier":
        return rng.uniform(low, high, count)
    mean = rng.uniform(low, high)
    waves = rng.standard_normal(count - 1)
    most = np.hypot(*np.split(waves, 2)).sum()
    return np.concatenate([[mean], waves * rng.uniform(0, 1) * min(mean - low, high - mean) / most])


def draw_trial(rng: Rng, study: Mapping[str, Any]) -> Trial:
    """A random experiment."""
    starts, experiment = draw_starts(rng, study), study["experiment"]
    if "candidates" in experiment:
        settings = settings_of(study)
        if study["system"].get("states"):
            rows = np.repeat(settings[:, None], samples_of(study), axis=1)
            return Trial(rows, np.tile(starts[:1], (len(rows), 1)), experiment["duration"])
        return Trial(settings[None], np.zeros((1, 0)), float(len(settings)))
    samples, trials = samples_of(study), experiment.get("trials", 1)
    duration = experiment.get("duration", float(samples))
    whole = duration[1] if isinstance(duration, list) else duration
    table = np.zeros((trials, samples, len(study["system"].get("inputs", {}))))
    farther = rng.random() < FARTHER
    for place, (name, signal) in enumerate(signals_of(study).items()):
        low, high = experiment["inputs"][name]["range"]
        top = low + BY * (high - low) if farther else high
        draws = [draw_unknowns(rng, signal, low, top) for _ in range(trials)]
        for number in range(trials):
            own = draws[0 if signal.get("shared") else number]
            table[number, :, place] = held(signal, own, whole, samples)
    if isinstance(duration, list):
        duration = float(rng.uniform(*duration))
    return Trial(table, starts, float(duration))


def draw_starts(rng: Rng, study: Mapping[str, Any]) -> Array:
    """Of all trials, (trials, states)."""
    trials = study["experiment"].get("trials", 1)
    columns = []
    for one in study["system"].get("states", {}).values():
        if isinstance(one, Mapping) and "design" in one:
            columns.append(rng.uniform(*one["design"], trials))
        else:
            columns.append(np.full(trials, one["unknown"] if isinstance(one, Mapping) else one))
    return np.array(columns).T.reshape(trials, -1)


# --- weights ---


def readings_of(study: Mapping[str, Any], trial: Trial) -> list[tuple[int, int, float]]:
    """Of every reading its sensor, its trial, and how much of a budget it is."""
    found = []
    for place, sensor in enumerate(sensors_of(study)):
        last = trial.samples + (sensor["kind"] == "outputs")
        size = trial.period if sensor["kind"] == "rates" else 1.0
        count = len(range(0, last, sensor.get("every", 1)))
        found += [(place, number, size) for number in range(trial.trials) for _ in range(count)]
    return found


def groups_of(study: Mapping[str, Any], trial: Trial) -> list[list[int]]:
    """Places of readings with one weight each."""
    chosen, each = study["weights"], readings_of(study, trial)
    by = dict[Any, list[int]]()
    for place, (sensor, number, _) in enumerate(each):
        by.setdefault(number if chosen.get("of") == "trials" else (sensor, number), []).append(place)
    if chosen.get("of") == "trials":
        return list(by.values())
    if "pieces" not in chosen:
        return [[place] for place in range(len(each))]
    return [list(one) for own in by.values() for one in np.reshape(own, (chosen["pieces"], -1))]


def divisor_of(counts: list[int]) -> int:
    """The greatest that all have."""
    return gcd(*counts)


def draw_weights(rng: Rng, study: Mapping[str, Any], trial: Trial) -> Array:
    """Random weights that take all of the budgets, whole ones where these are asked for; (n,)."""
    chosen, each = study["weights"], readings_of(study, trial)
    groups, most = groups_of(study, trial), float(chosen.get("most", 1.0))
    total = chosen.get("total", chosen.get("readings"))
    parts = {0: list(range(len(groups)))}
    if isinstance(total, Mapping):
        parts = {}
        for place, own in enumerate(groups):
            parts.setdefault(each[own[0]][0], []).append(place)
    totals = list(total.values()) if isinstance(total, Mapping) else [total]
    by_trial = chosen.get("of") == "trials"
    sizes = np.array([1.0 if by_trial else sum(each[place][2] for place in own) for own in groups])
    found = np.zeros(len(each))
    for own, amount in zip(parts.values(), totals, strict=True):
        take = _whole if "readings" in chosen else _shares
        for place, weight in zip(own, take(rng, sizes[own], float(amount), most), strict=True):
            found[groups[place]] = weight
    return found


def _whole(rng: Rng, sizes: Array, amount: float, most: float) -> Array:
    places = np.repeat(np.arange(len(sizes)), round(most))
    picked = rng.permutation(places)[: round(amount / sizes[0])]
    return np.bincount(picked, minlength=len(sizes)).astype(float)


def _shares(rng: Rng, sizes: Array, amount: float, most: float) -> Array:
    # The budget is filled from random shares by raising those that are not full.
    weights = np.minimum(rng.exponential(size=len(sizes)) ** 2, 1.0) * most
    spent = weights @ sizes
    if spent > amount:
        return weights * amount / spent
    room = (most - weights) @ sizes
    return weights + (most - weights) * ((amount - spent) / room if room > 0 else 0.0)
