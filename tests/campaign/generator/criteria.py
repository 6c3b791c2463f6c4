"""Random choices of what is estimated, what is known beforehand, and what makes a drive good."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..oracle.readings import Block
from ..oracle.robots import Robot
from .quantities import Quantity, log_uniform, one_of

Rng = np.random.Generator


def draw_estimate(rng: Rng, robot: Robot, measurement: Any) -> list[str] | None:
    """Parameters to estimate, None for all."""
    if rng.random() < 0.5:
        return None
    coefficients = [name for row in robot.coefficient_rows for name in row]
    if isinstance(measurement, Mapping) and measurement["kind"] == "displacements":
        regressor = measurement["regressor"]
        own = {"heading": robot.coefficient_rows[0], "both": coefficients}
        names = list(own.get(regressor, [name for row in robot.coefficient_rows[1:] for name in row]))
    else:
        names = coefficients if coefficients and rng.random() < 0.5 else list(robot.names)
    return subset(rng, names)


def subset(rng: Rng, names: Sequence[str]) -> list[str]:
    """Some of the names, at least one, in any order."""
    count = int(rng.integers(1, len(names) + 1))
    return [names[place] for place in rng.permutation(len(names))[:count]]


def draw_criterion(
    rng: Rng, blocks: Sequence[Block], estimate: Sequence[str] | None, legs: tuple[int, float, float]
) -> dict[str, Any]:
    """A criterion of the estimated parameters; `legs`: inputs, their size, and the time of a test drive."""
    estimated = [name for block in blocks for name in block.names if estimate is None or name in estimate]
    judged = subset(rng, estimated) if rng.random() < 0.3 else estimated
    kind = one_of(rng, ("E", "E", "E", "D", "A", "modified_E", "G", "I"))
    found: dict[str, Any] = {"kind": kind}
    if len(judged) < len(estimated):
        found["subset"] = judged
    found["scaling"] = _scaling(rng, blocks, judged)
    if kind == "I" and rng.random() < 0.5:
        found |= _task(rng, *legs)
    elif kind in "GI":
        found |= _test_drive(rng, *legs)
    return found


def _scaling(rng: Rng, blocks: Sequence[Block], judged: Sequence[str]) -> Any:
    sizes = {
        name: float(size) for block in blocks for name, size in zip(block.names, block.sizes, strict=True)
    }
    sort = rng.random()
    if sort < 0.2:
        return "none"
    if sort < 0.35 or any(sizes[name] == 0 for name in judged):
        return {name: (sizes[name] or 1.0) * log_uniform(rng, 0.1, 10) for name in judged}
    return "relative"


def _test_drive(rng: Rng, inputs: int, size: float, time: float) -> dict[str, Any]:
    count = int(rng.integers(1, 4))
    legs = [
        {
            "inputs": [float(value) for value in 0.5 * size * rng.uniform(-1, 1, inputs)],
            "duration": Quantity(time * rng.uniform(0.1, 1), "s"),
        }
        for _ in range(count)
    ]
    return {"test_drive": legs, "quantity": one_of(rng, ("position", "heading"))}


def _task(rng: Rng, inputs: int, size: float, time: float) -> dict[str, Any]:
    drives = []
    for _ in range(int(rng.integers(1, 3))):
        periods = int(rng.integers(1, 12))
        held = 0.5 * size * rng.uniform(-1, 1, (periods, inputs))
        period = Quantity(time * rng.uniform(0.1, 1) / periods, "s")
        drives.append({"inputs": held.tolist(), "period": period})
    return {"task": drives, "quantity": one_of(rng, ("position", "heading"))}


def draw_prior(rng: Rng, blocks: Sequence[Block], estimate: Sequence[str] | None) -> dict[str, Any] | None:
    """What is known beforehand of some of the estimated parameters, mostly nothing."""
    if rng.random() < 0.7:
        return None
    values = {
        name: (float(value), float(size) or 1.0)
        for block in blocks
        for name, value, size in zip(block.names, block.nominal, block.sizes, strict=True)
        if estimate is None or name in estimate
    }
    names = subset(rng, list(values))
    if rng.random() < 0.6:
        return {"standard_deviations": {name: _deviation(rng, *values[name]) for name in names}}
    deviations = np.array([values[name][1] * log_uniform(rng, 1e-3, 0.1) for name in names])
    mixed = np.eye(len(names)) + 0.3 * rng.standard_normal((len(names), len(names)))
    matrix = mixed @ mixed.T * np.outer(deviations, deviations)
    return {"parameters": names, "covariance": ((matrix + matrix.T) / 2).tolist()}


def _deviation(rng: Rng, value: float, size: float) -> Any:
    share = log_uniform(rng, 1e-3, 0.1)
    return {"share": share} if value and rng.random() < 0.5 else share * size


def written_prior(prior: Mapping[str, Any]) -> dict[str, Any]:
    """A prior as a study writes it."""
    if "standard_deviations" not in prior:
        return dict(prior)
    given = prior["standard_deviations"]
    return {
        "standard_deviations": {
            name: f"{100 * value['share']!r} %" if isinstance(value, Mapping) else value
            for name, value in given.items()
        }
    }
