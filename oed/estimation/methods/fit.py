"""The result of an estimation from segments of logs, whatever the method."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from oed.estimation.methods.gauss_markov import GaussMarkov
from oed.estimation.prediction.layout import SegmentLayout
from oed.estimation.setup.unknowns import Unknowns, inverse_of_sum
from oed.foundation.arrays import Array
from oed.foundation.equality import ByValue
from oed.foundation.presenting import Brief
from oed.logs.log import Log
from oed.robots.sensors.logged import Noise

SUREST = 1e6
"""Degrees of freedom of what is as good as known."""


def degrees_of(unsure: float) -> float:
    """Degrees of freedom of a Student's t with the kurtosis that errors have whose variance is as unsure, its
    logarithm normal: e^(s^2) = (d - 2) / (d - 4).

    Args:
        unsure: variance s^2 of that logarithm.
    """
    return float(4 + 2 / max(np.expm1(min(unsure, 50.0)), 2 / SUREST))


def combinations(covariance: Array) -> Array:
    """Combinations of unknowns whose errors have nothing to do with each other, as columns (n, n): along the
    eigenvectors of the correlations of a covariance (n, n).
    """
    sizes = np.sqrt(np.maximum(np.diag(covariance), np.finfo(float).tiny))
    return np.asarray(np.linalg.eigh(covariance / np.outer(sizes, sizes))[1] / sizes[:, None])


class ScoreParts(NamedTuple):
    """Covariance of scores by independent parts of the noise, whose sizes are not known for sure.

    Attributes:
        matrices: by each part, SI, (parts, q, q).
        spread: covariance of the logarithms of the parts' variances, (parts, parts).
    """

    matrices: Array
    spread: Array


@dataclass(frozen=True, repr=False, eq=False)
class Fit(ByValue, Brief):
    """A least-squares solution over segments.

    Attributes:
        unknowns: what was estimated.
        values: (q,), SI; clock offsets are corrections of `offsets`.
        offsets: of the clocks, as the search began, (clocks,) [s].
        starts: of the segments, (S, states).
        layout: the segments.
        residuals: measured less predicted, SI, (S, n + 1, quantities); of no meaning beyond a segment's end.
        white: the same in units of the noise.
        weights: of a robust loss, (S, n + 1, quantities).
        redundancy: share of each reading's variance that the fit leaves, (S, n + 1, quantities).
        noises: of the readings.
        speeds: at the readings, (S, n + 1) [m/s].
        yaw_rates: alike [rad/s].
        information: F of every segment with its start eliminated, SI, (S, q, q).
        scores: J' r of every segment alike, in units of the noise, (S, q).
        knowledge: from before, information (q, q).
        converged: whether the last step was small.
        motions: whether segments are windows, each of which shows but one motion, between its ends.
        notes: what else was found, in words.
        bend: how much flatter than `information` says a robust loss makes the misfit; 1 for least squares.
        swing: how much less than `information` says the scores vary with a robust loss; 1 for least squares.
        volumes: logarithm of the determinant of the noise's covariance, window by window given those before,
            (S,), where noise is correlated, starts taken out; None where every reading's is its own.
        by_start: derivatives of every segment's scores by the pose of its start, through what is read at each
            time, (S, n + 1, 3, q); None of motions, of designed drives and where noise is correlated.
        by_errors: the same by an error of the motion after each time, ahead, to the left and turned, through
            what is read of that motion itself; None where nothing is.
        correlated: noise of the readings that lasts, of which `noises` are the white part; None of others.
        innovations: whether residuals in units of the noise are those of a filter, which allows for all that
            errs besides.
        parts: of the scores' covariance, of motions; None of others.
    """

    unknowns: Unknowns
    values: Array
    offsets: Array
    starts: Array
    layout: SegmentLayout
    residuals: Array
    white: Array
    weights: Array
    redundancy: Array
    noises: Mapping[str, Noise]
    speeds: Array
    yaw_rates: Array
    information: Array
    scores: Array
    knowledge: Array
    converged: bool
    motions: bool = False
    notes: tuple[str, ...] = ()
    bend: float = 1.0
    swing: float = 1.0
    volumes: Array | None = None
    by_start: Array | None = None
    by_errors: Array | None = None
    correlated: GaussMarkov | None = None
    parts: ScoreParts | None = None
    innovations: bool = False

    @property
    def misfit(self) -> float:
        """Mean square of the residuals in units of their noise: about 1 where that is as it was specified."""
        return float(np.mean(self.white[self.layout.valid] ** 2))

    @property
    def total(self) -> Array:
        """F of all segments and of what was known before, SI, (q, q)."""
        return np.asarray(self.information.sum(axis=0) + self.knowledge)

    @cached_property
    def inverse(self) -> Array:
        """F^-1 (q, q), what was known before included."""
        return inverse_of_sum(self.information.sum(axis=0), self.knowledge)

    @property
    def curvature(self) -> Array:
        """Of the misfit by every segment, SI, (S, q, q): what a change of the scores is divided by."""
        return self.bend * self.information

    @cached_property
    def response(self) -> Array:
        """How the unknowns follow the scores, (q, q): the inverse of all curvature and prior knowledge."""
        return inverse_of_sum(self.curvature.sum(axis=0), self.knowledge)

    @property
    def clock_offsets(self) -> Array:
        """What the inputs' clocks show when the poses' show 0, (clocks,) [s]."""
        own = self.values[len(self.values) - self.unknowns.clocks :]
        return self.offsets + own if self.unknowns.clocks else self.offsets

    def clocks_of(self, logs: Sequence[Log]) -> list[float]:
        """The clocks' offset of each log [s]."""
        return [float(self.clock_offsets[self.layout.clocks.index(log.file)]) for log in logs]
