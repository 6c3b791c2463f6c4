"""Criteria, from the roots of the information: E, D, A, modified E, G and I, larger is better."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from .information import Told
from .motion import drive
from .readings import STEP, displaced
from .robots import Robot

Array = npt.NDArray[Any]


def value(kind: str, told: Sequence[Told], predictions: Sequence[Array] = ()) -> float:
    """The criterion of all blocks together; `predictions` are the derivatives (legs, coordinates, p) that G
    and I judge, one array for each block.
    """
    spectra = [one.eigenvalues for one in told]
    if kind == "E":
        return float(min(one[-1] for one in spectra))
    if kind == "D":
        return float(sum(np.log(one).sum() for one in spectra))
    if kind == "A":
        return float(-sum((1 / one).sum() for one in spectra))
    if kind == "modified_E":
        return float(-max(one[0] / one[-1] for one in spectra))
    variances = sum(_variances(one, rows) for one, rows in zip(told, predictions, strict=True))
    return float(-np.max(variances) if kind == "G" else -np.mean(variances))


def _variances(told: Told, rows: Array) -> Array:
    # tr(J F^-1 J') of every leg, with F = R'R, by R' X = J'.
    legs, coordinates, size = rows.shape
    solved = np.linalg.solve(told.root.T, rows.reshape(-1, size).T)
    return (solved**2).sum(axis=0).reshape(legs, coordinates).sum(axis=1)


def predicted(robot: Robot, criterion: Mapping[str, Any], longest: float) -> Array:
    """Derivatives (legs, coordinates, p) of the poses that a test drive ends its legs at, by the parameters,
    or that drives of a task have at the ends of all their periods.

    Each leg or period is driven in equal arcs of at most `longest` [s], the first from a known pose.
    """
    if "task" in criterion:
        return np.concatenate([_along(robot, criterion, one, longest) for one in criterion["task"]])
    copies = 1 + len(robot.values)
    p = displaced(robot.values, 1, copies)
    state = [np.zeros((copies, 1), dtype=complex) for _ in robot.states]
    found = []
    for leg in criterion["test_drive"]:
        count = steps_of(leg["duration"], longest)
        held = np.array([leg["inputs"]] * count, dtype=float)
        motion = drive(robot, held, state, p, float(leg["duration"]) / count, "arc")
        state = [one[:, -1:] for one in motion.states]
        slopes = [np.imag(one[1:, 0]) / STEP for one in state[:3]]
        found.append(slopes[:2] if criterion.get("quantity", "position") == "position" else slopes[2:])
    return np.array(found)


def steps_of(duration: float, longest: float) -> int:
    """How many equal steps of at most `longest` [s] a leg is driven in."""
    return max(math.ceil(float(duration) / longest - 1e-9), 1)


def _along(robot: Robot, criterion: Mapping[str, Any], task: Mapping[str, Any], longest: float) -> Array:
    copies = 1 + len(robot.values)
    start = [np.zeros((copies, 1), dtype=complex) for _ in robot.states]
    count = steps_of(task["period"], longest)
    held = np.repeat(np.array(task["inputs"], dtype=float), count, axis=0)
    p = displaced(robot.values, 1, copies)
    motion = drive(robot, held, start, p, float(task["period"]) / count, "arc")
    # (p, N) by coordinate, each period's end a leg.
    slopes = np.array([np.imag(one[1:, count::count]) / STEP for one in motion.states[:3]])
    chosen = slopes[:2] if criterion.get("quantity", "position") == "position" else slopes[2:]
    return chosen.transpose(2, 0, 1)
