"""The Estimator seam: from one drive's readings to parameters, with the covariance by its formula."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Literal

import numpy as np
import numpy.typing as npt

from oed.foundation.moved import Renamed

Array = npt.NDArray[np.float64]

EstimatorName = Literal["ols", "sandwich", "gls", "errors_in_variables", "nonlinear"]


class Estimator(Renamed, ABC):
    """An estimator of the parameters from one drive, ready to be simulated.

    Attributes:
        name: of the method.
        parameters: names, (p,).
        true: nominal values, which simulations take for the truth, (p,), SI.
    """

    name: EstimatorName
    parameters: tuple[str, ...]
    true: Array

    @property
    @abstractmethod
    def covariance(self) -> Array:
        """Covariance (p, p) of the estimates by the estimator's own formula, SI."""

    @property
    def linear_covariance(self) -> Array:
        """Covariance (p, p) of the linear estimates that `simulate` pairs with its estimates."""
        return self.covariance

    @abstractmethod
    def simulate(self, rng: np.random.Generator, count: int) -> tuple[Array, Array]:
        """Estimates (count, p) from simulated readings, and the linearised estimates of the same noise."""
