"""How much drift logs leave open that show none: far less than usual still outweighs noise in a long log.

Windows of seconds hardly show it, whole logs do: by the restricted likelihood of drift beside white noise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import scipy

from oed.estimation.methods.fit import Fit
from oed.estimation.methods.joint import JointSearch
from oed.estimation.methods.noise_selection import LEAST_LIKELY, Chain, Drift, Remainder
from oed.estimation.prediction.layout import cut
from oed.estimation.setup.unknowns import Knowledge
from oed.foundation.arrays import Array
from oed.logs.log import Log

SIZES = 0.001 * 2.0 ** np.arange(13)
"""Of drift relative to the usual one that are tried, all as likely before the logs: no drift that matters
beside any noise to four times the usual."""
WITHIN = 3.0
"""How far the logarithm of the white noise may be from that of the fit."""
UNLIKELY = 100.0
"""By how much -2 times the likelihood's logarithm has to rise above its least for larger drift to weigh
nothing: e^-50 beside variances that differ by a factor of 1e7."""


class OfOneSize(Drift):
    """Drift of given proportions: sizes of the white noises, and of the drift in units of the usual one.

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
        """The usual one."""
        return np.ones(1)

    def chain(self, sizes: Array) -> Chain:
        """Alike in all directions."""
        return super().chain(np.concatenate([sizes[:-1], sizes[-1] * self.usual]))

    def surprises(self) -> Array:
        """Twice the negative logarithm of the likelihood of each of `SIZES`, with the white noise that is
        likeliest beside it; infinite beyond those that are unlikely.
        """
        first = np.log(list(self.rest.white.values()))
        bounds, found, white = np.column_stack([first - WITHIN, first + WITHIN]), list[float](), first
        for size in SIZES:

            def surprise(logs: Array, size: float = float(size)) -> float:
                try:
                    return self.surprise(np.exp([*logs, np.log(size)]))
                except np.linalg.LinAlgError:
                    return LEAST_LIKELY

            options = {"ftol": 1e-5, "eps": 1e-4}
            best = scipy.optimize.minimize(surprise, white, method="L-BFGS-B", bounds=bounds, options=options)
            found.append(float(best.fun))
            white = best.x
            if found[-1] > min(found) + UNLIKELY:
                break
        return np.pad(found, (0, len(SIZES) - len(found)), constant_values=np.inf)


def faint_drift(fit: Fit, logs: Sequence[Log], usual: Array) -> tuple[float, float]:
    """Mean of the variance of drift that whole logs leave open, relative to the usual one, and the variance
    of its logarithm that has the same variance about the mean.

    Args:
        fit: of logs with positions.
        logs: these, without outliers.
        usual: variances of drift, (4,).
    """
    unknowns, clocks = fit.unknowns, fit.layout.clocks
    layout = cut(logs, math.inf, [float(fit.offsets[clocks.index(log.file)]) for log in logs])
    search = JointSearch(layout, unknowns, fit.offsets, Knowledge(fit.knowledge, unknowns.nominal))
    rest = Remainder.of(search, fit.values, search.first_starts(fit.values), fit.noises)
    surprises = OfOneSize(rest, usual).surprises()
    weights = np.exp((surprises.min() - surprises) / 2)
    weights /= weights.sum()
    mean = float(weights @ SIZES**2)
    return mean, float(np.log(weights @ SIZES**4 / mean**2))
