"""Random choices of what is estimated of a system, what is known before, and what makes it good."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..oracle.experiments import Experiment, Trial, predicted
from .amounts import TIME, Amount
from .criteria import subset
from .quantities import log_uniform, one_of, plain
from .systems import Draft
from .trials import draw_trial

Rng = np.random.Generator
Array = np.ndarray[Any, Any]

FEW = 4
"""Parameters that are estimated mostly: of more, combinations are seldom known well."""


SEEN = 0.9
"""Share of studies that estimate nothing which changes no reading."""


def draw_asked(rng: Rng, draft: Draft, study: dict[str, Any], changes: Array) -> dict[str, Any]:
    """Estimate, criterion and prior; `changes` (p,) are those of the readings by each parameter."""
    names = estimated = list(study["system"]["parameters"])
    found: dict[str, Any] = {}
    seen = [name for name, change in zip(names, changes, strict=True) if change > 0]
    if len(names) > FEW or rng.random() < 0.5:
        own = seen if seen and rng.random() < SEEN else names
        estimated = subset(rng, own)[: FEW if rng.random() < 0.9 else None]
        found["estimate"] = estimated
    found["criterion"] = _criterion(rng, draft, study, estimated)
    if rng.random() < 0.25:
        found["prior"] = _prior(rng, draft, estimated)
    return found


def _criterion(rng: Rng, draft: Draft, study: dict[str, Any], estimated: list[str]) -> dict[str, Any]:
    kinds = ("E", "E", "D", "D", "A", "G", "I") + (() if "weights" in study else ("modified_E",))
    judged = subset(rng, estimated) if rng.random() < 0.25 else estimated
    found: dict[str, Any] = {"kind": one_of(rng, kinds)}
    if len(judged) < len(estimated):
        found["subset"] = judged
    sort = rng.random()
    if sort < 0.2:
        found["scaling"] = "none"
    elif sort < 0.4:
        found["scaling"] = {name: _size(rng, draft, name, log_uniform(rng, 0.1, 10)) for name in judged}
    if found["kind"] not in "GI":
        return found
    asked = {**found, **_predictions(rng, draft, found["kind"])} if draft.states else {}
    if asked and _changed({**study, "estimate": estimated, "criterion": plain(asked)}, rng):
        return asked
    return {**found, "kind": "E"}


def _size(rng: Rng, draft: Draft, name: str, share: float) -> Any:
    # Of plain numbers bare: shares would be of the nominal value.
    own = draft.parameters[name]
    return Amount(abs(own) * share, own.dimension) if own.dimension else float(abs(own) * share)


def _predictions(rng: Rng, draft: Draft, kind: str) -> dict[str, Any]:
    def inputs() -> list[float]:
        return [float(draft.sizes[name] * rng.uniform(0.9, 1.1)) for name in draft.inputs]

    found = {"quantity": one_of(rng, draft.states)}
    length = draft.time * log_uniform(rng, 0.05, 0.5)
    if draft.inputs and kind == "I" and rng.random() < 0.5:
        start = [float(draft.sizes[name] * rng.uniform(0.5, 2)) for name in draft.states]
        task: dict[str, Any] = {
            "inputs": [inputs() for _ in range(int(rng.integers(1, 6)))],
            "period": Amount(length, TIME),
        }
        return {**found, "task": [{**task, "start": start} if rng.random() < 0.8 else task]}
    legs = [{"inputs": inputs(), "duration": Amount(length, TIME)} for _ in range(int(rng.integers(1, 4)))]
    return {**found, "test_drive": legs}


def _changed(study: dict[str, Any], rng: Rng) -> bool:
    # Whether what is predicted depends on what is judged, and can be said.
    if not study["system"].get("inputs"):
        return False
    with np.errstate(all="ignore"):
        try:
            rows = _predicted(study, draw_trial(rng, study))
        except ArithmeticError:
            return False
    return bool(np.isfinite(rows).all() and np.any(rows))


def _predicted(study: dict[str, Any], trial: Trial) -> Array:
    return predicted(study, Experiment(study, trial).estimate(), trial.period)


def _prior(rng: Rng, draft: Draft, estimated: list[str]) -> dict[str, Any]:
    names = subset(rng, estimated)
    if rng.random() < 0.6:
        each = {}
        for name in names:
            share = log_uniform(rng, 1e-2, 0.5)
            each[name] = {"share": share} if rng.random() < 0.5 else _size(rng, draft, name, share)
        return {"standard_deviations": each}
    sizes = np.array([abs(draft.parameters[name]) * log_uniform(rng, 1e-2, 0.5) for name in names])
    mixed = np.eye(len(names)) + 0.3 * rng.standard_normal((len(names), len(names)))
    matrix = mixed @ mixed.T * np.outer(sizes, sizes)
    return {"parameters": names, "covariance": ((matrix + matrix.T) / 2).tolist()}


def written_shares(keys: Mapping[str, Any]) -> dict[str, Any]:
    """The study's keys with shares of a prior as a study writes them."""
    prior = keys.get("prior", {})
    if "standard_deviations" not in prior:
        return dict(keys)
    each = {
        name: f"{100 * one['share']!r} %" if isinstance(one, Mapping) else one
        for name, one in prior["standard_deviations"].items()
    }
    return {**keys, "prior": {"standard_deviations": each}}
