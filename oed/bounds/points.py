"""Bounds for systems without states, whose F adds up over points: settings of the inputs in a box.

By the equivalence theorem of concave criteria [Kiefer, Wolfowitz, The equivalence of two extremum problems,
1960] the optimal shares of points have a supergradient Z, and N points satisfy tr(Z F) <= N max tr(Z M(x)).
The maximum of this sensitivity function is enclosed over all points x.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import casadi as ca
import numpy as np
import scipy

from oed.bounds.boxes import Landscape, largest, peaks
from oed.bounds.certificate import Bound
from oed.bounds.mixtures import Mixture, best_mixture
from oed.foundation.arguments import typed
from oed.foundation.arrays import Array, Bools, Places
from oed.foundation.errors import ProblemError, UserMistake
from oed.kernel.criteria import Criterion
from oed.kernel.dynamics.expression import Expression
from oed.kernel.measurement.measurement import Sensor
from oed.kernel.measurement.readings import moment_reading
from oed.kernel.problem import Problem

GRID = {1: 201, 2: 17, 3: 6, 4: 4, 5: 3}
"""Number of grid values of each input, by the number of inputs."""
DRAWN = 256
"""Number of first points of systems with more inputs."""
FIRST = 60
"""Number of grid points in the first mixture."""
MOST = 60
"""Largest number of points in a mixture."""
ROUNDS = 25
"""Largest number of exchanges of points."""
LOST = 1e-14
"""Rounding error of a sum with cancellation, as a share of the sum of its magnitudes."""
PROOFS = 3
"""Largest number of proofs; each may find a point that the search has missed."""
CONVERGED = 1e-10
"""Gap between the bound of the best points and their value at which the exchange ends."""
PRESENT = 1e-6
"""Share of all readings below which a point is dropped."""
TOP = 6
"""Number of grid points from which maxima are sought, besides the mixture's points."""
METHOD = "the equivalence theorem, the sensitivity function enclosed over all points by branch and bound"
"""Method of these bounds, in words."""
IN_BOX = "every point within the limits of its inputs"
"""An assumption, in words."""
NO_POINTS = "has no points: its system has states, or what is read is not read of each setting alone"
"""Message for problems without a sensitivity function."""


@dataclass(frozen=True)
class Points:
    """Space of designs that consist of points.

    Attributes:
        landscapes: sensitivity function of each kind of point: of each combination of readings.
        totals: number of points of each kind.
        prior: prior information, (q, q).
        judged: number of the q parameters that the criterion judges.
        low: smallest inputs, (n,).
        high: largest inputs, (n,).
    """

    landscapes: tuple[Landscape, ...]
    totals: Array
    prior: Array
    judged: int
    low: Array
    high: Array

    @cached_property
    def first(self) -> Array:
        """Points from which the search begins, (k, n)."""
        count = len(self.low)
        if count in GRID:
            axes = [np.linspace(*ends, GRID[count]) for ends in zip(self.low, self.high, strict=True)]
            return np.array(list(product(*axes)))
        drawn = scipy.stats.qmc.Sobol(count, scramble=False).random(DRAWN)
        return np.asarray(self.low + (self.high - self.low) * drawn)


def points_of(problem: Problem) -> Points | None:
    """Return the points of a problem; None if it has none, or an operation without interval bounds."""
    sensors, low, high = problem.measurement.joint_sensors, *problem.input_bounds.T
    alone = all(sensor.when != "between samples" and sensor.joint_whitening is None for sensor in sensors)
    plain = not any(sensor.nuisances for sensor in sensors) and len(problem.any_estimations) == 1
    if problem.system.states or not sensors or not alone or not plain:
        return None
    if not np.isfinite(problem.input_bounds).all():
        return None
    (estimation,) = problem.any_estimations
    judged, count = len(estimation.judged), len(estimation.parameters)
    scales = np.concatenate([estimation.scales, np.ones(count - judged)])
    columns = [estimation.block.parameters.index(name) for name in estimation.parameters]
    inputs, period = ca.SX.sym("inputs", len(low)), ca.SX.sym("period")
    rows = [_rows(problem, sensor, inputs, period)[:, columns] @ ca.diag(ca.DM(scales)) for sensor in sensors]
    kinds = _kinds(problem, sensors)
    try:
        landscapes = [
            Landscape(inputs, ca.vertcat(*(times**0.5 * row for times, row in zip(kind, rows, strict=True))))
            for kind in kinds
        ]
    except RuntimeError:
        # CasADi refuses readings that depend on the period as well.
        return None
    if not all(landscape.is_bounded for landscape in landscapes):
        return None
    prior = np.zeros((count, count)) if estimation.prior is None else estimation.prior
    totals = np.array([float(number) for number in kinds.values()])
    return Points(tuple(landscapes), totals, prior * np.outer(scales, scales), judged, low, high)


