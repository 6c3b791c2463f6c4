"""Random limits on expressions of what a system does, about what it does in a first trial."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..oracle.experiments import Experiment, sensors_of
from .amounts import TIME, Amount, Dimension, product
from .quantities import one_of
from .systems import Draft

Rng = np.random.Generator
Array = np.ndarray[Any, Any]

RESOLVED = 1e-3
"""Share of an integral by which shorter steps may change it."""


def draw_limits(rng: Rng, draft: Draft, reference: Experiment) -> list[dict[str, Any]]:
    """Of all kinds, mostly few."""
    found = []
    for place in range(int(one_of(rng, (0, 0, 1, 1, 2)))):
        kind = one_of(rng, ("always", "end", "budget")) if draft.states else "budget"
        text, own = _expression(rng, draft, budget=kind == "budget")
        limit: dict[str, Any] = {"kind": kind, "name": f"limit{place + 1}", "of": text}
        values = reference.limited(limit, 4)
        low, high = float(values.min()), float(values.max())
        if not np.isfinite([low, high]).all():
            continue
        spread = (high - low) or abs(high) or 1.0
        if kind == "budget" and not (_can_be_counted(reference) and _resolved(reference, limit, values)):
            continue
        if kind == "budget":
            own = product(own, TIME) if draft.states else own
            found.append({**limit, "most": Amount(high + abs(high or 1.0) * rng.uniform(-0.3, 0.5), own)})
        else:
            inside = -0.2 if high > low else 0.05
            least, most = low - spread * rng.uniform(inside, 0.5), high + spread * rng.uniform(inside, 0.5)
            found.append({**limit, "range": [Amount(least, own), Amount(most, own)]})
    return found


def _resolved(reference: Experiment, limit: dict[str, Any], values: Array) -> bool:
    # Whether steps of the integration are short enough for an integral: of what is over within one, it is not
    # known.
    system = {**reference.study["system"], "substeps": 2 * reference.system.substeps}
    finer = Experiment({**reference.study, "system": system}, reference.trial).limited(limit, 4)
    return bool(np.all(np.abs(finer - values) <= RESOLVED * np.abs(values)))


def _can_be_counted(reference: Experiment) -> bool:
    # Whether a budget goes with the study's weights, if it has any.
    study = reference.study
    chosen, states = study.get("weights"), reference.system.states
    if chosen is None:
        return True
    if "readings" in chosen or not (states or len(sensors_of(study)) == 1):
        return False
    return chosen.get("of") == "trials" or not states or "candidates" not in study["experiment"]


def _expression(rng: Rng, draft: Draft, *, budget: bool) -> tuple[str, Dimension]:
    names = [*draft.states, *(draft.inputs if budget else ())]
    name = one_of(rng, names)
    own, sort = draft.dims[name], rng.random()
    alike = [one for one, of in draft.parameters.items() if of.dimension == own]
    if sort < 0.2:
        return f"{name}^2", product(own, own)
    if sort < 0.4 and alike:
        return f"{name} - {one_of(rng, alike)}", own
    if sort < 0.6:
        other = one_of(rng, names)
        return f"{name} * {other}", product(own, draft.dims[other])
    return name, own
