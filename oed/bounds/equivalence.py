"""Bounds by the equivalence theorem: on mixtures of experiments, selected readings and designs of points.

A concave criterion of weights with given sums has one maximum, with a supergradient Z there, and no weights
have more than its plane allows: the maximum of the sensitivity function tr(Z M) [Kiefer, Wolfowitz, The
equivalence of two extremum problems, 1960]. Readings have finitely many values of it. Systems without states
satisfy tr(Z F) <= N max tr(Z M(x)) for N points, which is enclosed over all settings x of the inputs.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from oed.bounds.boxes import Landscape, enclose_maximum, local_maxima
from oed.bounds.certificate import Bound, Certificate, inflate
from oed.bounds.points import Points, points_of
from oed.foundation.arguments import typed
from oed.foundation.arrays import Array, Bools, Places
from oed.foundation.errors import ProblemError, UserMistake
from oed.foundation.presenting import Brief
from oed.kernel.criteria import Criterion
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.equivalence import directional_derivatives
from oed.kernel.measurement.square_root import SquareRoot
from oed.kernel.parts import Budget, Parts, Reading
from oed.kernel.problem import Problem
from oed.optimize.selection import Selected, select
from oed.optimize.weights import best_weights

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
SAME = 1e-6
"""Difference of duplicate points, as a share of the inputs' ranges or of the information."""
METHOD = "the equivalence theorem, the sensitivity function enclosed over all points by branch and bound"
"""Method of these bounds, in words."""
IN_BOX = "every point within the limits of its inputs"
"""An assumption, in words."""
NO_POINTS = "has no points: its system has states, or what is read is not read of each setting alone"
"""Message for problems without a sensitivity function."""
UNDETERMINED = "all readings together leave parameters undetermined: no choice of them is bounded"
"""Method of certificates without a bound."""
SELECTION_METHOD = "directional derivatives at the best weights [Kiefer and Wolfowitz, 1960], {count} weights"
"""Method of the bounds on selections, in words."""


@dataclass(frozen=True)
class Mixture:
    """Optimal weights of experiments, and the supergradient that bounds all weights.

    Attributes:
        weights: weight of each experiment, (n,).
        value: criterion of the mixture, maximal to the solver's tolerance.
        multiplier: matrix Z >= 0 of all parameters, judged and eliminated, (q, q): `trace_bound` of its
            judged part and the largest tr(Z M) bounds the criterion.
    """

    weights: Array
    value: float
    multiplier: Array


def best_mixture(
    criterion: Criterion, matrices: Array, prior: Array, judged: int, groups: Places, totals: Array
) -> Mixture | None:
    """Return the weights that maximise E, D or A; None if no mixture identifies all parameters.

    Args:
        criterion: criterion of the information about the first `judged` parameters, the others eliminated.
        matrices: information of each experiment, (n, q, q).
        prior: information without any experiment, (q, q).
        judged: number of judged parameters.
        groups: index of each experiment's group, (n,).
        totals: sum of the weights of each group, (groups,).
    """
    shares = totals[groups] / np.bincount(groups)[groups]
    if not SquareRoot.of_matrix(prior + np.tensordot(shares, matrices, axes=1)).complete:
        return None
    count, size, _ = matrices.shape
    parts = Parts(
        (Reading("", 0, 0.0),) * count,
        SquareRoot.of_matrix(matrices).rows.reshape(-1, size),
        np.repeat(np.arange(count), size),
        SquareRoot.of_matrix(prior).rows,
        judged,
        np.ones(count),
        tuple((place,) for place in range(count)),
    )
    members = [np.flatnonzero(groups == group).tolist() for group in range(len(totals))]
    budgets = [
        Budget(tuple(places), (1.0,) * len(places), float(total), float(total))
        for places, total in zip(members, totals, strict=True)
    ]
    best = best_weights(criterion, parts, budgets)
    back = parts.projection(best.values)
    return Mixture(best.values, best.value, back.T @ best.gradient @ back)


@dataclass(frozen=True, repr=False)
class Certified(Brief):
    """Readings selected for a trajectory, with an upper bound on all selections.

    Attributes:
        selected: selected readings.
        bound: upper bound on the criterion over all weights within the budgets.
        derivatives: derivatives of the criterion by the weights, at the relaxed weights, (n,).
    """

    selected: Selected
    bound: float
    derivatives: Array


@typed
def certified_selection(problem: Problem, trajectory: Trajectory) -> Certified | None:
    """Select the best readings of a trajectory, and bound the criterion over all selections.

    Args:
        problem: problem with a selection.
        trajectory: trajectory with the readings.

    Returns:
        The readings with their bound; None if all readings together leave parameters undetermined that the
        criterion judges.

    Raises:
        UserMistake: the criterion is not concave, or the problem has no selection.
        ProblemError: the information of the readings does not add up.
    """
    selected = select(problem, trajectory)
    if selected is None:
        return None
    slopes = directional_derivatives(selected.parts, selected.relaxed.values, selected.relaxed.gradient)
    return Certified(selected, selected.bound, slopes)


