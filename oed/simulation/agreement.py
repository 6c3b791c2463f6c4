"""How far from the predicted a covariance may be that simulated estimates did not contradict.

That a test passes says only that it saw nothing, and few experiments see little.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import scipy

from oed.foundation.text import significant

CONFIDENCE = 0.95
"""That no combination of parameters is farther from its predicted standard error than is said."""
TWICE = 2.0
"""Ratio from which it is given as a factor, not as a share."""
DIGITS = 2
"""Of what is said of ratios: as many as some thousand replicates tell."""


def largest_ratio(predicted: npt.ArrayLike, sampled: npt.ArrayLike, replicates: int) -> float:
    """Upper confidence limit of how many times as large, or as small, as predicted the standard error of any
    combination of parameters may be; infinite where that is not known.

    Of the combination a that is worst in truth, nu a'Sa / a'Ca is chi-squared, of nu = R - 1 degrees of
    freedom, S the sampled and C the true covariance [Anderson, 2003, chapter 7]. With P the predicted one,
    the largest eigenvalue of P^-1 S is at least a'Sa / a'Pa and the smallest at most that, so

        sqrt(nu lambda_max / chi2_(1 - c)),   sqrt(chi2_c / (nu lambda_min))

    fall below the true ratio with probability 1 - c at most. One combination is worst, above or below, so the
    larger of the two does, too [intersection-union test: Berger, 1982]. Errors are taken to be normal.

    Args:
        predicted: covariance, (p, p).
        sampled: covariance of the estimates, (p, p).
        replicates: R, that were simulated.
    """
    degrees, sampled = replicates - 1, np.asarray(sampled, dtype=float)
    if degrees < len(sampled):
        return math.inf
    try:
        values = scipy.linalg.eigh(sampled, np.asarray(predicted, dtype=float), eigvals_only=True)
    except np.linalg.LinAlgError:
        # Of a file that holds no covariance.
        return math.inf
    if not values[0] > 0:
        return math.inf
    low, high = scipy.special.chdtri(degrees, [CONFIDENCE, 1 - CONFIDENCE])
    above, below = degrees * values[-1] / low, high / (degrees * values[0])
    return max(1.0, math.sqrt(max(above, below)))


def agreement_text(ratio: float) -> str:
    """How well errors agree with the predicted, by `largest_ratio`: `to within 2.4 % (95 % confidence)`."""
    if not math.isfinite(ratio):
        return "as far as so few experiments can tell"
    size = f"a factor of {_up(ratio)}" if ratio >= TWICE else f"{_up(100 * (ratio - 1))} %"
    return f"to within {size} ({100 * CONFIDENCE:g} % confidence)"


def agreement_sentence(ratio: float) -> str:
    """How well errors agree with what is predicted, by `largest_ratio`, in a sentence."""
    return f"The standard error of every combination of parameters is as predicted {agreement_text(ratio)}."


def _up(value: float) -> str:
    # An upper limit is rounded upwards.
    if value <= 0:
        return "0"
    step = 10.0 ** (math.floor(math.log10(value)) - DIGITS + 1)
    return significant(DIGITS)(math.ceil(value / step - 1e-9) * step)
