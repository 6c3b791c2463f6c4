"""How sure an estimate is: by the noise model, or by how much the parts of the logs disagree."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy

from oed.estimation.methods.fit import Fit
from oed.estimation.setup.options import CovarianceName
from oed.foundation.arrays import Array, Places

PARTS = 5
"""Blocks that a log is cut into, where logs are few."""
ENOUGH_LOGS = 8
"""Logs from which on each is a block by itself: what goes wrong in a run may last as long as the run."""
FEWEST_BLOCKS = 4
"""Blocks that do not overlap, without which neither sandwich nor bootstrap means anything."""
LEVEL = 0.95
"""Of intervals."""
ROUNDING = 1e-14
"""Share of the largest variance below which a covariance's variances are rounding."""
AT_ONCE = 10_000
"""Blocks drawn for the replicates that are in memory together."""


@dataclass(frozen=True)
class Covariance:
    """Of all unknowns, with what its intervals rest on.

    Attributes:
        matrix: (q, q), SI.
        degrees: degrees of freedom of the t distribution of single unknowns' intervals.
        name: of the way it was found.
        least_degrees: of that combination of parameters whose variance is least sure; None: as `degrees`.
    """

    matrix: Array
    degrees: float
    name: CovarianceName
    least_degrees: float | None = None

    @property
    def deviations(self) -> Array:
        """Standard errors (q,)."""
        return np.asarray(np.sqrt(np.clip(np.diag(self.matrix), 0.0, None)))

    @property
    def half_width(self) -> float:
        """Of a 95 % interval of a single unknown, in standard errors."""
        return _half_width(self.degrees)

    @property
    def degrees_together(self) -> float:
        """Degrees of freedom of whatever depends on several parameters."""
        return self.degrees if self.least_degrees is None else min(self.least_degrees, self.degrees)

    @property
    def half_width_together(self) -> float:
        """Of a 95 % interval of what depends on several parameters, in its standard errors."""
        return _half_width(self.degrees_together)

    def no_surer_than(self, other: Covariance, parameters: int) -> Covariance:
        """This, with at least the other's variance along every combination of the first `parameters`."""
        own = slice(parameters)
        mine, floor = self.matrix[own, own], _SquareRoots.of(other.matrix[own, own])
        ratios, ways = floor.ratios(mine)
        # Adding to a block what it lacks leaves the whole a covariance.
        lacks = floor.root @ ways @ np.diag(np.maximum(1.0 - ratios, 0.0)) @ ways.T @ floor.root.T
        matrix = self.matrix.copy()
        matrix[own, own] += (lacks + lacks.T) / 2
        return replace(self, matrix=matrix, least_degrees=min(self.degrees_together, other.degrees_together))

    def no_larger_than(self, other: Covariance, parameters: int) -> Covariance:
        """This, or as much of it as makes the other's variances along the first `parameters` 1 on average, in
        units of it.
        """
        own = slice(parameters)
        ratios, _ = _SquareRoots.of(self.matrix[own, own]).ratios(other.matrix[own, own])
        return replace(self, matrix=self.matrix * min(1.0, max(float(ratios.mean()), 0.0)))

    def surest(self, other: Covariance, parameters: int) -> float:
        """The least standard error of a combination of the first `parameters`, in units of the other's."""
        own = slice(parameters)
        ratios, _ = _SquareRoots.of(other.matrix[own, own]).ratios(self.matrix[own, own])
        return float(np.sqrt(max(ratios.min(initial=1.0), 0.0)))


class _SquareRoots(NamedTuple):
    # L of a covariance LL', and its inverse.
    root: Array
    inverse: Array

    @classmethod
    def of(cls, matrix: Array) -> _SquareRoots:
        sizes = np.sqrt(np.maximum(np.diag(matrix), np.finfo(float).tiny))
        values, vectors = np.linalg.eigh(matrix / np.outer(sizes, sizes))
        roots = np.sqrt(np.maximum(values, ROUNDING * max(values.max(initial=0.0), 1.0)))
        return cls(sizes[:, None] * vectors * roots, (vectors / roots).T / sizes)

    def ratios(self, matrix: Array) -> tuple[Array, Array]:
        # Variances of another covariance in units of this one's, and of what, as columns.
        values, ways = np.linalg.eigh(self.inverse @ matrix @ self.inverse.T)
        return values, ways


def _half_width(degrees: float) -> float:
    return float(scipy.stats.t.ppf((1 + LEVEL) / 2, max(degrees, 1.0)))


@dataclass(frozen=True)
class Blocks:
    """Successive segments of a log that belong together; each (first, last) a range of segments.

    Attributes:
        ranges: all blocks there are, overlapping, (blocks, 2).
        length: usual number of segments in one.
        independent: how many do not overlap.
        whole_logs: whether every log is a block.
    """

    ranges: Places
    length: int
    independent: int
    whole_logs: bool = False