def _rows(problem: Problem, sensor: Sensor, inputs: Expression, period: Expression) -> Expression:
    # Derivatives of a sensor's reading at a point by the parameters, in units of the noise.
    system, size = problem.system, len(problem.system.parameters)
    arguments = ca.SX(0, 1), ca.SX(0, size), inputs, ca.DM(system.nominal), ca.SX(0, 1), period
    return moment_reading(sensor, system)(*arguments)[4].T


def _kinds(problem: Problem, sensors: tuple[Sensor, ...]) -> dict[tuple[int, ...], int]:
    # Number of settings with each combination of readings per sensor.
    samples, runs = problem.design.samples, problem.design.runs
    read = np.zeros((samples, len(sensors)), dtype=int)
    for place, sensor in enumerate(sensors):
        # The inputs at the last sample are those of the last period.
        np.add.at(read[:, place], np.minimum(sensor.columns(samples), samples - 1), 1)
    kinds = Counter(tuple(row) for row in read.tolist() if any(row))
    # In descending order of readings.
    return {kind: runs * kinds[kind] for kind in sorted(kinds, key=sum, reverse=True)}


def point_bounds(problem: Problem) -> Iterator[Bound]:
    """Yield a bound on E, D and A for systems without states, all runs together."""
    points = points_of(problem) if problem.criterion.conjugate else None
    if points is None:
        return
    neglected = [limit.name for limit in problem.limits if not limit.input_bounds(problem.model)]
    omissions = [f"{', '.join(neglected)} left out"] if neglected else []
    bound = _Search(problem.criterion, points).run()
    if bound is not None:
        value, multiplier = bound
        yield Bound(value, METHOD, (IN_BOX, *omissions), multiplier)