def selection_certificate(problem: Problem, trajectory: Trajectory) -> Certificate:
    """Return the certificate of all selections of readings of a trajectory."""
    certified = certified_selection(problem, trajectory)
    if certified is None:
        return Certificate(np.inf, UNDETERMINED, (), criterion=problem.criterion)
    count, judged = len(certified.derivatives), certified.selected.parts.judged
    return Certificate(
        inflate(certified.bound, problem.criterion, judged),
        SELECTION_METHOD.format(count=count),
        ("readings of this experiment within the budget of weights",),
        certified.selected.relaxed.gradient,
        criterion=problem.criterion,
        judged=judged,
    )


def point_bounds(problem: Problem) -> Iterator[Bound]:
    """Yield a bound on E, D and A for systems without states, all runs together."""
    points = points_of(problem) if problem.criterion.conjugate else None
    if points is None:
        return
    neglected = [limit.name for limit in problem.limits if not limit.input_bounds(problem.model)]
    omissions = [f"{', '.join(neglected)} left out"] if neglected else []
    bound = _PointSearch(problem.criterion, points).run()
    if bound is not None:
        value, multiplier = bound
        yield Bound(value, METHOD, (IN_BOX, *omissions), multiplier)


class _PointSearch:
    """Exchange of points until none is more informative, followed by a proof of that.

    Attributes:
        points: points of the mixture and candidates, (k, n).
        groups: kinds of the points, (k,).
        matrices: information at the points, (k, q, q).
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
            mixture = self._exchange_points()
            if mixture is None:
                return best
            factor, most, has_new_points = _root(mixture.multiplier), 0.0, False
            for group, landscape in enumerate(self.design.landscapes):
                points = self.points[self.groups == group]
                before = _largest_value(landscape, points, factor)
                proved = enclose_maximum(landscape, factor, self.design.low, self.design.high, points)
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

    def _exchange_points(self) -> Mixture | None:
        # The best mixture after exchanges of points until none improves it.
        design, best, kinds = self.design, None, range(len(self.design.totals))
        for _ in range(ROUNDS):
            mixture = best_mixture(
                self.criterion, self.matrices, design.prior, design.judged, self.groups, design.totals
            )
            if mixture is None:
                break
            best, factor = mixture, _root(mixture.multiplier)
            present = mixture.weights > PRESENT * design.totals[self.groups]
            before = most = 0.0
            maxima = []
            for group in kinds:
                landscape, members = design.landscapes[group], self.groups == group
                grid = design.first[np.argsort(-landscape.at(design.first, factor)[0])[:TOP]]
                starts = np.concatenate([self.points[members & present], grid])
                maxima.append(local_maxima(landscape, factor, design.low, design.high, starts))
                most += design.totals[group] * _largest_value(landscape, maxima[-1], factor)
                before += design.totals[group] * _largest_value(landscape, self.points[members], factor)
            gain = self._bound(mixture, most), self._bound(mixture, before)
            chosen = self._distinct_points(mixture.weights, present)
            self.points, self.groups, self.matrices = (
                self.points[chosen],
                self.groups[chosen],
                self.matrices[chosen],
            )
            merged = [self._add_new_points(group, maxima[group]) for group in kinds]
            if self.criterion.change(*gain, design.judged) <= CONVERGED or not any(merged):
                break
        return best

    def _distinct_points(self, weights: Array, present: Bools) -> Places:
        # The present points with the largest shares, without duplicates of equal information.
        chosen: list[int] = []
        sizes = np.sqrt(np.abs(self.matrices).max(axis=0)) + np.finfo(float).tiny
        scaled = self.matrices / (sizes.diagonal()[:, None] * sizes.diagonal())
        for place in np.argsort(-weights)[: int(present.sum())].tolist():
            is_duplicate = np.abs(scaled[chosen] - scaled[place]).max(axis=(1, 2), initial=0.0) <= SAME
            if len(chosen) < MOST and not np.any(is_duplicate & (self.groups[chosen] == self.groups[place])):
                chosen.append(place)
        return np.array(sorted(chosen))

    def _add_new_points(self, group: int, candidates: Array) -> bool:
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


def _largest_value(landscape: Landscape, points: Array, factor: Array) -> float:
    return float(landscape.at(points, factor)[0].max())


def _root(multiplier: Array) -> Array:
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
    return values, points.landscapes[0].at(values[:, None], _root(multiplier))[0]
