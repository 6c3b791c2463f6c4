"""Least squares on displacements: the paper's two stages, and what does them better.

First c11, c12 from the turns [Choi, eq. 12], then c21, c22 from the displacements, with headings that are
known, predicted by the first stage [Choi, eq. 16], or measured at every sample.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import scipy

from oed.estimation.methods.bands import band_of, factor, weighted, whitened
from oed.estimation.methods.estimator import Estimate, Estimator, EstimatorName
from oed.estimation.methods.fit import Fit
from oed.estimation.methods.measured_headings import (
    MeasuredHeadings,
    corrected,
    corrected_covariance,
    least_squares,
)
from oed.estimation.prediction.layout import SegmentLayout
from oed.estimation.prediction.regressors import Regressors
from oed.estimation.setup.unknowns import Unknowns
from oed.foundation.arrays import Array
from oed.foundation.errors import ProblemError
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.measurement.measurement import Measurement
from oed.kernel.measurement.square_root import SquareRoot
from oed.kernel.problem import Problem
from oed.robots.models.model import robot_of
from oed.robots.sensors.displacements import Displacements
from oed.robots.sensors.logged import Noise

Heading = Literal["known", "predicted", "measured"]
"""Which headings the position regression of displacements uses."""

WIDTH = 2
"""How many rows on of a displacement's coordinate are correlated with it at most."""
LINEAR = "Solved by linear least squares."
METHODS: tuple[EstimatorName, ...] = ("ols", "sandwich", "gls", "errors_in_variables")


def missing_noise(measurement: Measurement, heading: Heading) -> list[str]:
    """The noises that a simulation with such headings needs and the measurement does not give."""
    if not isinstance(measurement, Displacements):
        return []
    needed = set(measurement.regressions) | (set() if heading == "known" else {"heading"})
    return sorted(name for name in needed if getattr(measurement.noise, name) is None)


