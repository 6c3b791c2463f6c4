"""The Estimator seam: from one drive's readings, real or simulated, to parameters with their covariance."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from oed.estimation.methods.fit import Fit
from oed.foundation.arrays import Array
from oed.foundation.equality import ByValue
from oed.foundation.presenting import Brief

EstimatorName = Literal["ols", "sandwich", "gls", "errors_in_variables", "nonlinear"]
"""What estimates parameters of a drive's readings."""
ARRIVED = "The steps have become as small as rounding."
ASTRAY = "No step makes the misfit smaller, or too many were needed: begin nearer, or measure more."
LOSS_UNDER_DRIFT = "expected linear: a robust loss of readings does not go with drift, which they share"


class Estimator(ABC):
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


@dataclass(frozen=True, repr=False, eq=False)
class Estimate(ByValue, Brief):
    """Parameters estimated from readings; all SI.

    Attributes:
        parameters: names, (p,).
        values: (p,).
        covariance: (p, p).
        nuisances: the nuisance parameters' names, (n,).
        nuisance_values: (n,).
        residuals: readings less their prediction, in units of the noise, in the order of the readings, (M,).
        converged: whether the search for the least squares ended by its own tolerance.
        message: how it ended.
    """

    parameters: tuple[str, ...]
    values: Array
    covariance: Array
    residuals: Array
    nuisances: tuple[str, ...]
    nuisance_values: Array
    converged: bool
    message: str

    @classmethod
    def of(
        cls,
        fit: Fit,
        covariance: Array,
        residuals: Array,
        places: Sequence[int] | None = None,
        parameters: tuple[str, ...] = (),
        message: str | None = None,
    ) -> Estimate:
        """What a fit says.

        Args:
            fit: the solution.
            covariance: of its parameters.
            residuals: in units of the noise, in the readings' order.
            places: of the parameters among the unknowns; the robot's by default.
            parameters: their names, where places are given.
            message: how it was found; by default how its search ended.
        """
        names = fit.unknowns.names
        own = list(range(len(fit.unknowns.parameters))) if places is None else list(places)
        rest = [place for place in range(len(names)) if place not in own]
        return cls(
            parameters=fit.unknowns.parameters if places is None else parameters,
            values=fit.values[own],
            covariance=covariance,
            residuals=residuals,
            nuisances=tuple(names[place] for place in rest),
            nuisance_values=fit.values[rest],
            converged=fit.converged,
            message=message or (ARRIVED if fit.converged else ASTRAY),
        )

    @property
    def standard_deviations(self) -> dict[str, float]:
        """Of each parameter."""
        return dict(zip(self.parameters, map(float, np.sqrt(np.diag(self.covariance))), strict=True))
