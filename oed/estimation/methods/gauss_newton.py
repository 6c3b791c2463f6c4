"""Least squares by Gauss-Newton steps, damped where they make the misfit worse.

Robust losses of residuals bound the influence of outliers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
import scipy

from oed.estimation.setup.options import Loss
from oed.estimation.setup.unknowns import Knowledge, inverse_of_identifiable
from oed.foundation.arrays import Array, Bools
from oed.kernel.measurement.square_root import SquareRoot

STEPS = 100
"""Gauss-Newton steps at most."""
RENEWALS = 15
"""Steps after which the noise is held: whether it grows with speed may be undecided for ever."""
SHARES = tuple(0.5**halving for halving in range(8))
"""Of a step that are tried in turn while they make the misfit worse."""
DAMPINGS = (0.0, *(10.0**power for power in range(-6, 3)))
"""What is tried in turn instead far from the least squares, where halving creeps along: squared lengths that
are added to the columns of derivatives, in units of their own [Marquardt: An algorithm for least-squares
estimation of nonlinear parameters, 1963]. What the readings say little of then moves less and less."""
EASED = 2
"""By how many of these a step is damped less than the one before it, to begin with."""
FAR = 10.0
"""Length of a step in standard errors from which on it is damped, not halved."""
NEAR = 0.05
"""Share of its standard error that an unknown may be off where no step makes the misfit smaller: motion is
piecewise linear in a clock's offset, and the least squares may lie in a corner."""
AT_REST = 1e-3
"""Change of the unknowns in the last of all steps, in units of their size, that is still an arrival."""
PATIENCE = 3
"""Steps in a row whose halves gain next to nothing of what they promise, after which clocks are held."""
CLOSE = 1e-7
"""Change of the unknowns, in units of their size, at which the search has arrived."""
SURE = 1e-9
"""The same in units of their standard errors: whatever their size, more digits mean nothing."""
WORSE = 1e-12
"""By how much rounding may make a misfit worse, relative to it."""
FLAT = 0.1
"""Least curvature of a loss, relative to its weight, for it bends back beyond outliers. The parabola of its
weights lies above a loss, so that this share of a step at least leads downhill."""

BEYOND = 1e30
"""How many times their size unknowns may become, and residuals their noise."""


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
        """Those (...,) and (..., q) of a single segment without unknowns of its own."""
        wide = slopes.reshape(1, -1, slopes.shape[-1])
        return cls(residuals.reshape(1, -1), wide, np.zeros((1, residuals.size, 0)))

    def damped(self, damping: float) -> Rows:
        """With rows that keep the segments' own unknowns where they are, as long as the columns by them times
        the root of `damping`.
        """
        if damping == 0:
            return self
        lengths = np.sqrt(damping) * np.linalg.norm(self.own, axis=1)
        more = lengths[..., None] * np.eye(lengths.shape[-1])
        zeros = (np.zeros((*more.shape[:2], *one.shape[2:])) for one in (self.residuals, self.slopes))
        return Rows(*(np.concatenate(pair, axis=1) for pair in zip(self, (*zeros, more), strict=True)))


HasRows = Callable[[Array, Array], Rows]
"""Gives rows at common unknowns (q,) and the segments' own (S, c)."""


@runtime_checkable
class HasResiduals(Protocol):
    """Gives their residuals (S, m) alone, for less."""

    def __call__(self, values: Array, starts: Array) -> Rows:
        """At common unknowns (q,) and the segments' own (S, c)."""

    def residuals(self, values: Array, starts: Array) -> Array:
        """At common unknowns (q,) and the segments' own (S, c)."""


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
    across = _across(own)
    return _unexplained(rows, own, across), np.einsum("sia,sia->si", across, own)


def _across(own: Array) -> Array:
    # Columns (S, m, c) times the inverse of their square.
    return own @ inverse_of_identifiable(own.transpose(0, 2, 1) @ own) if own.size else own