class Regression(Estimator):
    """Least squares on the displacements of one drive.

    `ols` predicts the paper's sigma^2 (W'W)^-1, as if rows were independent and headings exact; `sandwich`
    estimates the same and predicts its covariance under all the noise there is, to first order; `gls`
    weights by the noise's covariance; `errors_in_variables` takes out the bias that noisy headings inside W
    cause.

    Raises:
        ProblemError: coefficients that are not identifiable from the drive.
    """

    def __init__(
        self, problem: Problem, trajectory: Trajectory, name: EstimatorName, heading: Heading = "known"
    ) -> None:
        """Compute the regressors at the true coefficients."""
        measurement = problem.measurement
        assert isinstance(measurement, Displacements)
        self.name, self.heading, self.measurement = name, heading, measurement
        self.regressors = Regressors(robot_of(problem.model), measurement, trajectory)
        chosen = measurement.regressions
        self.parameters = tuple(entry for block in chosen for entry in self.regressors.names[block])
        self.true = np.concatenate([self.regressors.true[block] for block in chosen])
        self._maps: dict[str, Array] = {}
        self._spreads: dict[str, Any] = {}
        self._check_rank()

    @cached_property
    def covariance(self) -> Array:
        """The method's own formula."""
        if self.name == "sandwich":
            return self.linear_covariance
        blocks = []
        for name in self.measurement.regressions:
            weighted = self._weighted(name)
            inverse = np.linalg.inv(weighted.T @ weighted)
            # Unweighted, every row counts with its own variance, as if it were independent of the others.
            variance = self._noise(name) ** 2 if self._weights else self._covariance(name)[0, 0]
            blocks.append(variance * inverse)
        if self.name == "errors_in_variables":
            blocks = [self._linear_block(name, name) for name in self.measurement.regressions]
            if "position" in self.measurement.regressions:
                blocks[-1] = self._corrected_covariance()
        return np.asarray(scipy.linalg.block_diag(*blocks))

    @cached_property
    def linear_covariance(self) -> Array:
        """First-order covariance under all the noise that is simulated."""
        chosen = self.measurement.regressions
        return np.asarray(
            np.block([[self._linear_block(row, column) for column in chosen] for row in chosen])
        )

    def _linear_block(self, row: str, column: str) -> Array:
        rows, columns = self._effects(row), self._effects(column)
        found = np.zeros((len(rows[row]), len(columns[column])))
        for source in (one for one in rows if one in columns):
            found += rows[source] @ self._covariance(source) @ columns[source].T
        return found

    def _effects(self, name: str) -> dict[str, Array]:
        # What errors of turns ("heading"), displacements ("position") and measured headings ("headings") do
        # to the estimates of a regression to first order, (q, errors) each.
        found = {name: self._map(name)}
        if name == "position" and self.heading == "predicted":
            # Headings predicted from the first stage's estimates carry their errors along.
            found["heading"] = -self._map(name) @ self.regressors.heading_effect @ self._map("heading")
        if name == "position" and self.heading == "measured":
            found["headings"] = -self._map(name) @ self._turned
        return found

    def simulate(self, rng: np.random.Generator, count: int) -> tuple[Array, Array]:
        """Estimates (count, p) from simulated noise, and the linear estimates from the same noise."""
        designs, true = self.regressors.nominal_designs, self.regressors.true
        noise = {name: self._draw(rng, name, count) for name in self._simulated}
        readings = {name: noise[name] + designs[name] @ true[name] for name in noise}
        effects = {name: self._effects(name) for name in self.measurement.regressions}
        linear = {
            name: true[name] + sum(noise[source] @ own[source].T for source in own if source in noise)
            for name, own in effects.items()
        }
        if "headings" not in effects.get("position", ()):
            return self._estimates(readings), np.hstack(list(linear.values()))
        estimates = []
        for own in self._measured_headings.blocks(count):
            errors = rng.standard_normal((own.stop - own.start, self.regressors.trajectory.samples))
            errors *= self._noise("heading")
            linear["position"][own] += errors @ effects["position"]["headings"].T
            estimates.append(self._estimates({name: rows[own] for name, rows in readings.items()}, errors))
        return np.concatenate(estimates), np.hstack(list(linear.values()))

    def fit(
        self,
        *,
        turns: npt.ArrayLike | None = None,
        displacements: npt.ArrayLike | None = None,
        headings: npt.ArrayLike | None = None,
    ) -> Estimate:
        """Estimate from the readings of one drive.

        Args:
            turns: of the segments, (P,) [rad]; for the heading regression and for predicted headings.
            displacements: x and y of each segment in turn, (2 P,) [m]; for the position regression.
            headings: in the middle of every period, (N,) [rad]; where the method uses measured ones.

        Raises:
            ValueError: readings missing, of another number, or not finite.
        """
        given = {"heading": ("turns", turns), "position": ("displacements", displacements)}
        designs = self.regressors.nominal_designs
        readings = {
            name: _readings(*given[name], expected=len(designs[name]))[None] for name in self._simulated
        }
        errors = None
        if self.heading == "measured" and "position" in readings:
            measured = _readings("headings", headings, expected=self.regressors.trajectory.samples)
            errors = (measured - self.regressors.directions)[None]
        fit = self._fit(readings, self._estimates(readings, errors)[0], errors)
        each = np.split(fit.white[..., 0], [1] if "heading" in self.measurement.regressions else [], axis=1)
        return Estimate.of(
            fit, self.covariance, np.concatenate([part.ravel() for part in each]), message=LINEAR
        )

    def _fit(self, readings: dict[str, Array], values: Array, errors: Array | None) -> Fit:
        # Over the measurement's segments, whose readings are the turn, the displacement or both. Information
        # and scores are those of the regressions as they are weighted, with the headings that were used.
        found, edges = self._columns(readings, values, errors), self.regressors.edges
        measured, left, white, pull = np.moveaxis(found[..., :4], -1, 0)
        rows = found[..., 4:]
        information = np.einsum("sia,sib->sab", rows, rows)
        inverse = np.linalg.inv(information.sum(axis=0))
        times = np.asarray(self.regressors.trajectory.period * np.stack([edges[:-1], edges[1:]], axis=1))
        valid, still = np.ones((*measured.shape, 1), dtype=bool), np.zeros(measured.shape)
        return Fit(
            unknowns=Unknowns(self.regressors.robot, self.parameters, (), 0),
            values=values,
            offsets=np.zeros(0),
            starts=np.zeros((len(measured), 0)),
            layout=SegmentLayout((), np.arange(len(measured)), times, measured[..., None], valid, math.inf),
            residuals=left[..., None],
            white=white[..., None],
            weights=np.ones((*measured.shape, 1)),
            redundancy=1 - np.einsum("sia,ab,sib->si", rows, inverse, rows)[..., None],
            noises={name: Noise(self._noise(name)) for name in self.measurement.regressions},
            speeds=still,
            yaw_rates=still,
            information=information,
            scores=np.einsum("sia,si->sa", rows, pull),
            knowledge=np.zeros(inverse.shape),
            converged=True,
        )

    def _columns(self, readings: dict[str, Array], values: Array, errors: Array | None) -> Array:
        # Of each segment: what was read, what is left of it, that whitened, that as it is weighted, and
        # the regressors as they are weighted, (segments, rows, 4 + parameters).
        parts, first, turned = [], 0, self._position_designs(readings, errors)
        for name in self.measurement.regressions:
            design = self.regressors.nominal_designs[name]
            if name == "position" and turned is not None:
                design = turned[..., 0]
            rows = np.zeros((len(design), len(values)))
            rows[:, first : first + design.shape[1]] = design
            first += design.shape[1]
            own = np.column_stack([readings[name][0] - rows @ values, rows])
            white = whitened(self._roots[name], own / self._noise(name))
            weighted = white if self._weights else own / self._noise(name)
            both = np.column_stack([readings[name][0], own[:, 0], white[:, 0], weighted])
            parts.append(both.reshape(len(self.regressors.edges) - 1, -1, both.shape[1]))
        return np.concatenate(parts, axis=1)

    def _estimates(self, readings: dict[str, Array], errors: Array | None = None) -> Array:
        # Of replicates (R, rows) by regression, with heading errors (R, N) where headings are measured.
        found = {name: rows @ self._map(name).T for name, rows in readings.items()}
        designs = self._position_designs(readings, errors)
        if designs is not None:
            found["position"] = self._solved(designs, readings["position"].T)
        return np.hstack([found[name] for name in self.measurement.regressions])

    def _position_designs(self, readings: dict[str, Array], errors: Array | None) -> Array | None:
        # W of replicates, (2 P, q, R), where it is not that of the true headings.
        if self.heading == "predicted" and "position" in readings:
            first_stage = readings["heading"] @ self._map("heading").T
            return self.regressors.predicted_positions(first_stage).transpose(1, 2, 0)
        return None if errors is None else self._measured_headings.designs(errors)

    def _solved(self, designs: Array, measured: Array) -> Array:
        # Estimates (R, q) of replicates, (2 P, q, R) and (2 P, R).
        if self.name == "errors_in_variables":
            return corrected(designs, measured, self.regressors.per_sample, self._noise("heading"))
        if self._weights:
            root, rows = self._roots["position"], designs.reshape(len(designs), -1)
            designs, measured = whitened(root, rows).reshape(designs.shape), whitened(root, measured)
        return least_squares(designs, measured)

    def _corrected_covariance(self) -> Array:
        edges = self.regressors.edges
        return corrected_covariance(
            self.regressors.per_sample[:, 0] + 1j * self.regressors.per_sample[:, 1],
            edges,
            self.regressors.true["position"],
            heading_noise=self._noise("heading"),
            spread=self.regressors.nominal_designs["position"].T
            @ self._covariance("position")
            @ self.regressors.nominal_designs["position"],
            variance=float(self._covariance("position")[0, 0]),
        )

    @property
    def _simulated(self) -> tuple[str, ...]:
        # The two-stage estimator needs the turns even where only positions are asked for.
        chosen = self.measurement.regressions
        first = self.heading == "predicted" and "heading" not in chosen
        return ("heading", *chosen) if first else chosen

    def _noise(self, name: str) -> float:
        return float(getattr(self.measurement.noise, name) or 0.0)

    def _spread(self, name: str) -> Any:
        if name not in self._spreads:
            self._spreads[name] = self._spread_of(name)
        return self._spreads[name]

    def _spread_of(self, name: str) -> Any:
        # D (rows, draws) of noise sigma D z, z white: neighbours share the error of the pose between them.
        rows = len(self.regressors.nominal_designs[name])
        if self.measurement.noise_model == "increments":
            return scipy.sparse.eye_array(rows, format="csr")
        coordinates, runs = 2 if name == "position" else 1, self.regressors.trajectory.runs
        segments = rows // coordinates // runs
        steps = scipy.sparse.diags_array([-1.0, 1.0], offsets=[0, 1], shape=(segments, segments + 1))
        one_run = scipy.sparse.kron(steps, scipy.sparse.eye_array(coordinates))
        return scipy.sparse.kron(scipy.sparse.eye_array(runs), one_run, format="csr")

    def _covariance(self, name: str) -> Array:
        if name == "headings":
            return np.asarray(self._noise("heading") ** 2 * np.eye(self.regressors.trajectory.samples))
        spread = self._noise(name) * self._spread(name)
        return np.asarray((spread @ spread.T).toarray())

    def _draw(self, rng: np.random.Generator, name: str, count: int) -> Array:
        spread = self._spread(name)
        return np.asarray(self._noise(name) * (rng.standard_normal((count, spread.shape[1])) @ spread.T))

    @cached_property
    def _roots(self) -> dict[str, Array]:
        # Bands of the noise's covariance, its size apart, as factors of which rows are whitened.
        spreads = {name: self._spread(name) for name in ("heading", "position")}
        return {name: factor(band_of(spread @ spread.T, WIDTH)) for name, spread in spreads.items()}

    @property
    def _weights(self) -> bool:
        return self.name == "gls" and self.measurement.noise_model == "absolute"

    def _weighted(self, name: str) -> Array:
        design = self.regressors.nominal_designs[name]
        return whitened(self._roots[name], design) if self._weights else design

    def _map(self, name: str) -> Array:
        # (q, rows): the estimator at the true design, from readings to coefficients.
        if name not in self._maps:
            inverse = np.asarray(np.linalg.pinv(self._weighted(name)).T, dtype=float)
            self._maps[name] = (weighted(self._roots[name], inverse) if self._weights else inverse).T
        return self._maps[name]

    @cached_property
    def _turned(self) -> Array:
        # (2 P, N): how a heading's error at one sample moves the displacement computed for its segment.
        moves = self.regressors.per_sample @ self.regressors.true["position"]
        samples, edges = len(moves), self.regressors.edges
        segment = np.repeat(np.arange(len(edges) - 1), np.diff(edges))
        matrix = np.zeros((2 * (len(edges) - 1), samples))
        matrix[2 * segment, np.arange(samples)] = -moves[:, 1]
        matrix[2 * segment + 1, np.arange(samples)] = moves[:, 0]
        return matrix

    @cached_property
    def _measured_headings(self) -> MeasuredHeadings:
        return MeasuredHeadings(self.regressors.per_sample, self.regressors.edges)

    def _check_rank(self) -> None:
        for name in self._simulated:
            design = self.regressors.nominal_designs[name]
            if not SquareRoot.of_rows(design).complete:
                names = ", ".join(self.regressors.names[name])
                text = f"the drive does not identify {names}; nothing to simulate"
                raise ProblemError.about(("validation",), text)


def _readings(what: str, values: npt.ArrayLike | None, *, expected: int) -> Array:
    array = np.zeros(0) if values is None else np.asarray(values, dtype=float).ravel()
    if len(array) != expected or not np.all(np.isfinite(array)):
        raise ValueError(f"expected {expected} finite {what}, got {len(array)}")
    return array
