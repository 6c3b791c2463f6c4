"""Joint nonlinear least squares: parameters, initial pose and nuisances from all sensors' readings."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy

from oed.estimation.methods.estimate import Estimate
from oed.estimation.methods.estimator import Estimator, EstimatorName
from oed.estimation.methods.losses import loss_moments, robust_loss
from oed.estimation.prediction.readings import PredictedReadings
from oed.estimation.setup.options import Loss
from oed.foundation.errors import Flaw, ProblemError
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.problem import Problem
from oed.robots.sensors.several import sensors_of

Array = npt.NDArray[np.float64]


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
        sensors = sensors_of(problem.measurement)
        if not sensors:
            text = f"joint least squares need sensors; {problem.measurement.kind} is a regression"
            raise ProblemError([Flaw(("validation", "estimators"), text)])
        self.problem, self.loss = problem, loss
        (estimation,) = problem.any_estimations
        self.parameters, self.true = estimation.parameters, estimation.nominal
        self.readings = PredictedReadings(
            problem.robot, problem.design.integration, sensors, trajectory, self.parameters
        )
        self._initial = self.readings.initial
        self._check_rank()

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
        found = self._least_squares(measured, known)
        count = len(self.parameters)
        return Estimate(
            parameters=self.parameters,
            values=found.x[:count] * self._scale[:count],
            covariance=self._covariance(self.loss, found.x * self._scale),
            nuisances=self.nuisances,
            nuisance_values=found.x[count:] * self._scale[count:],
            residuals=-np.asarray(found.fun[: len(measured)]),
            converged=found.status > 0,
            message=str(found.message),
        )

    def replicate(self, rng: np.random.Generator, count: int) -> tuple[Array, Array]:
        """Estimates (count, p) from simulated readings, and the linearised estimates of the same noise."""
        exact, size = self.predicted(), len(self.parameters)
        gain = self._gain
        estimates, linear = np.empty((count, size)), np.empty((count, size))
        for index in range(count):
            white = rng.standard_normal(len(exact))
            surprise = rng.standard_normal(len(self._known))
            before = self._initial.copy()
            before[self._known] += self._root @ surprise
            measured = exact + self.readings.colour @ white
            estimates[index] = self._least_squares(measured, before).x[:size] * self._scale[:size]
            linear[index] = self.true + (gain @ np.concatenate([white, surprise]))[:size]
        return estimates, linear

    def _least_squares(self, measured: Array, before: Array) -> Any:
        # Unknowns in units of their nominal size, so that one tolerance serves them all.
        readings, whitener, scale = self.readings, self.readings.whitener, self._scale
        root = np.linalg.inv(self._root) if self._known else np.zeros((0, 0))

        def residuals(scaled: Array) -> Array:
            unknowns = scaled * scale
            misfit = whitener @ (readings.response(unknowns) - measured)
            return np.concatenate([misfit, root @ (unknowns - before)[self._known]])

        def jacobian(scaled: Array) -> Array:
            rows = whitener @ readings.slope(scaled * scale)
            chosen = np.zeros((len(self._known), len(scale)))
            chosen[np.arange(len(self._known)), self._known] = 1.0
            return np.asarray(np.vstack([rows, root @ chosen]) * scale)

        start = self._initial / scale
        if self.loss == "linear":
            return scipy.optimize.least_squares(
                residuals, start, jacobian, method="lm", xtol=1e-12, ftol=1e-12, gtol=1e-12
            )
        return scipy.optimize.least_squares(
            residuals, start, jacobian, loss=self._partly_robust(len(measured)), xtol=1e-10, ftol=1e-12
        )

    def _partly_robust(self, robust: int) -> Any:
        # Knowledge from before has no outliers.
        def rho(squares: Array) -> Array:
            values = np.vstack([squares, np.ones_like(squares), np.zeros_like(squares)])
            values[:, :robust] = robust_loss(self.loss, squares[:robust])
            return np.asarray(values)

        return rho

    def _covariance(self, loss: Loss, unknowns: Array | None = None) -> Array:
        # H^-1 M H^-1 with H = E[psi'] J'J + P and M = E[psi^2] J'J + P; F^-1 for psi(z) = z.
        rows = self._white_slope
        if unknowns is not None:
            rows = self.readings.whitener @ self.readings.slope(unknowns)
        slope, square = loss_moments(loss)
        information, prior = rows.T @ rows, np.zeros((rows.shape[1],) * 2)
        prior[np.ix_(self._known, self._known)] = np.linalg.inv(self._root @ self._root.T)
        scale = np.outer(self._scale, self._scale)
        inverse = np.linalg.inv((slope * information + prior) * scale) * scale
        covariance = inverse @ (square * information + prior) @ inverse
        size = len(self.parameters)
        return np.asarray(covariance[:size, :size])

    @cached_property
    def _gain(self) -> Array:
        # (unknowns, M + known): linearised least squares, from standard normal noise to errors.
        rows = np.vstack([self._white_slope, self._known_rows])
        return np.asarray((np.linalg.pinv(rows * self._scale).T * self._scale).T)

    @property
    def _known_rows(self) -> Array:
        rows = np.zeros((len(self._known), len(self._initial)))
        if self._known:
            rows[:, self._known] = np.linalg.inv(self._root)
        return rows

    @cached_property
    def _scale(self) -> Array:
        # A unit of 1 m, 1 rad or 1 rad/s for what is nominally 0.
        sizes = np.abs(self._initial)
        sizes[len(self.true) :] = 1.0
        return np.where(sizes > 0, sizes, 1.0)

    @cached_property
    def _known(self) -> list[int]:
        # Unknowns of which something is known from before.
        prior = self.problem.prior
        places = [index for index, name in enumerate(self.parameters) if prior and name in prior.names]
        offset = len(self.parameters)
        entries = self.readings.nuisances
        return places + [offset + index for index, entry in enumerate(entries) if entry.deviation is not None]

    @cached_property
    def _root(self) -> Array:
        # Square root of the covariance of what is known from before.
        blocks, prior = [], self.problem.prior
        if prior is not None:
            (estimation,) = self.problem.any_estimations
            names = [name for name in self.parameters if name in prior.names]
            places = [self.parameters.index(name) for name in names]
            units = [estimation.units[place] for place in places]
            precision = prior.precision(names, self.true[places], units)
            blocks.append(np.linalg.cholesky(np.linalg.inv(precision)))
        entries = self.readings.nuisances
        blocks += [np.array([[entry.deviation]]) for entry in entries if entry.deviation is not None]
        return np.asarray(scipy.linalg.block_diag(*blocks)) if blocks else np.zeros((0, 0))

    @cached_property
    def _white_slope(self) -> Array:
        return np.asarray(self.readings.whitener @ self.readings.slope(self._initial))

    def _check_rank(self) -> None:
        rows = np.vstack([self._white_slope, self._known_rows]) * self._scale
        sizes = np.linalg.norm(rows, axis=0)
        if sizes.min() == 0 or np.linalg.cond(rows / sizes) > 1e10:
            text = f"the drive does not tell {', '.join(self.parameters)} apart; nothing to estimate"
            raise ProblemError([Flaw(("validation",), text)])
