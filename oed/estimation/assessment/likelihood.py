"""How likely a fit makes the readings, and how much that counts where residuals are correlated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from oed.estimation.assessment.covariance import blocks_of, information, judgeable, sandwich
from oed.estimation.assessment.diagnostics import correlations
from oed.estimation.methods.fit import Fit
from oed.estimation.methods.window_noise import OF_POSES, PARTS
from oed.estimation.setup.noise import LEAST, greatest, groups, places_of
from oed.estimation.setup.options import CalibrationOptions
from oed.foundation.arrays import Array
from oed.robots.sensors.logged import Noise

Way = Literal["blocks", "correlations"]

LAGS = 300
"""Readings later up to which correlations are summed, where they do not vanish before."""


@dataclass(frozen=True)
class Likelihood:
    """Of the readings by a fit, its noise at its own greatest likelihood.

    Attributes:
        each: logarithm by segments, (S,).
        unknowns: number of what was fitted to all readings together: parameters, the sensor's place, clocks
            and noise. What is not identifiable counts for nothing.
        starts: number of states of segments' starts that not all models have.
    """

    each: Array
    unknowns: float
    starts: float = 0.0


@dataclass(frozen=True)
class FittedReadings:
    """What all models are judged by.

    Attributes:
        shares: of every reading's variance that is left when each segment's start is fitted, (S, n + 1,
            quantities); 0 where there is none.
        growth: by the noises' names which of speed (0) and yaw rate (1) the noise of any model grows with.
    """

    shares: Array
    growth: Mapping[str, Sequence[int]]

    @classmethod
    def of(cls, fits: Sequence[Fit]) -> FittedReadings:
        """As the segments of the model with the fewest states have them."""
        fit = min(fits, key=lambda one: one.starts.shape[1])
        identified = _identified(fit)
        left = np.where(fit.layout.valid, np.clip(fit.redundancy, 0.0, None), 0.0)
        growth = {
            group: [
                part
                for part, key in enumerate(("per_speed", "per_yaw_rate"))
                if any(getattr(one.noises[group], key) for one in fits)
            ]
            for group in groups(fit.layout.quantities)
        }
        return cls(left * (1 + identified / max(float(left.sum()), 1e-9)), growth)

    @property
    def count(self) -> float:
        """Readings less the states of segments' starts, n."""
        return float(self.shares.sum())

    def likelihood(self, fit: Fit, options: CalibrationOptions) -> Likelihood:
        """Of these readings by a model's fit.

        Starts are taken out of the readings, as restricted likelihoods do [Patterson, Thompson 1971]: there
        are as many as segments, and would make the noise too small.
        """
        noise = 0
        if fit.volumes is not None:
            each = _correlated(fit, free=options.noise != "specified")
            noise = _noise_parts(fit, options)
        else:
            each = np.zeros(fit.layout.count)
            for group in groups(fit.layout.quantities):
                own, count = self._group(fit, places_of(group, fit.layout.quantities), group, options)
                each, noise = each + own, noise + count
        left = float(np.where(fit.layout.valid, fit.redundancy, 0.0).sum())
        identified = _identified(fit)
        return Likelihood(each, identified + noise, max(self.count - left - identified, 0.0))

    def _group(
        self, fit: Fit, places: list[int], group: str, options: CalibrationOptions
    ) -> tuple[Array, int]:
        # The logarithm by segments of readings that share their noise, and how many numbers that noise has.
        shares, residuals = self.shares[..., places], fit.residuals[..., places]
        rates = [np.repeat(one[..., None], len(places), axis=-1) for one in (fit.speeds, fit.yaw_rates)]
        identified = shares > 0
        noise, count = fit.noises[group], 0
        if options.noise != "specified":
            own_rates = np.stack([one[identified] for one in rates])
            noise, count = _greatest(residuals[identified], shares[identified], own_rates, self.growth[group])
        variance = noise.deviation(*rates) ** 2
        terms = shares * np.log(2 * np.pi * variance) + residuals**2 / variance
        return -0.5 * np.where(identified, terms, 0.0).sum(axis=(1, 2)), count


def _identified(fit: Fit) -> float:
    # How many unknowns the readings identify, those less that are known rather from before.
    return float(np.trace(fit.inverse @ fit.information.sum(axis=0)))


def _greatest(residuals: Array, shares: Array, rates: Array, parts: Sequence[int]) -> tuple[Noise, int]:
    # In the same form for every model: what grows little costs little likelihood, but the same number.
    constant = max(float(np.sqrt((residuals**2).sum() / shares.sum())), LEAST)
    if not parts or constant == LEAST:
        return Noise(constant), 1 + len(parts)
    return greatest(residuals**2 / shares, shares, rates, constant, parts)[1], 1 + len(parts)


def _correlated(fit: Fit, *, free: bool) -> Array:
    # Readings whose noise is correlated, its size free unless it is specified.
    squares = np.where(fit.layout.valid, fit.white**2, 0.0).sum(axis=(1, 2))
    count = fit.layout.valid.sum(axis=(1, 2)) - (0 if fit.motions else fit.starts.shape[1])
    square = float(squares.sum() / count.sum()) if free else 1.0
    assert fit.volumes is not None
    return np.asarray(-0.5 * (squares / square + fit.volumes + count * np.log(2 * np.pi * square)))


def _noise_parts(fit: Fit, options: CalibrationOptions) -> int:
    # How many numbers a correlated noise has that were estimated.
    if fit.correlated is not None:
        return (0 if options.noise == "specified" else len(fit.noises)) + len(fit.correlated.lasting) + 1
    return len(PARTS) - (OF_POSES if options.noise == "specified" else options.noise == "constant")


def inflation(fit: Fit, block: float | None) -> tuple[float, Way]:
    """How many times as much as independent readings would the likelihood of a fit varies, at least 1.

    Residuals that are correlated say less than their number says: a likelihood ratio is then as many times
    too large as the scores vary more than their information says [Rotnitzky, Jewell: Hypothesis testing of
    regression parameters in semiparametric generalized linear models for cluster correlated data, 1990], here
    on average over all unknowns but the clocks. Of too few blocks the residuals' own correlations say it.

    Args:
        fit: whose residuals are nearest to noise.
        block: length of the blocks [s], None for the usual one.

    Returns:
        factor: the variance inflation factor c of quasi-likelihoods [Burnham, Anderson: Model selection and
            multimodel inference, 2002, section 2.5].
        way: how it was found.
    """
    blocks, common = blocks_of(fit, block), fit.unknowns.size - fit.unknowns.clocks
    if judgeable(fit, blocks):
        predicted, found = (one.matrix[:common, :common] for one in (information(fit), sandwich(fit, blocks)))
        return max(float(np.trace(np.linalg.solve(predicted, found))) / common, 1.0), "blocks"
    each = [_lasting(fit, places_of(group, fit.layout.quantities)) for group in groups(fit.layout.quantities)]
    return max(float(np.mean(each)), 1.0), "correlations"


def _lasting(fit: Fit, places: Sequence[int]) -> float:
    # Readings that count as one: the sum of correlations until they vanish.
    values, _ = correlations(fit, list(places), LAGS)
    gone = np.flatnonzero(values <= 0)
    return 1 + 2 * float(values[: gone[0] if len(gone) else len(values)].sum())
