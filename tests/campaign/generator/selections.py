"""Random choices among readings: weights with totals, by sensor, in pieces, of whole trials, whole ones."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..oracle.experiments import Trial, sensors_of
from .amounts import TIME, Amount
from .quantities import one_of
from .trials import divisor_of, readings_of

Rng = np.random.Generator

WEIGHED = 0.35
"""Share of studies with weights; of those with candidates twice as many."""


def draw_selection(rng: Rng, study: Mapping[str, Any], trial: Trial) -> dict[str, Any]:
    """The key `weights`, or nothing."""
    sensors = sensors_of(study)
    share = WEIGHED * (2 if "candidates" in study["experiment"] else 1)
    if (
        rng.random() > share
        or "diffusion" in sensors[0]
        or isinstance(study["experiment"].get("duration"), list)
    ):
        return {}
    each = readings_of(study, trial)
    counts = [sum(one[:2] == key for one in each) for key in dict.fromkeys(one[:2] for one in each)]
    found: dict[str, Any] = {}
    if trial.trials > 1 and rng.random() < 0.4:
        found["of"] = "trials"
    elif rng.random() < 0.3:
        common = divisor_of(counts)
        found["pieces"] = int(one_of(rng, [one for one in range(1, common + 1) if common % one == 0]))
    most = 1.0
    if rng.random() < 0.3:
        found["most"] = most = float(one_of(rng, (2, 3)))
    whole = found.get("of") == "trials" or all(sensor["kind"] != "rates" for sensor in sensors)
    if whole and rng.random() < 0.5:
        return {"weights": {**found, **_whole(rng, found, counts, trial.trials, most)}}
    return {"weights": {**found, "total": _total(rng, found, study, each, most, trial.trials)}}


def _whole(rng: Rng, found: Mapping[str, Any], counts: list[int], trials: int, most: float) -> dict[str, Any]:
    if found.get("of") == "trials":
        return {"readings": int(rng.integers(1, int(trials * most) + 1))}
    size = 1
    if "pieces" in found:
        each = {count // found["pieces"] for count in counts}
        if len(each) > 1:
            return {"total": float(rng.uniform(0.2, 0.9) * most * sum(counts))}
        (size,) = each
    return {"readings": size * int(rng.integers(1, int(sum(counts) * most) // size + 1))}


def _total(
    rng: Rng, found: Mapping[str, Any], study: Mapping[str, Any], each: list[Any], most: float, trials: int
) -> Any:
    def share(capacity: float, lasting: bool) -> Any:
        amount = float(capacity * most * rng.uniform(0.1, 0.95))
        return Amount(amount, TIME) if lasting and rng.random() < 0.7 else amount

    if found.get("of") == "trials":
        return share(trials, lasting=False)
    sensors = sensors_of(study)
    lasting = all(sensor["kind"] == "rates" for sensor in sensors)
    if len(sensors) == 1 or rng.random() < 0.5:
        return share(sum(one[2] for one in each), lasting)
    names: list[str] = []
    for sensor in sensors:
        before = sum(one.split("_")[0] == sensor["kind"] for one in names)
        names.append(f"{sensor['kind']}_{before + 1}" if before else sensor["kind"])
    return {
        name: share(sum(one[2] for one in each if one[0] == place), sensors[place]["kind"] == "rates")
        for place, name in enumerate(names)
    }
