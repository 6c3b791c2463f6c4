"""Least squares by Gauss-Newton steps, halved where they make the misfit worse."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple, Protocol, TypeVar

import numpy as np
import numpy.typing as npt

from oed.estimation.methods.knowledge import Knowledge, inverse_of_told
from oed.estimation.methods.losses import robust_loss
from oed.estimation.setup.options import Loss
from oed.kernel.measurement.square_root import SquareRoot

Array = npt.NDArray[np.float64]
Booleans = npt.NDArray[np.bool_]

STEPS = 40
"""Gauss-Newton steps at most."""
RENEWALS = 15
"""Steps after which the noise is held: whether it grows with speed may be undecided for ever."""
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


class Rows(NamedTuple):
    """What is left of readings in units of their noise, segment by segment.

    Attributes:
        residuals: measured less predicted, (S, m).
        slopes: derivatives of what is predicted by the common unknowns, (S, m, q).
        own: by the unknowns of each segment alone, its start, (S, m, c).
    """

    residuals: Array
    slopes: Array
    own: Array

    @classmethod
    def of(cls, residuals: Array, slopes: Array) -> Rows:
        """Those (m,) and (m, q) of a single segment without unknowns of its own."""
        return cls(residuals[None], slopes[None], np.zeros((1, len(residuals), 0)))


class HasRows(Protocol):
    """Gives rows at common unknowns (q,) and the segments' own (S, c)."""

    def __call__(self, values: Array, starts: Array, /) -> Rows:
        """The rows."""


class HasMisfit(Protocol):
    """Where a search is."""

    @property
    def misfit(self) -> float:
        """What is to be made small."""


Place = TypeVar("Place", bound=HasMisfit)


class Found(NamedTuple):
    """The end of a search.

    Attributes:
        values: the common unknowns, (q,).
        starts: the segments' own, (S, c).
        rows: as they were last, in units of the last noise.
        arrived: whether these are the least squares.
    """

    values: Array
    starts: Array
    rows: HasRows
    arrived: bool


def projected(rows: Array, own: Array) -> tuple[Array, Array]:
    """Rows (S, m, q) less what columns (S, m, c) of the same segment explain, and the share of each row that
    they do, (S, m).
    """
    across = own @ inverse_of_told(own.transpose(0, 2, 1) @ own)
    explained = across @ (own.transpose(0, 2, 1) @ rows)
    return rows - explained, np.einsum("sia,sia->si", across, own)


@dataclass(frozen=True)
class LeastSquares:
    """The search.

    Attributes:
        scale: sizes of the common unknowns, (q,).
        known: of them from before.
        loss: of a residual; other than "linear" it bounds the influence of outliers.
        clocks: how many of the last unknowns are clock offsets. Motion is piecewise linear in these, and the
            least squares may lie in a corner: the search then goes on with the others.
        close: change of the unknowns, in units of their size, at which the search has arrived.
    """

    scale: Array
    known: Knowledge
    loss: Loss = "linear"
    clocks: int = 0
    close: float = CLOSE

    def solved(
        self,
        rows: HasRows,
        values: Array,
        starts: Array | None = None,
        renewed: Callable[[HasRows, Array, Array], HasRows] | None = None,
    ) -> Found:
        """The least squares.

        Args:
            rows: of unknowns.
            values: where the search begins, (q,).
            starts: the segments' own unknowns there, (S, c); one segment without any by default.
            renewed: rows in units of the noise that those at a point show; as they are by default.
        """
        point = _Point(self, rows, values, np.zeros((1, 0)) if starts is None else starts)
        free = np.ones(len(values), dtype=bool)
        for number in range(STEPS):
            if renewed is not None and number < RENEWALS:
                point = replace(point, at=renewed(point.at, point.values, point.starts))
            step = point.step(free)
            following = downhill(point, partial(point.moved, step))
            early = renewed is not None and number < 2
            # Where no part of a step makes it better, the search has arrived only if the step is of no size.
            if following is point and not early:
                if np.all(np.abs(step.values) <= NEAR * step.errors):
                    return point.found(arrived=True)
                if not self.clocks or not free.all():
                    return point.found(arrived=False)
                free[len(values) - self.clocks :] = False
                continue
            change = float((np.abs(following.values - point.values) / self.scale).max(initial=0.0))
            point = following
            if not early and (change < self.close or step.length < SURE):
                return point.found(arrived=True)
        return point.found(arrived=False)

    @cached_property
    def root(self) -> Array:
        """Rows (k, q) whose square is what is known."""
        values, vectors = np.linalg.eigh(self.known.information * np.outer(self.scale, self.scale))
        told = values > 0
        return np.asarray(np.sqrt(values[told])[:, None] * vectors[:, told].T / self.scale)


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
class _Step:
    # Of the unknowns and the segments' own; standard errors; the step's length in units of these.
    values: Array
    starts: Array
    errors: Array
    length: float


@dataclass(frozen=True)
class _Point:
    # Where a search is.
    search: LeastSquares
    at: HasRows
    values: Array
    starts: Array

    @cached_property
    def rows(self) -> Rows:
        return self.at(self.values, self.starts)

    @cached_property
    def losses(self) -> Array:
        found = robust_loss(self.search.loss, self.rows.residuals.ravel() ** 2)
        return found.reshape(3, *self.rows.residuals.shape)

    @property
    def misfit(self) -> float:
        return float(self.losses[0].sum()) + self.search.known.misfit(self.values)

    def moved(self, step: _Step, share: float) -> _Point:
        values, starts = self.values + share * step.values, self.starts + share * step.starts
        return replace(self, values=values, starts=starts)

    def found(self, *, arrived: bool) -> Found:
        return Found(self.values, self.starts, self.at, arrived)

    def step(self, free: Booleans) -> _Step:
        # Of the free unknowns, the others held. A robust loss is least squares again, with the weights of its
        # slope and of its curvature.
        squares, (_, slope, second) = self.rows.residuals**2, self.losses
        bend = np.sqrt(np.maximum(slope + 2 * squares * second, FLAT * slope))
        residuals = self.rows.residuals * slope / bend
        slopes, own = self.rows.slopes[..., free] * bend[..., None], self.rows.own * bend[..., None]
        known = self.search.root
        left, _ = projected(slopes, own)
        stacked = np.vstack([left.reshape(-1, left.shape[-1]), known[:, free]])
        before = known @ (self.search.known.centre - self.values)
        factor = SquareRoot.of_rows(stacked).factor
        along = factor.T @ (stacked.T @ np.concatenate([residuals.ravel(), before]))
        step, errors = np.zeros(len(free)), np.zeros(len(free))
        step[free], errors[free] = factor @ along, np.linalg.norm(factor, axis=1)
        rest = residuals - slopes @ step[free]
        return _Step(step, _fitted(own, rest), errors, float(np.linalg.norm(along)))


def _fitted(own: Array, residuals: Array) -> Array:
    # Least squares (S, c) of residuals (S, m) by columns (S, m, c).
    across = own.transpose(0, 2, 1)
    return np.asarray((inverse_of_told(across @ own) @ (across @ residuals[..., None]))[..., 0])