class _Search:
    """Exchange of points until none is more informative, followed by a proof of that.

    Attributes:
        points: that are known, (k, n).
        groups: of which kind each is, (k,).
        matrices: information at each, (k, q, q).
    """

    def __init__(self, criterion: Criterion, design: Points) -> None:
        self.criterion, self.design = criterion, design
        self.points, self.groups = np.zeros((0, len(design.low))), np.zeros(0, dtype=np.int64)
        self.matrices = np.zeros((0, len(design.prior), len(design.prior)))
        chosen = np.unique(np.linspace(0, len(design.first) - 1, FIRST).round().astype(int))
        for group in range(len(design.totals)):
            self._add(group, design.first[chosen])

    def run(self) -> tuple[float, Array] | None:
        """Return the bound and its Z; None if no points identify all parameters or a maximum is infinite."""
        best: tuple[float, Array] | None = None
        for _ in range(PROOFS):
            mixture = self._exchanged()
            if mixture is None:
                return best
            factor, most, has_new_points = _factor(mixture.multiplier), 0.0, False
            for group, landscape in enumerate(self.design.landscapes):
                points = self.points[self.groups == group]
                before = float(landscape.at(points, factor)[0].max())
                proved = largest(landscape, factor, self.design.low, self.design.high, points)
                magnitudes = np.abs(self.matrices[self.groups == group])
                terms = np.einsum("ab,kab->k", np.abs(mixture.multiplier), magnitudes).max()
                most += self.design.totals[group] * (proved.upper + LOST * float(terms))
                if proved.value > before * (1 + CONVERGED):
                    has_new_points = True
                    self._add(group, proved.point[None])
            if not np.isfinite(most):
                return None
            bound = self._bound(mixture, most)
            if best is None or bound < best[0]:
                best = bound, mixture.multiplier
            if not has_new_points:
                break
        return best

    def _add(self, group: int, points: Array) -> None:
        matrices = np.stack([self.design.landscapes[group].matrix(point) for point in points])
        # Points with infinite information cannot be chosen.
        finite = np.isfinite(matrices).all(axis=(1, 2))
        self.points = np.concatenate([self.points, points[finite]])
        self.matrices = np.concatenate([self.matrices, matrices[finite]])
        self.groups = np.concatenate([self.groups, np.full(int(finite.sum()), group)])

    def _keep(self, chosen: Places) -> None:
        self.points, self.groups = self.points[chosen], self.groups[chosen]
        self.matrices = self.matrices[chosen]

    def _exchanged(self) -> Mixture | None:
        # The best mixture after exchanges of points until none improves it.
        design, best, kinds = self.design, None, range(len(self.design.totals))
        for _ in range(ROUNDS):
            mixture = best_mixture(
                self.criterion, self.matrices, design.prior, design.judged, self.groups, design.totals
            )
            if mixture is None:
                break
            best, factor = mixture, _factor(mixture.multiplier)
            present = mixture.weights > PRESENT * design.totals[self.groups]
            before = most = 0.0
            maxima = []
            for group in kinds:
                landscape, members = design.landscapes[group], self.groups == group
                grid = design.first[np.argsort(-landscape.at(design.first, factor)[0])[:TOP]]
                starts = np.concatenate([self.points[members & present], grid])
                maxima.append(peaks(landscape, factor, design.low, design.high, starts))
                most += design.totals[group] * float(landscape.at(maxima[-1], factor)[0].max())
                before += design.totals[group] * float(landscape.at(self.points[members], factor)[0].max())
            gain = self._bound(mixture, most), self._bound(mixture, before)
            self._keep(self._distinct(mixture.weights, present))
            merged = [self._merge(group, maxima[group]) for group in kinds]
            if self.criterion.change(*gain, design.judged) <= CONVERGED or not any(merged):
                break
        return best

    def _distinct(self, weights: Array, present: Bools) -> Places:
        # The present points with the largest shares, without duplicates of equal information.
        chosen: list[int] = []
        sizes = np.sqrt(np.abs(self.matrices).max(axis=0)) + np.finfo(float).tiny
        scaled = self.matrices / (sizes.diagonal()[:, None] * sizes.diagonal())
        for place in np.argsort(-weights)[: int(present.sum())].tolist():
            same = np.abs(scaled[chosen] - scaled[place]).max(axis=(1, 2), initial=0.0) <= SAME
            if len(chosen) < MOST and not np.any(same & (self.groups[chosen] == self.groups[place])):
                chosen.append(place)
        return np.array(sorted(chosen))

    def _merge(self, group: int, candidates: Array) -> bool:
        # Adds candidates that are new; True if there are any.
        before = len(self.points)
        width = np.where(self.design.high > self.design.low, self.design.high - self.design.low, 1.0)
        for candidate in candidates:
            members = self.points[self.groups == group]
            if np.abs((members - candidate) / width).max(axis=1).min(initial=np.inf) > SAME:
                self._add(group, candidate[None])
        return len(self.points) > before

    def _bound(self, mixture: Mixture, most: float) -> float:
        judged, prior = self.design.judged, float(np.sum(mixture.multiplier * self.design.prior))
        return self.criterion.trace_bound(mixture.multiplier[:judged, :judged], most + prior)


SAME = 1e-6
"""Difference of duplicate points, as a share of the inputs' ranges or of the information."""


def _factor(multiplier: Array) -> Array:
    # Root U of a multiplier Z = U'U.
    values, vectors = np.linalg.eigh(multiplier)
    return np.asarray(np.sqrt(np.clip(values, 0.0, None))[:, None] * vectors.T)


@typed
def sensitivity_function(problem: Problem, multiplier: Array, count: int = 401) -> tuple[Array, Array]:
    """Return the sensitivity function tr(Z M(x)) over the range of the only input.

    It is largest at the points of an optimal design [Fedorov, Theory of Optimal Experiments, 1972].

    Args:
        problem: problem of a system without states, with one input.
        multiplier: multiplier Z, (q, q), e.g. of a certificate.
        count: number of values of the input.

    Returns:
        Values x of the input, SI, and tr(Z M(x)) at them, (count,) each, for the kind of point with the most
        readings.

    Raises:
        ProblemError: the problem has no points.
        UserMistake: the system has several inputs, or the multiplier another size.
    """
    points = points_of(problem)
    if points is None:
        raise ProblemError.about(("model",), NO_POINTS)
    if len(points.low) != 1:
        raise UserMistake(f"expected a system with one input, got {len(points.low)}")
    if multiplier.shape != points.prior.shape:
        raise UserMistake(f"multiplier: expected {points.prior.shape}, got {multiplier.shape}")
    values = np.linspace(points.low[0], points.high[0], count)
    return values, points.landscapes[0].at(values[:, None], _factor(multiplier))[0]
