"""Joint nonlinear least squares of a designed drive: parameters, starts, nuisances from all sensors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from oed.estimation.methods.estimator import (
    ARRIVED,
    ASTRAY,
    LOSS_UNDER_DRIFT,
    Estimate,
    Estimator,
    EstimatorName,
)
from oed.estimation.methods.gauss_newton import loss_moments
from oed.estimation.methods.joint import JointSearch
from oed.estimation.methods.side_by_side import SideBySide
from oed.estimation.methods.smoothing import Smoother
from oed.estimation.prediction.drive_readings import DriveReadings
from oed.estimation.prediction.layout import SegmentLayout
from oed.estimation.setup.options import Loss
from oed.estimation.setup.unknowns import Knowledge, Unknowns
from oed.foundation.arrays import Array, Places
from oed.foundation.errors import ProblemError
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.measurement.blocks import Nuisance
from oed.kernel.measurement.measurement import start_nuisances
from oed.kernel.measurement.readings import labelled_nuisances
from oed.kernel.measurement.sensor import process_noise_of
from oed.kernel.measurement.square_root import SquareRoot
from oed.kernel.problem import Problem
from oed.kernel.scorer import require_shape, score
from oed.robots.models.model import Model


class Nonlinear(Estimator):
    """Least squares on all readings of one drive, weighted by their noise.

    The unknowns are the parameters that the problem estimates, the start states where they are not known,
    and the sensors' nuisances. Knowledge from before enters as further readings.

    Args:
        problem: with sensors: a robot's (`Poses`, `Ranges`, ...), or outputs (`Outputs`, `Responses`, ...).
        trajectory: the drive.
        loss: of a residual; other than "linear" it bounds the influence of outliers.

    Raises:
        ProblemError: a measurement without sensors, or parameters that are not identifiable from the drive.
        ValueError, NotFinite: a trajectory that `evaluate` does not score.
    """

    name: EstimatorName = "nonlinear"

    def __init__(self, problem: Problem, trajectory: Trajectory, loss: Loss = "linear") -> None:
        """Write the readings as functions of the unknowns."""
        sensors = problem.sensors
        if not sensors:
            text = f"joint least squares need sensors; {problem.measurement.kind} is a regression"
            raise ProblemError.about(("validation", "estimators"), text)
        if loss != "linear" and process_noise_of(sensors) is not None:
            raise ProblemError.about(("validation", "loss"), LOSS_UNDER_DRIFT)
        require_shape(problem, trajectory)
        self.problem, self.loss = problem, loss
        (estimation,) = problem.any_estimations
        self.parameters, self.true = estimation.parameters, estimation.nominal
        starts = start_nuisances(sensors, problem.system, trajectory.runs)
        own = labelled_nuisances(sensors)
        self._unknowns = _unknowns(problem, trajectory, starts, own)
        self._readings = DriveReadings.of(sensors, trajectory, self._unknowns)
        self._known = self._before([*starts, *own], estimation.prior)
        layout = SegmentLayout.of_drive(trajectory, self._readings.by_run(self.predicted()))
        known, drive = self._known, self._readings
        self._search = JointSearch(layout, self._unknowns, np.zeros(0), known, loss, drive=drive)
        slopes = self._white_slopes(self._initial)
        if not np.all(np.isfinite(slopes)):
            # It says which number is not finite, and when.
            score(problem, trajectory)
        found = SquareRoot.of_rows(self._with_known(slopes))
        if not found.complete:
            text = f"the drive does not identify {', '.join(self.parameters)}; nothing to estimate"
            raise ProblemError.about(("validation",), text)
        if not isinstance(problem.system, Model):
            # Unlike a robot's, states are of any size, and may begin at 0.
            sizes = np.maximum(np.abs(self._initial), np.linalg.norm(found.factor, axis=1))
            sized = replace(self._unknowns, sizes=tuple(sizes.tolist()))
            self._search = replace(self._search, unknowns=sized)

    @property
    def nuisances(self) -> tuple[str, ...]:
        """Names of the nuisance parameters."""
        names = self._unknowns.names
        return tuple(name for place, name in enumerate(names) if place not in self._places)

    @cached_property
    def _places(self) -> list[int]:
        # Of the parameters among the unknowns: those of the system, then the sensors' constants.
        asked = {name: one.name for name, one in self.problem.constants.items()}
        return [self._unknowns.names.index(asked.get(name, name)) for name in self.parameters]

    @cached_property
    def covariance(self) -> Array:
        """F^-1; with a robust loss, its covariance under the Gaussian noise that the problem specifies."""
        return self._covariance(self.loss, self._initial)

    @cached_property
    def linear_covariance(self) -> Array:
        """F^-1, of the linearised least squares."""
        return self._covariance("linear", self._initial)

    def predicted(self) -> Array:
        """The noise-free readings at the nominal values, (M,), SI."""
        return np.concatenate([found.ravel() for found in self._readings.nominal])

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
        if self._smoother is not None:
            return self._smoothed(self._readings.unwrapped(measured), known)
        fit = self._searching(self._readings.unwrapped(measured), known).fit()
        residuals = self._readings.by_sensor(fit.white)
        covariance = self._covariance(self.loss, fit.values)
        return Estimate.of(fit, covariance, residuals, self._places, self.parameters)

    def _smoothed(self, measured: Array, before: Array) -> Estimate:
        # Of a process that errs: innovations are what the readings say beyond their prediction.
        assert self._smoother is not None
        found = self._smoother.solved(measured[None], self._known, before[None])
        values, names, places = found.values[0], self._unknowns.names, self._places
        rest = [place for place in range(len(names)) if place not in places]
        return Estimate(
            parameters=self.parameters,
            values=values[places],
            covariance=self._covariance(self.loss, values),
            residuals=self._readings.by_sensor(-found.innovations),
            nuisances=tuple(names[place] for place in rest),
            nuisance_values=values[rest],
            converged=bool(found.arrived[0]),
            message=ARRIVED if found.arrived[0] else ASTRAY,
        )

    def simulate(self, rng: np.random.Generator, count: int) -> tuple[Array, Array]:
        """Estimates (count, p) from simulated readings, and the linearised estimates of the same noise."""
        places, gain = self._places, self._gain[self._places]
        linear = np.empty((count, len(places)))
        readings, known = np.empty((count, len(self.predicted()))), np.tile(self._initial, (count, 1))
        for index in range(count):
            readings[index], white = self._readings.simulated(rng)
            surprise = rng.standard_normal(len(self._known_places))
            known[index, self._known_places] += self._spread @ surprise
            linear[index] = self.true + gain @ np.concatenate([white, surprise])
        if self._smoother is not None:
            found = self._smoother.solved(readings, self._known, known).values
        else:
            found = self._least_squares(readings, known)
        return found[:, places], linear

    def _least_squares(self, readings: Array, known: Array) -> Array:
        # The unknowns (R, q) by readings (R, M): side by side as far as that leads.
        found, arrived = np.empty((len(readings), len(self._initial))), np.zeros(len(readings), dtype=bool)
        together = SideBySide(self._search.least_squares, self._readings)
        if self.loss == "linear" and together.most > 1:
            runs = readings[:, self._readings.order].reshape(len(readings), self._search.layout.count, -1)
            for first in range(0, len(readings), together.most):
                own = slice(first, first + together.most)
                found[own], arrived[own] = together.solved(runs[own], known[own], self._initial)
        for index in np.flatnonzero(~arrived):
            found[index] = self._searching(readings[index], known[index]).found().values
        return found

    @cached_property
    def _smoother(self) -> Smoother | None:
        # Of a process that errs the path is searched for as well.
        walk = self._readings.walk
        if walk is None:
            return None
        return Smoother(walk.sensors, walk.trajectory, walk.noise, self._search.unknowns)

    def _searching(self, measured: Array, before: Array) -> JointSearch:
        layout = replace(self._search.layout, readings=self._readings.by_run(measured)[..., None])
        return replace(self._search, layout=layout, known=replace(self._known, centre=before))

    def _covariance(self, loss: Loss, unknowns: Array) -> Array:
        # H^-1 M H^-1 with H = E[psi'] J'J + P and M = E[psi^2] J'J + P; F^-1 for psi(z) = z.
        slopes, (slope, square) = self._white_slopes(unknowns), loss_moments(loss)
        factor = SquareRoot.of_rows(self._with_known(np.sqrt(slope) * slopes)).factor
        spread = self._with_known(np.sqrt(square) * slopes) @ factor @ factor.T
        return np.asarray((spread.T @ spread)[np.ix_(self._places, self._places)])

    @cached_property
    def _gain(self) -> Array:
        # (unknowns, M + known): linearised least squares, from standard normal noise to errors.
        rows = self._with_known(self._white_slopes(self._initial))
        factor = SquareRoot.of_rows(rows).factor
        return np.asarray(factor @ (rows @ factor).T)

    def _white_slopes(self, unknowns: Array) -> Array:
        # Derivatives of the readings (M, unknowns), in units of the noise, run by run.
        starts = np.zeros((self._search.layout.count, 0))
        return self._search.at_first(unknowns, starts).slopes.reshape(-1, len(unknowns))

    def _with_known(self, slopes: Array) -> Array:
        # What is known, below these as if it had been read.
        known = np.zeros((len(self._known_places), len(self._initial)))
        known[:, self._known_places] = np.linalg.inv(self._spread)
        return np.vstack([slopes, known])

    @property
    def _initial(self) -> Array:
        return self._unknowns.nominal

    def _before(self, nuisances: Sequence[Nuisance], prior: Array | None) -> Knowledge:
        deviations = [entry.deviation or np.inf for entry in nuisances]
        found = np.diag([*[0.0] * len(self._unknowns.parameters), *(size**-2 for size in deviations)])
        if prior is not None:
            found[np.ix_(self._places, self._places)] = prior
        return Knowledge(found, self._initial)

    @cached_property
    def _known_places(self) -> Places:
        return np.flatnonzero(np.diag(self._known.information))

    @cached_property
    def _spread(self) -> Array:
        # From standard normal numbers to what is known from before, (known, known).
        own = self._known.on(self._known_places).information
        return np.asarray(np.linalg.cholesky(np.linalg.inv(own)))


def _unknowns(
    problem: Problem, trajectory: Trajectory, starts: Sequence[Nuisance], own: Sequence[Nuisance]
) -> Unknowns:
    # The parameters to estimate, the starts that are not known, the sensors' own constants.
    (estimation,) = problem.any_estimations
    return Unknowns(
        problem.system,
        tuple(name for name in estimation.parameters if name not in problem.constants),
        tuple(one.name for one in own),
        clocks=0,
        sits=tuple(one.nominal for one in own),
        constants={one.name: one.unit for one in own},
        starts=tuple(
            replace(one, nominal=at) for one, at in zip(starts, trajectory.starts.ravel(), strict=False)
        ),
    )
