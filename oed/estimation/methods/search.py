"""Least squares by Gauss-Newton steps, halved where they make the misfit worse."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from oed.estimation.methods.joint import HALVINGS, NEAR, STEPS
from oed.estimation.methods.knowledge import Knowledge, inverse_of_sum

Array = npt.NDArray[np.float64]

CLOSE = 1e-7
"""Change of the unknowns, in units of their size, at which the search has arrived."""
WORSE = 1e-12
"""By how much rounding may make a misfit worse, relative to it."""

Rows = Callable[[Array], tuple[Array, Array]]
"""Of unknowns (q,): residuals in units of their noise (rows,), measured less predicted, and the derivatives
of what is predicted (rows, q)."""


@dataclass(frozen=True)
class _Point:
    values: Array
    residuals: Array
    slopes: Array
    misfit: float


def solved(rows: Rows, start: Array, scale: Array, known: Knowledge, clocks: int = 0) -> tuple[Array, bool]:
    """The unknowns (q,) of least squares, and whether the search has arrived.

    Args:
        rows: of unknowns.
        start: where the search begins.
        scale: sizes of the unknowns.
        known: of them from before.
        clocks: how many of the last are clock offsets. Motion is piecewise linear in these, and the least
            squares may lie in a corner: the search then goes on with the others.
    """
    point, free = _point(rows, start, known), np.ones(len(start), dtype=bool)
    for _ in range(STEPS):
        step, inverse = _step(point, known, free)
        following = _following(rows, point, known, step)
        # Where no part of a step makes it better, the search has arrived only if the step is of no size.
        if following is point and not np.all(np.abs(step) <= NEAR * np.sqrt(np.diag(inverse))):
            if not clocks or not free.all():
                return point.values, False
            free[len(start) - clocks :] = False
            continue
        if following is point:
            return point.values, True
        change = float((np.abs(following.values - point.values) / scale).max(initial=0.0))
        point = following
        if change < CLOSE:
            return point.values, True
    return point.values, False


def _point(rows: Rows, values: Array, known: Knowledge) -> _Point:
    residuals, slopes = rows(values)
    return _Point(values, residuals, slopes, float(residuals @ residuals) + known.misfit(values))


def _step(point: _Point, known: Knowledge, free: npt.NDArray[np.bool_]) -> tuple[Array, Array]:
    # Of the free unknowns, the others held; and the inverse of their information.
    gradient = point.slopes.T @ point.residuals + known.score(point.values)
    own = np.ix_(free, free)
    inverse = np.zeros((len(free),) * 2)
    inverse[own] = inverse_of_sum((point.slopes.T @ point.slopes)[own], known.information[own])
    return inverse @ gradient, inverse


def _following(rows: Rows, point: _Point, known: Knowledge, step: Array) -> _Point:
    for halving in range(HALVINGS):
        tried = _point(rows, point.values + 0.5**halving * step, known)
        if tried.misfit <= point.misfit * (1 + WORSE):
            return tried
    return point
