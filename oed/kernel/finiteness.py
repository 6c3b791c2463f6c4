"""Drives whose numbers are no numbers: what is not finite of them first, and when."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from oed.foundation.arrays import Array, Bools
from oed.foundation.errors import Issue, NotFinite, TooLarge
from oed.foundation.quantities import LARGEST
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.parts import taken_of
from oed.kernel.problem import Problem

FARTHEST = 1e100
"""Largest magnitude of readings and derivatives in units of the noise, whose squares are finite."""


def require_driven(problem: Problem, trajectory: Trajectory, path: Array) -> None:
    """Refuse a drive that cannot be scored, or goes farther than anything that a study may speak of.

    Args:
        problem: problem that scores it.
        trajectory: the drive.
        path: states of the drive, all runs at the same times, (rows, states).

    Raises:
        NotFinite: says what is not finite, or beyond `LARGEST`, and when.
    """
    for inside, text in ((np.isfinite(path), "not finite"), (np.abs(path) <= LARGEST, f"beyond {LARGEST:g}")):
        if not inside.all():
            raise NotFinite(Issue((problem.model.noun,), _departure(problem, trajectory, inside, text)))


def require_measured(
    problem: Problem, trajectory: Trajectory, responses: Sequence[Array], derivatives: Sequence[Array]
) -> None:
    """Refuse a drive whose readings, or what they say, cannot be scored.

    Args:
        problem: problem that scores it.
        trajectory: the drive.
        responses: responses of each block of readings, (M,) or (M, 1).
        derivatives: derivatives of the responses by what is estimated, (M, p).

    Raises:
        NotFinite: says what is not finite, or beyond `FARTHEST` (`TooLarge`), and when.
    """
    pairs = [("reading", array) for array in responses] + [("derivative", array) for array in derivatives]
    for quantity, array in pairs:
        for inside, text, error in (
            (np.isfinite(array), "not finite", NotFinite),
            (np.abs(array) <= FARTHEST, f"beyond {FARTHEST:g} in units of the noise", TooLarge),
        ):
            rows = np.flatnonzero(~np.atleast_2d(inside.T).all(axis=0))
            if rows.size:
                place = _reading(problem, trajectory, int(rows[0]), len(array))
                columns = np.flatnonzero(~inside[rows[0]]).tolist() if quantity == "derivative" else []
                raise error(Issue(("measurement",), _sentence(problem, quantity, place, columns, text)))


def _departure(problem: Problem, trajectory: Trajectory, inside: Bools, text: str) -> str:
    # The earliest moment of any run.
    rows = np.array(np.split(inside, trajectory.runs))
    moments = np.flatnonzero(~rows.all(axis=(0, 2)))
    states = np.atleast_1d(~rows[:, moments[0]].all(axis=0))
    names = ", ".join(name for name, wrong in zip(problem.system.states, states, strict=True) if wrong)
    duration = trajectory.duration / trajectory.runs
    when = f"{names}: {text} from {moments[0] / (rows.shape[1] - 1) * duration:.6g} s on"
    return when + _advice(problem)


def _advice(problem: Problem) -> str:
    advice = problem.model.when_not_finite
    return f"; {advice}" if advice else ""


def _reading(problem: Problem, trajectory: Trajectory, row: int, count: int) -> str:
    parts = taken_of(problem.sensors, problem.system, trajectory)
    if len(parts.places) != count:
        return f"{problem.measurement.kind} (reading {row})"
    reading = parts.readings[parts.places[row]]
    run = f" of run {reading.run + 1}" if trajectory.runs > 1 else ""
    return f"{reading.sensor} at {reading.time:.6g} s{run}"


def _sentence(problem: Problem, quantity: str, place: str, columns: Sequence[int], text: str) -> str:
    if quantity == "reading":
        return f"the reading of {place} is {text}{_advice(problem)}"
    block = problem.any_estimations[0].block
    names = [*block.parameters, *(nuisance.name for nuisance in block.nuisances)]
    wrong = [names[column] for column in columns if column < len(names)]
    return f"the derivative of {place} by {', '.join(wrong) or 'what is estimated'} is {text}"