def blocks_of(fit: Fit, seconds: float | None) -> Blocks:
    """The blocks of a fit's segments, about `seconds` long; by default whole logs where there are enough of
    them, else a fifth of each log.
    """
    owner, layout = fit.layout.owner, fit.layout
    lengths = layout.times[:, -1] - layout.times[:, 0]
    ranges, sizes, independent = [], [], 0
    numbers = np.unique(owner)
    parts = 1 if len(numbers) >= ENOUGH_LOGS and seconds is None else PARTS
    for log in numbers:
        own = np.flatnonzero(owner == log)
        share = len(own) / parts if seconds is None else seconds / max(float(np.median(lengths[own])), 1e-9)
        most = len(own) if parts == 1 else max(1, len(own) // 2)
        size = int(np.clip(round(share), 1, most))
        ranges += [(own[0] + first, own[0] + first + size) for first in range(len(own) - size + 1)]
        sizes.append(size)
        independent += len(own) // size
    return Blocks(np.array(ranges), int(np.median(sizes)), independent, parts == 1)


def judgeable(fit: Fit, blocks: Blocks) -> bool:
    """Whether there are enough blocks for their disagreement to be judged."""
    common = fit.unknowns.size - fit.unknowns.clocks
    return blocks.independent >= FEWEST_BLOCKS and len(blocks.ranges) > common


def information(fit: Fit) -> Covariance:
    """F^-1, of robust losses H^-1 M H^-1: right where the noise is as modelled and without drift."""
    matrix, degrees = fit.response @ white_scores(fit) @ fit.response, float(fit.redundancy.sum())
    if fit.correlated is not None:
        degrees = min(degrees, fit.correlated.independent(fit.layout))
    return Covariance(matrix, degrees, "information")


def white_scores(fit: Fit) -> Array:
    """Covariance (q, q) of the scores where the noise is as modelled, what was known before included."""
    return np.asarray(fit.swing * fit.information.sum(axis=0) + fit.knowledge)


def sandwich(fit: Fit, blocks: Blocks) -> Covariance:
    """H^-1 M H^-1 with the scores' own covariance M, correlated over a block's length.

    Where blocks are whole logs, M is that of the logs' sums. Else weights of correlations fall linearly with
    the lag [Newey, West: A simple, positive semi-definite, heteroskedasticity and autocorrelation consistent
    covariance matrix, 1987].
    """
    if blocks.whole_logs:
        sums = _sums(fit.scores, blocks.ranges)
        middle = sums.T @ sums
    else:
        middle = _correlated(fit.scores, fit.layout.owner, blocks.length)
    few = blocks.independent / max(blocks.independent - 1, 1)
    # What was known before is as uncertain as it says.
    matrix = fit.response @ (few * middle + fit.knowledge) @ fit.response
    return Covariance(matrix, blocks.independent - 1, "sandwich")


def _correlated(scores: Array, owner: Places, length: int) -> Array:
    middle = scores.T @ scores
    for lag in range(1, length):
        same = owner[lag:] == owner[:-lag]
        product = scores[lag:][same].T @ scores[:-lag][same]
        middle += (1 - lag / length) * (product + product.T)
    return np.asarray(middle)


def bootstrap(fit: Fit, blocks: Blocks, replicates: int, rng: np.random.Generator) -> Covariance:
    """Covariance of estimates from logs put together of blocks drawn at random.

    [Kunsch, The jackknife and the bootstrap for general stationary observations, 1989]. Each replicate is
    the step that the curvature of all logs takes with its own scores: a few blocks that happen to say little
    of a parameter would throw steps of their own curvature anywhere.

    Args:
        fit: of the logs.
        blocks: that the logs are cut into.
        replicates: how many logs are drawn.
        rng: of the draws.
    """
    sizes = blocks.ranges[:, 1] - blocks.ranges[:, 0]
    scores = _sums(fit.scores, blocks.ranges)
    draws = max(round(len(fit.scores) / float(sizes.mean())), 1)
    # At the solution what was known before pulls as hard as all scores together.
    pull = -fit.scores.sum(axis=0)
    found = np.empty((replicates, fit.scores.shape[1]))
    together = max(AT_ONCE // draws, 1)
    for some in np.array_split(found, range(together, replicates, together)):
        chosen = rng.integers(len(blocks.ranges), size=(len(some), draws))
        some[:] = (fit.response @ (scores[chosen].sum(axis=1) + pull)[..., None])[..., 0]
    few = blocks.independent / max(blocks.independent - 1, 1)
    # What was known before is as uncertain as it says; no drawing of blocks shows that.
    before = fit.response @ fit.knowledge @ fit.response
    return Covariance(few * np.atleast_2d(np.cov(found.T)) + before, blocks.independent - 1, "bootstrap")


def _sums(values: Array, ranges: Places) -> Array:
    # Of every range, by differences of running sums.
    running = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
    return np.asarray(running[ranges[:, 1]] - running[ranges[:, 0]])
