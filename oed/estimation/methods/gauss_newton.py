"""Least squares by Gauss-Newton steps, halved where they make the misfit worse."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, TypeVar

import numpy as np
import numpy.typing as npt

from oed.estimation.methods.knowledge import Knowledge
from oed.estimation.methods.losses import robust_loss
from oed.estimation.setup.options import Loss
from oed.kernel.measurement.square_root import SquareRoot

Array = npt.NDArray[np.float64]

STEPS = 40
"""Gauss-Newton steps at most."""
HALVINGS = 8
"""How often a step that makes the misfit worse is halved."""
NEAR = 0.05
"""Share of its standard error that an unknown may be off where no step makes the misfit smaller: motion is
piecewise linear in a clock's offset, and the least squares may lie in a corner."""
CLOSE = 1e-7
"""Change of the unknowns, in units of their size, at which the search has arrived."""
SURE = 1e-9
"""The same in units of their standard errors: whatever their size, more digits mean nothing."""
WORSE = 1e-12
"""By how much rounding may make a misfit worse, relative to it."""
FLAT = 0.1
"""Least curvature of a loss, relative to its weight, for it bends back beyond outliers. The parabola of its
weights lies above a loss, so that this share of a step at least leads downhill."""

Rows = Callable[[Array], tuple[Array, Array]]
"""Of unknowns (q,): residuals in units of their noise (rows,), measured less predicted, and the derivatives
of what is predicted (rows, q)."""


class HasMisfit(Protocol):
    """Where a search is."""

    @property
    def misfit(self) -> float:
        """What is to be made small."""


Place = TypeVar("Place", bound=HasMisfit)


def downhill(here: Place, after: Callable[[float], Place]) -> Place:
    """Where the longest step that makes the misfit no worse leads to; `here` itself if none does.

    Args:
        here: before the step.
        after: where a share of the step leads to.
    """
    for halving in range(HALVINGS):
        tried = after(0.5**halving)
        if tried.misfit <= here.misfit * (1 + WORSE):
            return tried
    return here


@dataclass(frozen=True)
class LeastSquares:
    """The search.

    Attributes:
        rows: of unknowns.
        scale: sizes of the unknowns, (q,).
        known: of them from before.
        loss: of a residual; other than "linear" it bounds the influence of outliers.
        clocks: how many of the last unknowns are clock offsets. Motion is piecewise linear in these, and the
            least squares may lie in a corner: the search then goes on with the others.
        close: change of the unknowns, in units of their size, at which the search has arrived.
    """

    rows: Rows
    scale: Array
    known: Knowledge
    loss: Loss = "linear"
    clocks: int = 0
    close: float = CLOSE

    def solved(self, start: Array) -> tuple[Array, bool]:
        """The unknowns (q,), and whether the search from `start` has arrived."""
        point, free = self._point(start), np.ones(len(start), dtype=bool)
        for _ in range(STEPS):
            step, errors, length = point.step(free)
            following = self._following(point, step)
            # Where no part of a step makes it better, the search has arrived only if the step is of no size.
            if following is point and np.all(np.abs(step) <= NEAR * errors):
                return point.values, True
            if following is point:
                if not self.clocks or not free.all():
                    return point.values, False
                free[len(start) - self.clocks :] = False
                continue
            change = float((np.abs(following.values - point.values) / self.scale).max(initial=0.0))
            point = following
            if change < self.close or length < SURE:
                return point.values, True
        return point.values, False

    def _following(self, point: _Point, step: Array) -> _Point:
        return downhill(point, lambda share: self._point(point.values + share * step))

    def _point(self, values: Array) -> _Point:
        # A robust loss is least squares again, with the weights of its slope and of its curvature.
        residuals, slopes = self.rows(values)
        squares = residuals**2
        losses, slope, second = robust_loss(self.loss, squares)
        bend = np.sqrt(np.maximum(slope + 2 * squares * second, FLAT * slope))
        return _Point(
            values,
            np.concatenate([residuals * slope / bend, self._root @ (self.known.centre - values)]),
            np.vstack([slopes * bend[:, None], self._root]),
            float(losses.sum()) + self.known.misfit(values),
        )

    @cached_property
    def _root(self) -> Array:
        # Rows (k, q) whose square is what is known.
        values, vectors = np.linalg.eigh(self.known.information * np.outer(self.scale, self.scale))
        told = values > 0
        return np.asarray(np.sqrt(values[told])[:, None] * vectors[:, told].T / self.scale)


@dataclass(frozen=True)
class _Point:
    # Residuals and derivatives (rows, q), what is known as further rows.
    values: Array
    residuals: Array
    slopes: Array
    misfit: float

    def step(self, free: npt.NDArray[np.bool_]) -> tuple[Array, Array, float]:
        """Of the free unknowns, the others held; standard errors; the step's length in units of these."""
        factor = SquareRoot.of_rows(self.slopes[:, free]).factor
        along = factor.T @ (self.slopes[:, free].T @ self.residuals)
        step, errors = np.zeros(len(free)), np.zeros(len(free))
        step[free], errors[free] = factor @ along, np.linalg.norm(factor, axis=1)
        return step, errors, float(np.linalg.norm(along))
