"""Whether noise is small enough for linearisation: estimates against linear ones of the same noise.

Drawn in pairs, both share nearly all of their chance: a few hundred experiments say what takes many thousands
otherwise. They are compared along every parameter and along the axes of the predicted ellipsoid.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from oed.foundation.arrays import Array
from oed.foundation.equality import ByValue
from oed.foundation.presenting import Card, Presented
from oed.foundation.text import listing, significant
from oed.simulation.checks import Moments

TOLERABLE = 0.05
"""Share of a standard error by which estimates may be off on average, and by which the standard error may be
wrong, where linearisation counts as right: intervals of 95 % then hold 93.8 to 96.1 %."""
FARTHEST = 5.0
"""Distance from the truth as which all that are longer count, in standard errors: or single estimates that
run away decide."""
PRESENT = 0.1
"""Least share of a combination that makes a parameter worth naming."""


@dataclass(frozen=True, repr=False, eq=False)
class Linearisation(ByValue, Presented):
    """Simulated estimates against the linearised least squares of the same noise.

    Attributes:
        parameters: names, (p,).
        directions: what is compared: every parameter, then the axes of the predicted ellipsoid, each as the
            numbers that make a combination of errors with a predicted deviation of 1, (k, p), 1 / SI.
        ratio: root mean square of these combinations, which is to be 1, (k,).
        ratio_error: standard error of that, (k,).
        bias: mean of these combinations less those of the linear estimates, (k,).
        bias_error: standard error of that, (k,).
        replicates: simulated experiments.
        alpha: probability with which the answer may be wrong.
    """

    parameters: tuple[str, ...]
    directions: Array
    ratio: Array
    ratio_error: Array
    bias: Array
    bias_error: Array
    replicates: int
    alpha: float

    @classmethod
    def of(
        cls,
        parameters: tuple[str, ...],
        directions: Array,
        linear: Array,
        pairs: Moments,
        alpha: float,
    ) -> Linearisation:
        """That of summed pairs.

        Args:
            parameters: names, (p,).
            directions: of `directions_of`, (k, p).
            linear: covariance of the linear estimates, (p, p).
            pairs: of `differences`.
            alpha: level.
        """
        count = len(directions)
        errors = np.sqrt(np.diag(pairs.covariance) / pairs.count)
        squares = np.einsum("ki,ij,kj->k", directions, linear, directions) + pairs.mean[:count]
        ratio = np.sqrt(np.maximum(squares, 0.0))
        # Of the root of a mean: near 0 as if that was as large as its error.
        least = np.maximum(errors[:count], np.finfo(float).tiny)
        return cls(
            parameters=parameters,
            directions=directions,
            ratio=ratio,
            ratio_error=errors[:count] / (2 * np.sqrt(np.maximum(squares, least))),
            bias=pairs.mean[count:],
            bias_error=errors[count:],
            replicates=pairs.count,
            alpha=alpha,
        )

    @property
    def small_enough(self) -> bool | None:
        """Whether all ratios are 1 and all biases 0 to within `TOLERABLE`, for sure; None where these
        experiments do not say.
        """
        off, reach = self._off
        if np.any(off - reach > TOLERABLE):
            return False
        return True if np.all(off + reach <= TOLERABLE) else None

    @property
    def sentence(self) -> str:
        """The answer in words."""
        off, reach = self._off
        if self.small_enough is None:
            known = f"{self.replicates} simulated experiments do not say"
            return f"Whether the noise is small enough for linearisation, {known}: take more."
        if self.small_enough:
            sizes = significant(1)(100 * float(off[0].max())), significant(1)(float(off[1].max()))
            return (
                "The noise is small enough for linearisation: errors are as large as predicted to "
                f"{sizes[0]} %, and off by at most {sizes[1]} standard errors on average."
            )
        worst = int(np.argmax((off - reach).max(axis=0)))
        return (
            f"The noise is too large for linearisation: errors of {self._named(worst)} are "
            f"{significant(3)(float(self.ratio[worst]))} times as large as predicted, and off by "
            f"{significant(2)(abs(float(self.bias[worst])))} standard errors on average."
        )

    @property
    def _off(self) -> tuple[Array, Array]:
        # How far ratios and biases are off, (2, k), and how far these may be wrong, for all together.
        errors = np.stack([self.ratio_error, self.bias_error])
        times = float(scipy.stats.norm.ppf(1 - self.alpha / (2 * errors.size)))
        return np.abs(np.stack([self.ratio - 1.0, self.bias])), times * errors

    def _named(self, place: int) -> str:
        # A direction in words.
        count = len(self.parameters)
        if place < count:
            return self.parameters[place]
        # In units of the parameters' own errors.
        parts = np.abs(self.directions[place] / self.directions[range(count), range(count)])
        named = np.flatnonzero(parts > PRESENT * parts.max())
        return f"a combination of {listing([self.parameters[one] for one in named])}"

    def _card(self) -> Card:
        answer = {True: "yes", False: "no", None: "not known"}[self.small_enough]
        write = significant(3)
        names = [self._named(place) for place in range(len(self.ratio))]
        rows = zip(names, map(write, self.ratio), map(write, self.bias), strict=True)
        heads = ("errors of", "size / predicted", "mean / predicted size")
        facts = (("verdict", self.sentence),)
        return Card(f"Noise small enough for linearisation: {answer}", facts, heads, tuple(rows))


def directions_of(covariance: Array) -> Array:
    """Along what errors with this covariance (p, p) are compared: every parameter, and where there are
    several the axes of the ellipsoid in units of their deviations, (k, p).
    """
    deviations = np.sqrt(np.diag(covariance))
    single = np.diag(1 / deviations)
    if len(covariance) == 1:
        return single
    values, vectors = np.linalg.eigh(covariance / np.outer(deviations, deviations))
    return np.vstack([single, (vectors / np.sqrt(values)).T / deviations])


def differences(estimates: Array, linear: Array, true: Array, directions: Array) -> Array:
    """What pairs say, along directions: by how much the squares of the estimates' distances from the truth
    are larger, and then the distances themselves, (R, 2 k).

    Args:
        estimates: (R, p).
        linear: estimates of the same noise, (R, p).
        true: values, (p,).
        directions: of `directions_of`, (k, p).
    """
    exact, near = (np.clip((one - true) @ directions.T, -FARTHEST, FARTHEST) for one in (estimates, linear))
    return np.hstack([exact**2 - near**2, exact - near])
