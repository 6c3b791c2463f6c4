"""How much drift logs leave open that do not show it: far less than usual still outweighs noise in a long
log, and a robot's may be of another kind than usual.

Windows of seconds hardly show it, whole logs do: by the restricted likelihood of drift beside white noise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from oed.estimation.methods.chain import Chain
from oed.estimation.methods.fit import Fit
from oed.estimation.methods.joint import JointSearch
from oed.estimation.methods.noise_selection import LEAST_LIKELY, Drift, Remainder
from oed.estimation.prediction.layout import cut
from oed.estimation.setup.unknowns import Knowledge
from oed.foundation.arrays import Array
from oed.logs.log import Log

SIZES = np.array([0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0])
"""Of drift relative to the usual one that are tried, of the way and of turns apart, all as likely before the
logs: from none that matters beside any noise to three times the usual."""
KINDS = [0, 0, 1, 1]
"""Whether rates of drift are of the way (0) or of turns (1)."""
WITHIN = 3.0
"""How far the logarithm of the white noise may be from that of the fit."""
ENOUGH = 1e-5
"""Relative change of the likelihood's logarithm at which the search for white noise has arrived."""
NEAR = 0.1
"""By how much -2 times the likelihood's logarithm may be less at the likeliest white noise than where it was
looked for, for second derivatives to tell where that is and how much less."""
STEPS = 3
"""Of Newton's method with the second derivatives beside almost the same drift, before a search begins."""
CURVED = 0.01
"""Step of the second differences, in logarithms of sizes."""
UNLIKELY = 100.0
"""By how much -2 times the likelihood's logarithm has to rise above its least for larger drift to weigh
nothing: e^-50 beside variances that differ by a factor of 1e6."""


class Valley(NamedTuple):
    """Where white noise is likeliest beside some drift: logarithms of its sizes (r,), and the second
    derivatives there (r, r), None if they are unknown.
    """

    white: Array
    curvature: Array | None = None


class OfTwoSizes(Drift):
    """Drift of the way and drift of turns, each of given proportions: sizes of the white noises, and of both
    in units of the usual ones.

    Args:
        rest: what is to be explained.
        usual: variances ahead and sideways per path, of the turn per path and per turning, (4,).
    """

    def __init__(self, rest: Remainder, usual: Array) -> None:
        """Of a search's remainder."""
        super().__init__(rest)
        ahead, sideways, *turns = usual
        self.usual = np.sqrt([(ahead + sideways) / 2, *turns])

    @property
    def begin(self) -> Array:
        """The usual ones."""
        return np.ones(2)

    def chain(self, sizes: Array) -> Chain:
        """Alike in all directions."""
        return super().chain(np.concatenate([sizes[:-2], sizes[[-2, -1, -1]] * self.usual]))

    def of_sizes(self) -> Array:
        """Twice the negative logarithm of the likelihood of every pair of `SIZES`, (sizes, sizes), with the
        white noise that is likeliest beside it; infinite beyond those that are unlikely.
        """
        found, first = np.full((len(SIZES),) * 2, np.inf), Valley(self._first)
        for row, of_way in enumerate(SIZES):
            valley = first
            for column, of_turns in enumerate(SIZES):
                found[row, column], valley = self._likeliest(valley, np.log([of_way, of_turns]))
                first = first if column else valley
                if _risen(found[row, : column + 1], found.min()):
                    break
            if _risen(found[: row + 1].min(axis=1), found.min()):
                break
        return found

    @cached_property
    def _first(self) -> Array:
        return np.log(list(self.rest.white.values()))

    def _likeliest(self, near: Valley, drift: Array) -> tuple[float, Valley]:
        # Beside drift of these logarithms of sizes: the least, and where it is.
        bounds = np.column_stack([self._first - WITHIN, self._first + WITHIN])
        white, curvature = near
        for _ in range(STEPS):
            if curvature is None:
                break
            value, slope = self.slope(white, bounds[:, 1], drift)
            step = -np.linalg.solve(curvature, slope)
            white, less = white + step, -float(slope @ step) / 2
            if np.any(white != np.clip(white, *bounds.T)):
                break
            if less < NEAR:
                return value - less, Valley(white, curvature)
        value, white = self.likeliest(near.white, bounds, drift, ENOUGH)
        return value, Valley(white, self._curvature(white, drift))

    def _curvature(self, white: Array, drift: Array) -> Array | None:
        # Second differences about the likeliest; None where they are none of a minimum.
        count = len(white)
        first, second = np.triu_indices(count)
        ways = CURVED * np.vstack(
            [np.zeros(count), np.eye(count), np.eye(count)[first] + np.eye(count)[second]]
        )
        values = self.each(white + ways, drift)
        if values.max() >= LEAST_LIKELY:
            return None
        once, found = values[1 : 1 + count], np.zeros((count, count))
        found[first, second] = values[1 + count :] - once[first] - once[second] + values[0]
        found = (found + np.triu(found, 1).T) / CURVED**2
        return found if np.linalg.eigvalsh(found)[0] > 0 else None


def faint_drift(fit: Fit, logs: Sequence[Log], usual: Array) -> tuple[Array, Array]:
    """What whole logs leave open: means of the variances of drift, relative to the usual ones, (4,), and the
    covariance (4, 4) of their logarithms that has the same second moments.

    Args:
        fit: of logs with positions.
        logs: these, without outliers.
        usual: variances of drift, (4,).
    """
    unknowns, clocks = fit.unknowns, fit.layout.clocks
    layout = cut(logs, math.inf, [float(fit.offsets[clocks.index(log.file)]) for log in logs])
    search = JointSearch(layout, unknowns, fit.offsets, Knowledge(fit.knowledge, unknowns.nominal))
    rest = Remainder.of(search, fit.values, search.first_starts(fit.values), fit.noises)
    surprises = OfTwoSizes(rest, usual).of_sizes()
    weights = np.exp((surprises.min() - surprises) / 2)
    weights /= weights.sum()
    variances, each = SIZES**2, (weights.sum(axis=1), weights.sum(axis=0))
    means = np.array([one @ variances for one in each])
    moments = np.diag([one @ variances**2 for one in each])
    moments[0, 1] = moments[1, 0] = variances @ weights @ variances
    spread = np.log(moments / np.outer(means, means))
    return means[KINDS], _possible(spread)[np.ix_(KINDS, KINDS)]


def _risen(along: Array, least: float) -> bool:
    # Whether what follows is unlikely: beyond its likeliest size drift is the less likely the larger it is.
    return bool(along[-1] > max(along.min(), least + UNLIKELY))


def _possible(covariance: Array) -> Array:
    # The nearest with no variance below 0: moments that no normal distribution has may have one.
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray((vectors * np.clip(values, 0.0, None)) @ vectors.T)
