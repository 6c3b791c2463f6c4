"""Readings whose errors last: white noise and a first-order Gauss-Markov process beside it.

So do positions by satellites err, by a few centimetres for some ten seconds. However long a log is, such
errors stay as large as they are, where drift grows.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from oed.estimation.prediction.layout import SegmentLayout
from oed.estimation.setup.noise import group_of
from oed.foundation.arrays import Array
from oed.foundation.text import size_text
from oed.robots.sensors.logged import Noise


class _Gains(NamedTuple):
    # Of the filter, (n + 1, S, quantities) each: what a reading moves the lasting error by, the variance of
    # its innovation in units of the white noise's, and what is left of the error at the next time.
    gain: Array
    variance: Array
    left: Array


@dataclass(frozen=True)
class GaussMarkov:
    """Noise of readings that lasts.

    Attributes:
        white: standard deviations of what is independent from reading to reading, by the noises' names, SI.
        lasting: of the process, alike, for those that have one.
        seconds: after which correlations of the process have fallen to 1/e [s].
    """

    white: Mapping[str, float]
    lasting: Mapping[str, float]
    seconds: float

    @property
    def sizes(self) -> Array:
        """White noises, processes and their time, SI, as a search for them has them."""
        return np.array([*self.white.values(), *self.lasting.values(), self.seconds])

    @property
    def noises(self) -> dict[str, Noise]:
        """The white part."""
        return {name: Noise(size) for name, size in self.white.items()}

    def whitened(self, layout: SegmentLayout, values: Array) -> Array:
        """What is new in every reading: L^-1 times values, with L L' their covariance.

        By the Kalman filter [Harvey: Forecasting, structural time series models and the Kalman filter, 1989].

        Args:
            layout: when what is read.
            values: in units of the white noise, (S, n + 1, quantities, ...); 0 where nothing is read.
        """
        gains, found = self._gains(layout), np.empty_like(values)
        further = (...,) + (None,) * (values.ndim - 3)
        error = np.zeros((values.shape[0], *values.shape[2:]))
        for place in range(values.shape[1]):
            read = layout.valid[:, place][further]
            new = np.where(read, values[:, place] - error, 0.0)
            found[:, place] = new / np.sqrt(gains.variance[place])[further]
            error = (error + gains.gain[place][further] * new) * gains.left[place][further]
        return found

    def volumes(self, layout: SegmentLayout) -> Array:
        """Logarithm of the determinant of the readings' covariance by segments, (S,), SI."""
        sizes = np.array([self.white[group_of(name)] for name in layout.quantities])
        each = np.log(self._gains(layout).variance.swapaxes(0, 1)) + 2 * np.log(sizes)
        return np.asarray(np.where(layout.valid, each, 0.0).sum(axis=(1, 2)))

    def independent(self, layout: SegmentLayout) -> float:
        """How many independent values show how large the process is [Bayley, Hammersley: The "effective"
        number of independent observations in an autocorrelated time series, 1946].
        """
        lasted = layout.steps.sum(axis=1) / (2 * self.seconds)
        count = sum(group_of(name) in self.lasting for name in layout.quantities)
        return float(count * (1 + lasted).sum())

    def _gains(self, layout: SegmentLayout) -> _Gains:
        groups = [group_of(name) for name in layout.quantities]
        ratio = np.array([(self.lasting.get(name, 0.0) / self.white[name]) ** 2 for name in groups])
        left = np.exp(-np.pad(layout.steps, ((0, 0), (0, 1))) / self.seconds).T[..., None]
        shape = (left.shape[0], layout.count, len(groups))
        found = _Gains(np.zeros(shape), np.ones(shape), np.broadcast_to(left, shape))
        spread = np.broadcast_to(ratio, shape[1:])
        for place in range(shape[0]):
            read = layout.valid[:, place]
            found.variance[place] = np.where(read, 1 + spread, 1.0)
            found.gain[place] = np.where(read, spread / (1 + spread), 0.0)
            spread = (1 - found.gain[place]) * spread
            spread = left[place] ** 2 * spread + (1 - left[place] ** 2) * ratio
        return found

    def note(self) -> str:
        """What it is, in words."""
        units = {"position": "m"}
        sizes = (
            f"{name} by {size_text(size, units.get(name, 'rad'), 2)} beside "
            f"{size_text(self.white[name], units.get(name, 'rad'), 2)} from reading to reading"
            for name, size in self.lasting.items()
        )
        return (
            f"errors of the readings last for some {size_text(self.seconds, 's', 2)}: {', '.join(sizes)}; "
            "standard errors allow for the correlation"
        )
