"""What an estimator says of real or simulated readings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Estimate:
    """Parameters estimated from readings; all SI.

    Attributes:
        parameters: names, (p,).
        values: (p,).
        covariance: (p, p).
        nuisances: the other unknowns' names, (n,).
        nuisance_values: (n,).
        residuals: readings less their prediction, in units of the noise, (M,).
        converged: whether the search for the least squares ended by its own tolerance.
        message: how it ended.
    """

    parameters: tuple[str, ...]
    values: Array
    covariance: Array
    nuisances: tuple[str, ...]
    nuisance_values: Array
    residuals: Array
    converged: bool
    message: str

    @property
    def standard_deviations(self) -> dict[str, float]:
        """Of each parameter."""
        return dict(zip(self.parameters, map(float, np.sqrt(np.diag(self.covariance))), strict=True))
