"""Joint nonlinear least squares: parameters, initial pose and nuisances from all sensors' readings."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import numpy.typing as npt

from oed.estimation.methods.estimate import Estimate
from oed.estimation.methods.estimator import Estimator, EstimatorName
from oed.estimation.methods.gauss_newton import LeastSquares
from oed.estimation.methods.knowledge import Knowledge
from oed.estimation.methods.losses import loss_moments
from oed.estimation.prediction.readings import PredictedReadings
from oed.estimation.setup.options import Loss
from oed.foundation.errors import Flaw, ProblemError
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.measurement.square_root import SquareRoot
from oed.kernel.problem import Problem

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

CLOSE = 1e-12
"""Change of the unknowns, in units of their size, at which the search has arrived."""
ARRIVED = "The steps have become as small as rounding."
ASTRAY = "No step makes the misfit smaller, or too many were needed: begin nearer, or measure more."


class Nonlinear(Estimator):
    """Least squares on all readings of one drive, weighed by their noise.

    The unknowns are the parameters that the problem estimates, the initial pose where it is not known,
    and the sensors' nuisances. Knowledge from before enters as further readings.

    Args:
        problem: with sensors (`Poses`, `Ranges`, `YawRate` or several).
        trajectory: the drive.
        loss: of a residual; other than "linear" it bounds the influence of outliers.

    Raises:
        ProblemError: a measurement without sensors, or a drive that does not tell the parameters apart.
    """

    name: EstimatorName = "nonlinear"

    def __init__(self, problem: Problem, trajectory: Trajectory, loss: Loss = "linear") -> None:
        """Write the readings as functions of the unknowns."""
        sensors = problem.measurement.joint_sensors
        if not sensors:
            text = f"joint least squares need sensors; {problem.measurement.kind} is a regression"
            raise ProblemError([Flaw(("validation", "estimators"), text)])
        self.problem, self.loss = problem, loss
        (estimation,) = problem.any_estimations
        self.parameters, self.true = estimation.parameters, estimation.nominal
        self._prior = estimation.prior
        self.readings = PredictedReadings(problem.robot, sensors, trajectory, self.parameters)
        self._initial = self.readings.initial
        if not SquareRoot.of_rows(self._rows(self._white_slope)).complete:
            text = f"the drive does not tell {', '.join(self.parameters)} apart; nothing to estimate"
            raise ProblemError([Flaw(("validation",), text)])

    @property
    def nuisances(self) -> tuple[str, ...]:
        """Names of the unknowns that are estimated along."""
        return tuple(entry.name for entry in self.readings.nuisances)

    @property
    def promised(self) -> Array:
        """F^-1; with a robust loss, its covariance under the Gaussian noise that the problem states."""
        return self._covariance(self.loss)

    @property
    def linear_covariance(self) -> Array:
        """F^-1, of the linearised least squares."""
        return self._covariance("linear")

    def predicted(self) -> Array:
        """The noise-free readings at the nominal values, (M,), SI."""
        return self.readings.response(self._initial)

    def fit(self, readings: npt.ArrayLike, *, before: Array | None = None) -> Estimate:
        """Estimate from readings (M,), sensor by sensor and time by time, SI.

        Args:
            readings: as `predicted` orders them. Angles may jump by full turns.
            before: values of what is known from before, in the order of the unknowns; nominal by default.

        Raises:
            ValueError: another number of readings, or some that are not finite.
        """
        measured = np.asarray(readings, dtype=float).ravel()
        if len(measured) != len(self.predicted()) or not np.all(np.isfinite(measured)):
            raise ValueError(f"expected {len(self.predicted())} finite readings, got {len(measured)}")
        known = self._initial if before is None else before
        measured = self.readings.unwrapped(measured)
        values, arrived = self._least_squares(measured, known)
        count = len(self.parameters)
        return Estimate(
            parameters=self.parameters,
            values=values[:count],
            covariance=self._covariance(self.loss, values),
            nuisances=self.nuisances,
            nuisance_values=values[count:],
            residuals=self.readings.whitener @ (measured - self.readings.response(values)),
            converged=arrived,
            message=ARRIVED if arrived else ASTRAY,
        )

    def replicate(self, rng: np.random.Generator, count: int) -> tuple[Array, Array]:
        """Estimates (count, p) from simulated readings, and the linearised estimates of the same noise."""
        exact, size, gain = self.predicted(), len(self.parameters), self._gain
        estimates, linear = np.empty((count, size)), np.empty((count, size))
        for index in range(count):
            white = rng.standard_normal(len(exact))
            surprise = rng.standard_normal(len(self._known))
            before = self._initial.copy()
            before[self._known] += self._spread @ surprise
            measured = exact + self.readings.colour @ white
            estimates[index] = self._least_squares(measured, before)[0][:size]
            linear[index] = self.true + (gain @ np.concatenate([white, surprise]))[:size]
        return estimates, linear

    def _least_squares(self, measured: Array, before: Array) -> tuple[Array, bool]:
        readings = self.readings

        def rows(unknowns: Array) -> tuple[Array, Array]:
            misfit = readings.whitener @ (measured - readings.response(unknowns))
            return misfit, readings.whitener @ readings.slope(unknowns)

        known = Knowledge(self._information, before)
        return LeastSquares(rows, self._scale, known, self.loss, close=CLOSE).solved(self._initial)

    def _covariance(self, loss: Loss, unknowns: Array | None = None) -> Array:
        # H^-1 M H^-1 with H = E[psi'] J'J + P and M = E[psi^2] J'J + P; F^-1 for psi(z) = z.
        slopes = self._white_slope
        if unknowns is not None:
            slopes = self.readings.whitener @ self.readings.slope(unknowns)
        (slope, square), size = loss_moments(loss), len(self.parameters)
        factor = SquareRoot.of_rows(self._rows(np.sqrt(slope) * slopes)).factor
        spread = self._rows(np.sqrt(square) * slopes) @ factor @ factor.T
        return np.asarray((spread.T @ spread)[:size, :size])

    @cached_property
    def _gain(self) -> Array:
        # (unknowns, M + known): linearised least squares, from standard normal noise to errors.
        rows = self._rows(self._white_slope)
        factor = SquareRoot.of_rows(rows).factor
        return np.asarray(factor @ (rows @ factor).T)

    def _rows(self, slopes: Array) -> Array:
        # Derivatives of readings (M, unknowns), and of what is known as if it had been read.
        known = np.zeros((len(self._known), len(self._initial)))
        known[:, self._known] = np.linalg.inv(self._spread)
        return np.vstack([slopes, known])

    @cached_property
    def _scale(self) -> Array:
        # A unit of 1 m, 1 rad or 1 rad/s for what is nominally 0.
        sizes = np.abs(self._initial)
        sizes[len(self.true) :] = 1.0
        return np.where(sizes > 0, sizes, 1.0)

    @cached_property
    def _information(self) -> Array:
        # Of all unknowns, as known from before.
        count = len(self.parameters)
        deviations = [entry.deviation or np.inf for entry in self.readings.nuisances]
        found = np.diag([*[0.0] * count, *(size**-2 for size in deviations)])
        if self._prior is not None:
            found[:count, :count] = self._prior
        return found

    @cached_property
    def _known(self) -> Indices:
        return np.flatnonzero(np.diag(self._information))

    @cached_property
    def _spread(self) -> Array:
        # From standard normal numbers to what is known from before, (known, known).
        own = self._information[np.ix_(self._known, self._known)]
        return np.asarray(np.linalg.cholesky(np.linalg.inv(own)))

    @cached_property
    def _white_slope(self) -> Array:
        return np.asarray(self.readings.whitener @ self.readings.slope(self._initial))