def _unexplained(rows: Array, own: Array, across: Array) -> Array:
    # Less what columns `own` explain, `across` being these times the inverse of their square.
    if not own.size:
        return rows
    return np.asarray(rows - across @ (own.transpose(0, 2, 1) @ rows))


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
        flat: least curvature of a loss, relative to its weight. With 1 its curvature does not count, which
            suits readings whose noise follows their residuals.
    """

    scale: Array
    known: Knowledge
    loss: Loss = "linear"
    clocks: int = 0
    close: float = CLOSE
    flat: float = FLAT

    @np.errstate(over="ignore", invalid="ignore", divide="ignore")
    def solved(
        self,
        rows: HasRows,
        values: Array,
        starts: Array | None = None,
        renewed: Callable[[Any, Array, Array], HasRows] | None = None,
        *,
        hold_clocks: bool = False,
    ) -> Found:
        """The least squares.

        After all steps it has arrived, too, where the last of them was small beside the standard errors and
        beside the unknowns' sizes, and made the misfit hardly better: robust losses converge slowly. Unknowns
        that run away move on by their size, however unsure they are.

        Args:
            rows: of unknowns.
            values: where the search begins, (q,).
            starts: the segments' own unknowns there, (S, c); one segment without any by default.
            renewed: rows in units of the noise that those at a point show; as they are by default.
            hold_clocks: whether clocks stay where they are.
        """
        point = _Point(self, rows, values, np.zeros((1, 0)) if starts is None else starts)
        clocks = np.arange(len(values)) >= len(values) - self.clocks
        free, damped, creeping, idle = ~clocks | (not hold_clocks), 0, 0, False
        for number in range(STEPS):
            if renewed is not None and number < RENEWALS:
                point = replace(point, at=renewed(point.at, point.values, point.starts))
            step = point.step(free)
            following, damped = self._following(point, step, free, max(damped - EASED, 0))
            early = renewed is not None and number < 2
            # Where no part of a step makes it better, the search has arrived only if the step is of no size.
            if following is point and not early:
                if np.all(np.abs(step.values) <= NEAR * step.errors):
                    return point.found(arrived=True)
                if not np.any(free & clocks):
                    return point.found(arrived=False)
                free &= ~clocks
                continue
            moved, gain = np.abs(following.values - point.values), point.misfit - following.misfit
            sizes = np.minimum(NEAR * step.errors, AT_REST * self.scale)
            idle = bool(gain < NEAR**2 and np.all(moved <= sizes))
            creeping = creeping + 1 if gain < NEAR**2 <= step.length**2 else 0
            point = following
            if not early and ((moved / self.scale).max(initial=0.0) < self.close or step.length < SURE):
                return point.found(arrived=True)
            if not early and creeping >= PATIENCE:
                # Along a corner of the clocks parts of steps gain something for ever.
                free &= ~clocks
        return point.found(arrived=idle)

    def _following(self, point: _Point, step: _Step, free: Bools, damped: int) -> tuple[_Point, int]:
        # Where a step leads to, and by which of the dampings.
        if step.length < FAR:
            return downhill(point, lambda part: point.moved(step, part).ready(first=part == 1), SHARES)[0], 0
        tries = DAMPINGS[damped:]

        def after(size: float) -> _Point:
            return point.moved(point.step(free, size)).ready(first=size == tries[0])

        following, more = downhill(point, after, tries)
        return following, damped + more

    @cached_property
    def root(self) -> Array:
        """Rows (k, q) whose square is what is known."""
        values, vectors = np.linalg.eigh(self.known.information * np.outer(self.scale, self.scale))
        identified = values > 0
        return np.asarray(np.sqrt(values[identified])[:, None] * vectors[:, identified].T / self.scale)


def downhill(here: _Point, after: Callable[[float], _Point], tries: Sequence[float]) -> tuple[_Point, int]:
    """Where the first step that makes the misfit no worse leads to, `here` itself if none does; and how many
    were tried in vain.

    Args:
        here: before the step.
        after: where a share or a damping leads to.
        tries: of these.
    """
    for number, tried in enumerate(tries):
        there = after(tried)
        if there.misfit <= here.misfit * (1 + WORSE) and there.smooth:
            return there, number
    return here, len(tries)


class _Step(NamedTuple):
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
    def residuals(self) -> Array:
        if "rows" in self.__dict__ or not isinstance(self.at, HasResiduals):
            return self.rows.residuals
        return self.at.residuals(self.values, self.starts)

    @cached_property
    def losses(self) -> Array:
        found = robust_loss(self.search.loss, self.residuals.ravel() ** 2)
        return found.reshape(3, *self.residuals.shape)

    @cached_property
    def misfit(self) -> float:
        # From as far as this, such as a track without end, no derivative leads back.
        unknowns, residuals = self.values / self.search.scale, self.residuals
        if max(np.abs(one).max(initial=0.0) for one in (unknowns, residuals)) > BEYOND:
            return np.inf
        linear = self.search.loss == "linear"
        losses = residuals.ravel() ** 2 if linear else self.losses[0]
        return float(losses.sum()) + self.search.known.misfit(self.values)

    @property
    def smooth(self) -> bool:
        # Whether there are derivatives to go on with.
        return all(np.isfinite(one).all() for one in self.rows)

    def moved(self, step: _Step, share: float = 1.0) -> _Point:
        values, starts = self.values + share * step.values, self.starts + share * step.starts
        return replace(self, values=values, starts=starts)

    def ready(self, *, first: bool) -> _Point:
        # Most searches go on from what they try first, with derivatives, and from others seldom.
        if first:
            _ = self.rows
        return self

    def found(self, *, arrived: bool) -> Found:
        return Found(self.values, self.starts, self.at, arrived)

    @cached_property
    def weighted(self) -> Rows:
        # A robust loss is least squares again, with the weights of its slope and perhaps of its curvature.
        if self.search.loss == "linear":
            return self.rows
        squares, (_, slope, second) = self.rows.residuals**2, self.losses
        bend = np.sqrt(np.maximum(slope + 2 * squares * second, self.search.flat * slope))
        wide = bend[..., None]
        return Rows(self.rows.residuals * slope / bend, self.rows.slopes * wide, self.rows.own * wide)

    def step(self, free: Bools, damping: float = 0.0) -> _Step:
        # Of the free unknowns, the others held.
        residuals, slopes, own = self.weighted.damped(damping)
        known = self.search.root
        if not free.all():
            slopes, known = slopes[..., free], known[:, free]
        across = _across(own)
        flat = _unexplained(slopes, own, across).reshape(-1, known.shape[1])
        left = np.vstack([flat, known])
        before = self.search.root @ (self.search.known.centre - self.values)
        right = left.T @ np.concatenate([residuals.ravel(), before])
        if damping:
            left = np.vstack([left, np.sqrt(damping) * np.diag(np.linalg.norm(left, axis=0))])
        factor = SquareRoot.of_rows(left).factor
        step, errors = np.zeros(len(free)), np.zeros(len(free))
        step[free], errors[free] = factor @ (factor.T @ right), np.linalg.norm(factor, axis=1)
        starts = (across.transpose(0, 2, 1) @ (residuals - slopes @ step[free])[..., None])[..., 0]
        return _Step(step, starts, errors, float(np.linalg.norm(factor.T @ right)))


def robust_loss(loss: Loss, squares: Array) -> Array:
    """Rho of squared residuals in units of the noise with its first two derivatives, (3, n), as scipy's."""
    if loss == "linear":
        return np.vstack([squares, np.ones_like(squares), np.zeros_like(squares)])
    if loss == "soft_l1":
        root = np.sqrt(1 + squares)
        return np.vstack([2 * (root - 1), 1 / root, -0.5 / root**3])
    if loss == "cauchy":
        more = 1 + squares
        return np.vstack([np.log(more), 1 / more, -1 / more**2])
    far = squares > 1
    safe = np.where(far, squares, 1.0)
    root = np.sqrt(safe)
    return np.vstack(
        [
            np.where(far, 2 * root - 1, squares),
            np.where(far, 1 / root, 1.0),
            np.where(far, -0.5 / (root * safe), 0.0),
        ]
    )


@cache
def loss_moments(loss: Loss) -> tuple[float, float]:
    """E[psi'(z)] and E[psi(z)^2] of a standard normal residual z, with psi(z) = z rho'(z^2)."""

    def slope(size: float) -> float:
        _, first, second = robust_loss(loss, np.array([size**2])).ravel()
        return float(first + 2 * size**2 * second)

    def square(size: float) -> float:
        return float((size * robust_loss(loss, np.array([size**2]))[1].item()) ** 2)

    return _normal_mean(slope), _normal_mean(square)


def _normal_mean(function: Callable[[float], float]) -> float:
    # Of an even function; losses change their form at 1.
    def weighted(size: float) -> float:
        return 2 * function(size) * math.exp(-(size**2) / 2) / math.sqrt(2 * math.pi)

    return float(scipy.integrate.quad(weighted, 0.0, 1.0)[0] + scipy.integrate.quad(weighted, 1.0, np.inf)[0])
