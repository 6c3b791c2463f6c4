"""Random valid studies of experiments with systems given by equations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
import yaml

from ..oracle.experiments import Experiment
from .amounts import TIME, Amount, Deviation, product
from .asked import draw_asked, written_shares
from .bounded import draw_limits
from .quantities import log_uniform, one_of, plain, written
from .selections import draw_selection
from .systems import Draft, draw_system, written_system
from .trials import draw_trial

Rng = np.random.Generator
Array = np.ndarray[Any, Any]

LARGEST = 1e3
"""Of a state, in units of what it was drawn to be: what grows more is drawn anew."""
HALF = Fraction(1, 2)
DRAWS = 50
"""Systems drawn at most before one stays bounded."""


@dataclass(frozen=True)
class ExperimentStudy:
    """A random study.

    Attributes:
        spec: its keys, SI, as the oracle reads them.
        given: the same, as a study writes them.
    """

    spec: dict[str, Any]
    given: dict[str, Any]

    def text(self, rng: Rng) -> str:
        """The YAML, in units drawn at random."""
        return yaml.safe_dump(written(self.given, rng), sort_keys=False, allow_unicode=True)


def draw_experiment_study(rng: Rng) -> ExperimentStudy:
    """A valid study."""
    for _ in range(DRAWS):
        draft = draw_system(rng)
        experiment = _draw_experiment(rng, draft)
        begins = _begins(rng, draft, chosen="candidates" not in experiment)
        keys = {"system": written_system(draft, begins), "experiment": experiment}
        reference = _reference(rng, draft, plain(keys))
        if reference is not None:
            break
    else:
        raise ArithmeticError(f"none of {DRAWS} systems stays bounded")
    keys["measurement"] = _measurement(rng, draft, reference)
    keys |= draw_selection(rng, plain(keys), reference.trial)
    first = Experiment(ranged(plain(keys)), reference.trial)
    limits = draw_limits(rng, draft, first)
    keys |= {"limits": limits} if limits else {}
    changes = np.linalg.norm(np.concatenate([one.slopes for one in first.rows]), axis=0)
    keys |= draw_asked(rng, draft, ranged(plain(keys)), changes[: len(keys["system"]["parameters"])])
    given = {"format": 1, "name": "Campaign experiment", **written_shares(keys)}
    return ExperimentStudy(ranged(plain(keys)), given)


def _begins(rng: Rng, draft: Draft, *, chosen: bool) -> dict[str, Any]:
    # Candidates leave nothing else to choose.
    found, sort = {}, one_of(rng, ("fixed", "fixed", "design" if chosen else "fixed", "unknown"))
    for name in draft.states:
        low = 0.2 if draft.positive else -2.0
        value, other = (draft.sizes[name] * rng.uniform(low, 2) for _ in range(2))
        own = draft.dims[name]
        found[name] = Amount(value, own)
        if sort == "design" and rng.random() < 0.6:
            found[name] = {"design": [Amount(min(value, other), own), Amount(max(value, other), own)]}
        elif sort == "unknown" and rng.random() < 0.6:
            found[name] = {"unknown": Amount(value, own)}
            if rng.random() < 0.7:
                found[name]["deviation"] = Amount(draft.sizes[name] * log_uniform(rng, 1e-3, 0.3), own)
    return found


def _draw_experiment(rng: Rng, draft: Draft) -> dict[str, Any]:
    samples = int(log_uniform(rng, 3, 13 if draft.stiff or draft.algebraic else 33))
    if not draft.states:
        if rng.random() < 0.4:
            return {"candidates": _candidates(rng, draft, 40)}
        points = int(log_uniform(rng, 2, 25))
        return {"points": points, "inputs": _inputs(rng, draft, points, 0.0)}
    whole = draft.time * log_uniform(rng, 1.0, 8.0)
    found: dict[str, Any] = {"duration": Amount(whole, TIME), "samples": samples}
    if draft.inputs and rng.random() < 0.15:
        return {**found, "candidates": _candidates(rng, draft, 12)}
    chosen = bool(draft.inputs) and rng.random() < 0.12
    if chosen:
        found["duration"] = [Amount(whole * rng.uniform(0.3, 0.8), TIME), Amount(whole, TIME)]
    if rng.random() < 0.35:
        found["trials"] = int(rng.integers(1, 4))
    if draft.inputs:
        found["inputs"] = _inputs(rng, draft, samples, 0.0 if chosen else whole / samples)
    return found


def _range(rng: Rng, draft: Draft, name: str) -> tuple[float, float]:
    size = draft.sizes[name]
    if size == 300.0:
        return 280.0, 320.0
    low = (
        float(one_of(rng, (0.0, 0.2, 0.5))) if draft.positive else float(one_of(rng, (-1.0, -0.3, 0.0, 0.4)))
    )
    return low * size, size * rng.uniform(0.8, 2.0)


def _inputs(rng: Rng, draft: Draft, samples: int, period: float) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name in draft.inputs:
        low, high = _range(rng, draft, name)
        own = draft.dims[name]
        keys: dict[str, Any] = {"range": [Amount(low, own), Amount(high, own)]}
        if period and rng.random() < 0.2:
            most = (high - low) / period * log_uniform(rng, 0.2, 3)
            rate = product(own, TIME, -1)
            keys["rate"] = (
                Amount(most, rate) if rng.random() < 0.7 else [Amount(-most, rate), Amount(0.7 * most, rate)]
            )
        if rng.random() < 0.7:
            keys["signal"] = _signal(rng, samples, low <= 0 <= high, period)
        found[name] = keys if len(keys) > 1 or rng.random() < 0.3 else keys["range"]
    return found


def _signal(rng: Rng, samples: int, rest: bool, period: float) -> dict[str, Any]:
    kinds = ["constant", "piecewise_constant", "piecewise_linear", "spline", "fourier"]
    kind = one_of(rng, kinds[: 2 + 2 * (samples >= 3) + (samples >= 4)])
    found: dict[str, Any] = {"kind": kind}
    if kind == "piecewise_constant":
        found["pieces"] = int(rng.integers(1, samples + 1))
    elif kind == "piecewise_linear":
        found["pieces"] = int(rng.integers(1, samples))
    elif kind == "spline":
        still = bool(rest and rng.random() < 0.4)
        extra = 3 if still else 1
        degree = int(rng.integers(0, min(6, samples - 2) + 1))
        count = int(rng.integers(degree + extra, max(samples, degree + extra) + 1))
        found |= {"degree": degree, "coefficients": min(count, samples + 2 * still)}
        found |= {"rest_to_rest": True} if still else {}
    elif kind == "fourier":
        found["harmonics"] = int(rng.integers(1, max(2, (samples + 1) // 2)))
        if period and rng.random() < 0.3:
            found["period"] = Amount(period * samples * rng.uniform(1.01, 2), TIME)
    if rng.random() < 0.2:
        found["shared"] = True
    return found


def _candidates(rng: Rng, draft: Draft, most: int) -> dict[str, Any]:
    count = int(rng.integers(3, most))
    ranges = {name: _range(rng, draft, name) for name in draft.inputs}
    if rng.random() < 0.5:
        return {
            "rows": {
                name: [Amount(float(one), draft.dims[name]) for one in rng.uniform(*ends, count)]
                for name, ends in ranges.items()
            }
        }
    each = max(2, int(count ** (1 / len(ranges))))
    grid: dict[str, Any] = {}
    for name, (low, high) in ranges.items():
        own = draft.dims[name]
        grid[name] = {"least": Amount(low, own), "largest": Amount(high, own), "count": each}
        if rng.random() < 0.3:
            grid[name] = [Amount(float(one), own) for one in np.sort(rng.uniform(low, high, each))]
    return {"grid": grid}


def ranged(study: dict[str, Any]) -> dict[str, Any]:
    """The study with ranges that stand alone as keys."""
    inputs = study["experiment"].get("inputs", {})
    keyed = {name: one if isinstance(one, Mapping) else {"range": one} for name, one in inputs.items()}
    return {**study, "experiment": {**study["experiment"], **({"inputs": keyed} if inputs else {})}}


def _reference(rng: Rng, draft: Draft, study: dict[str, Any]) -> Experiment | None:
    # A first trial, followed; None where it leaves all bounds.
    study = ranged(study)
    trial = draw_trial(rng, study)
    kind = "outputs" if draft.states else "responses"
    measurement = {"kind": kind, "noise": dict.fromkeys(draft.outputs, 1.0)}
    with np.errstate(all="ignore"):
        try:
            found = Experiment({**study, "measurement": measurement}, trial)
            states, seen = found.states, found.rows[0].response
        except ArithmeticError:
            return None
    sizes = np.array([draft.sizes[name] for name in draft.states])[:, None, None, None]
    bounded = np.all(np.abs(states) < LARGEST * sizes) and np.isfinite(found.rows[0].slopes).all()
    return found if bounded and np.isfinite(seen).all() else None


def _measurement(rng: Rng, draft: Draft, reference: Experiment) -> Any:
    names, table = list(draft.outputs), reference.rows[0].response.reshape(-1, len(draft.outputs))
    sizes = dict(zip(names, np.sqrt((table**2).mean(axis=0)), strict=True))
    sensors = []
    for _ in range(int(one_of(rng, (1, 1, 1, 2)))):
        kind = one_of(rng, ("outputs", "outputs", "rates")) if draft.states else "responses"
        own = [names[place] for place in rng.permutation(len(names))[: int(rng.integers(1, len(names) + 1))]]
        noise = {}
        for name in own:
            size = (float(sizes[name]) or 1.0) * log_uniform(rng, 1e-3, 0.1)
            # Of what is read all the time the mean of a second counts.
            size *= reference.trial.period**0.5 if kind == "rates" else 1.0
            noise[name] = Deviation(size, draft.output_dims[name])
        sensor: dict[str, Any] = {"kind": kind, "noise": noise}
        if rng.random() < 0.25:
            sensor["every"] = int(rng.integers(1, 4))
        sensors.append(sensor)
    if len(sensors) == 1 and sensors[0]["kind"] == "outputs":
        _wander(rng, draft, sensors[0], reference)
    return sensors if len(sensors) > 1 or rng.random() < 0.1 else sensors[0]


def _wander(rng: Rng, draft: Draft, sensor: dict[str, Any], reference: Experiment) -> None:
    # What is said of starts and of states that do not quite as they should.
    begins = reference.study["system"]["states"].values()
    if rng.random() < 0.1 and not any(isinstance(one, Mapping) and "unknown" in one for one in begins):
        sensor["start"] = "unknown"
    if rng.random() < 0.15:
        own = [name for name in draft.states if rng.random() < 0.6] or draft.states[:1]
        share = log_uniform(rng, 1e-3, 0.1) / reference.trial.duration**0.5
        sensor["diffusion"] = {
            name: Amount(share * draft.sizes[name], product(draft.dims[name], TIME, -HALF)) for name in own
        }
