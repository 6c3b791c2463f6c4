"""Bounds for systems without states: F adds up over points, each a setting of the inputs in a box.

By the equivalence theorem of concave criteria [Kiefer, Wolfowitz, The equivalence of two extremum problems,
1960] the best shares of points have a supergradient Z, and no N points inform more than tr(Z F) <= N max tr(Z
M(x)) says: the largest value of the sensitivity function, which is enclosed over all points x.
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
from oed.bounds.mixtures import Mixture, best_mixture, mixes
from oed.foundation.arguments import typed
from oed.foundation.arrays import Array, Bools, Places
from oed.foundation.errors import ProblemError, UserMistake
from oed.kernel.criteria import Criterion
from oed.kernel.dynamics.expression import Expression
from oed.kernel.measurement.measurement import Sensor
from oed.kernel.measurement.readings import moment_reading
from oed.kernel.problem import Problem

GRID = {1: 201, 2: 17, 3: 6, 4: 4, 5: 3}
"""Values of each input among the first points, by the number of inputs."""
DRAWN = 256
"""First points of systems with more inputs."""
FIRST = 60
"""Of those, with which shares are sought at first."""
MOST = 60
"""Of all points, those that are kept with the largest shares."""
ROUNDS = 25
"""How often points at which more can be learnt are added, at most."""
LOST = 1e-14
"""Share of the sum of their magnitudes that sums which cancel may have lost to rounding."""
PROOFS = 3
"""How often the proof may find a point that the search had not, at most."""
CONVERGED = 1e-10
"""Share by which the bound of the best points known may exceed what they reach."""
PRESENT = 1e-6
"""Share of all readings below which a point is left out."""
TOP = 6
"""Points of the grid from which the largest values are sought, besides those that are present."""
METHOD = "the equivalence theorem, the sensitivity function enclosed over all points by branch and bound"
"""How these bounds are proved."""
IN_BOX = "every point within the limits of its inputs"
"""An assumption, in words."""
NO_POINTS = "has no points: its system has states, or what is read is not read of each setting alone"
"""Why a problem has no sensitivity function."""


@dataclass(frozen=True)
class Points:
    """Of what a design of points is made.

    Attributes:
        landscapes: of each kind of point, by what is read there.
        totals: how many there are of each.
        known: information from before, (q, q).
        judged: how many of the q parameters the criterion judges.
        low: smallest inputs, (n,).
        high: largest inputs, (n,).
    """

    landscapes: tuple[Landscape, ...]
    totals: Array
    known: Array
    judged: int
    low: Array
    high: Array

    @cached_property
    def first(self) -> Array:
        """Points to begin with, (k, n)."""
        count = len(self.low)
        if count in GRID:
            axes = [np.linspace(*ends, GRID[count]) for ends in zip(self.low, self.high, strict=True)]
            return np.array(list(product(*axes)))
        drawn = scipy.stats.qmc.Sobol(count, scramble=False).random(DRAWN)
        return np.asarray(self.low + (self.high - self.low) * drawn)


def points_of(problem: Problem) -> Points | None:
    """The points of a problem; None where it has none, or has operations that no bounds are known for."""
    sensors, low, high = problem.measurement.joint_sensors, *problem.input_bounds.T
    alone = all(one.when != "between samples" and one.joint_whitening is None for one in sensors)
    plain = not any(one.nuisances for one in sensors) and len(problem.any_estimations) == 1
    if problem.system.states or not sensors or not alone or not plain:
        return None
    if not np.isfinite(problem.input_bounds).all():
        return None
    (one,) = problem.any_estimations
    judged, count = len(one.judged), len(one.parameters)
    scales = np.concatenate([one.scales, np.ones(count - judged)])
    own = [one.block.parameters.index(name) for name in one.parameters]
    inputs, period = ca.SX.sym("inputs", len(low)), ca.SX.sym("period")
    rows = [_rows(problem, sensor, inputs, period)[:, own] @ ca.diag(ca.DM(scales)) for sensor in sensors]
    kinds = _kinds(problem, sensors)
    try:
        landscapes = [
            Landscape(inputs, ca.vertcat(*(times**0.5 * row for times, row in zip(kind, rows, strict=True))))
            for kind in kinds
        ]
    except RuntimeError:
        # Not even a function of the inputs alone, where the period matters.
        return None
    if not all(landscape.is_bounded for landscape in landscapes):
        return None
    prior = np.zeros((count, count)) if one.prior is None else one.prior
    totals = np.array([float(number) for number in kinds.values()])
    return Points(tuple(landscapes), totals, prior * np.outer(scales, scales), judged, low, high)


def _rows(problem: Problem, sensor: Sensor, inputs: Expression, period: Expression) -> Expression:
    # What a sensor reads at a point, by the parameters, in units of the noise.
    system, size = problem.system, len(problem.system.parameters)
    given = ca.SX(0, 1), ca.SX(0, size), inputs, ca.DM(system.nominal), ca.SX(0, 1), period
    return moment_reading(sensor, system)(*given)[4].T


def _kinds(problem: Problem, sensors: tuple[Sensor, ...]) -> dict[tuple[int, ...], int]:
    # How many settings there are of which each sensor reads so often.
    samples, runs = problem.design.samples, problem.design.runs
    read = np.zeros((samples, len(sensors)), dtype=int)
    for place, sensor in enumerate(sensors):
        # At the last sample's instant the inputs are those held until then.
        np.add.at(read[:, place], np.minimum(sensor.columns(samples), samples - 1), 1)
    kinds = Counter(tuple(row) for row in read.tolist() if any(row))
    # First those at which most is read.
    return {kind: runs * kinds[kind] for kind in sorted(kinds, key=sum, reverse=True)}


def point_bounds(problem: Problem) -> Iterator[Bound]:
    """A bound on E, D and A for systems without states, all runs together."""
    found = points_of(problem) if mixes(problem.criterion) else None
    if found is None:
        return
    others = [one.name for one in problem.limits if not one.input_bounds(problem.model)]
    left = [f"{', '.join(others)} left out"] if others else []
    bound = _Search(problem.criterion, found).run()
    if bound is not None:
        value, multiplier = bound
        yield Bound(value, METHOD, (IN_BOX, *left), multiplier)


class _Search:
    """Exchanges points until none is more informative, then proves that.

    Attributes:
        points: that are known, (k, n).
        groups: of which kind each is, (k,).
        matrices: information at each, (k, q, q).
    """

    def __init__(self, criterion: Criterion, design: Points) -> None:
        self.criterion, self.design = criterion, design
        self.points, self.groups = np.zeros((0, len(design.low))), np.zeros(0, dtype=np.int64)
        self.matrices = np.zeros((0, len(design.known), len(design.known)))
        chosen = np.unique(np.linspace(0, len(design.first) - 1, FIRST).round().astype(int))
        for group in range(len(design.totals)):
            self._add(group, design.first[chosen])

    def run(self) -> tuple[float, Array] | None:
        """The bound, and its Z; None where no points identify everything, or one may say anything."""
        best: tuple[float, Array] | None = None
        for _ in range(PROOFS):
            mixture = self._exchanged()
            if mixture is None:
                return best
            factor, most, found = _factor(mixture.multiplier), 0.0, False
            for group, landscape in enumerate(self.design.landscapes):
                own = self.points[self.groups == group]
                before = float(landscape.at(own, factor)[0].max())
                proved = largest(landscape, factor, self.design.low, self.design.high, own)
                said = np.abs(self.matrices[self.groups == group])
                terms = np.einsum("ab,kab->k", np.abs(mixture.multiplier), said).max()
                most += self.design.totals[group] * (proved.upper + LOST * float(terms))
                if proved.value > before * (1 + CONVERGED):
                    found = True
                    self._add(group, proved.point[None])
            if not np.isfinite(most):
                return None
            bound = self._bound(mixture, most)
            if best is None or bound < best[0]:
                best = bound, mixture.multiplier
            if not found:
                break
        return best

    def _add(self, group: int, points: Array) -> None:
        matrices = np.stack([self.design.landscapes[group].matrix(one) for one in points])
        # What is not finite is not a point that can be chosen.
        finite = np.isfinite(matrices).all(axis=(1, 2))
        self.points = np.concatenate([self.points, points[finite]])
        self.matrices = np.concatenate([self.matrices, matrices[finite]])
        self.groups = np.concatenate([self.groups, np.full(int(finite.sum()), group)])

    def _keep(self, chosen: Places) -> None:
        self.points, self.groups = self.points[chosen], self.groups[chosen]
        self.matrices = self.matrices[chosen]

    def _exchanged(self) -> Mixture | None:
        # The best shares of points, no other point known to be better.
        design, best, kinds = self.design, None, range(len(self.design.totals))
        for _ in range(ROUNDS):
            mixture = best_mixture(
                self.criterion, self.matrices, design.known, design.judged, self.groups, design.totals
            )
            if mixture is None:
                break
            best, factor = mixture, _factor(mixture.multiplier)
            present = mixture.weights > PRESENT * design.totals[self.groups]
            before = most = 0.0
            found = []
            for group in kinds:
                landscape, own = design.landscapes[group], self.groups == group
                grid = design.first[np.argsort(-landscape.at(design.first, factor)[0])[:TOP]]
                starts = np.concatenate([self.points[own & present], grid])
                found.append(peaks(landscape, factor, design.low, design.high, starts))
                most += design.totals[group] * float(landscape.at(found[-1], factor)[0].max())
                before += design.totals[group] * float(landscape.at(self.points[own], factor)[0].max())
            gain = self._bound(mixture, most), self._bound(mixture, before)
            self._keep(self._distinct(mixture.weights, present))
            merged = [self._merge(group, found[group]) for group in kinds]
            if self.criterion.change(*gain, design.judged) <= CONVERGED or not any(merged):
                break
        return best

    def _distinct(self, weights: Array, present: Bools) -> Places:
        # Those that are present, one of each that say the same, the largest shares of them.
        chosen: list[int] = []
        sizes = np.sqrt(np.abs(self.matrices).max(axis=0)) + np.finfo(float).tiny
        scaled = self.matrices / (sizes.diagonal()[:, None] * sizes.diagonal())
        for place in np.argsort(-weights)[: int(present.sum())].tolist():
            same = np.abs(scaled[chosen] - scaled[place]).max(axis=(1, 2), initial=0.0) <= SAME
            if len(chosen) < MOST and not np.any(same & (self.groups[chosen] == self.groups[place])):
                chosen.append(place)
        return np.array(sorted(chosen))

    def _merge(self, group: int, found: Array) -> bool:
        # Whether there are new ones.
        before = len(self.points)
        width = np.where(self.design.high > self.design.low, self.design.high - self.design.low, 1.0)
        for one in found:
            own = self.points[self.groups == group]
            if np.abs((own - one) / width).max(axis=1).min(initial=np.inf) > SAME:
                self._add(group, one[None])
        return len(self.points) > before

    def _bound(self, mixture: Mixture, most: float) -> float:
        judged, known = self.design.judged, float(np.sum(mixture.multiplier * self.design.known))
        return self.criterion.trace_bound(mixture.multiplier[:judged, :judged], most + known)


SAME = 1e-6
"""Share of their range, or of what they say, by which points differ that are the same."""


def _factor(multiplier: Array) -> Array:
    # U with U'U = Z.
    values, vectors = np.linalg.eigh(multiplier)
    return np.asarray(np.sqrt(np.clip(values, 0.0, None))[:, None] * vectors.T)


@typed
def sensitivity_function(problem: Problem, multiplier: Array, count: int = 401) -> tuple[Array, Array]:
    """The sensitivity function tr(Z M(x)) over the range of the only input: what the equivalence theorem
    bounds; largest at the points of an optimal design [Fedorov, Theory of Optimal Experiments, 1972].

    Args:
        problem: of a system without states, with one input.
        multiplier: Z, (q, q), e.g. a certificate's.
        count: of values of the input.

    Returns:
        values x of the input (count,), SI, and tr(Z M(x)) at each (count,), where most is read.

    Raises:
        ProblemError: a problem without points.
        UserMistake: several inputs, or a multiplier of another size.
    """
    found = points_of(problem)
    if found is None:
        raise ProblemError.about(("model",), NO_POINTS)
    if len(found.low) != 1:
        raise UserMistake(f"expected a system with one input, got {len(found.low)}")
    if multiplier.shape != found.known.shape:
        raise UserMistake(f"multiplier: expected {found.known.shape}, got {multiplier.shape}")
    values = np.linspace(found.low[0], found.high[0], count)
    return values, found.landscapes[0].at(values[:, None], _factor(multiplier))[0]
