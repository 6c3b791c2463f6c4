"""Bounds on designs of points: systems without states whose readings depend on one setting each.

The information of N points is a sum, so tr(Z F) <= N max tr(Z M(x)) over the settings x of the inputs, and
the best mixture of points has the Z of the lowest bound [Kiefer, Wolfowitz, The equivalence of two extremum
problems, 1960]. The maximum of the sensitivity function tr(Z M(x)) is verified on a grid: the largest of its
points are followed to local maxima. It is not enclosed between the points of the grid.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import casadi as ca
import numpy as np
import scipy

from oed.bounds.certificate import Bound
from oed.bounds.mixtures import best_mixture
from oed.foundation.arguments import typed
from oed.foundation.arrays import Array
from oed.foundation.errors import ProblemError, UserMistake
from oed.kernel.criteria import Criterion
from oed.kernel.dynamics.expression import Expression
from oed.kernel.equivalence import root_of
from oed.kernel.measurement.readings import moment_reading
from oed.kernel.measurement.sensor import Sensor
from oed.kernel.measurement.square_root import SquareRoot
from oed.kernel.problem import Problem

GRID = 4096
"""Largest number of points of the grid, as fine along every input; their evaluation takes milliseconds."""
FIRST = 61
"""Number of the grid's points in the first mixture, odd to hold the middle of a range."""
STARTS = 32
"""Largest number of the grid's highest local maxima that are followed."""
ROUNDS = 25
"""Largest number of exchanges of points: a few are enough where rounding does not matter."""
ROUNDING = 1e-10
"""Share of the information, of a gradient or of a weight that may be rounding."""
SAME = 1e-6
"""Distance of points that count as one, as a share of the inputs' ranges."""
METHOD = "the equivalence theorem, the sensitivity function verified on a grid of {:,} points"
"""Method of these bounds, in words."""
IN_BOX = "every point within the limits of its inputs"
"""An assumption, in words."""
ON_GRID = "the sensitivity function has no higher maximum than those next to the points of the grid"
"""An assumption, in words."""
NO_POINTS = "has no points: its system has states, or what is read is not read of each setting alone"
"""Message for problems without a sensitivity function."""


@dataclass(frozen=True)
class PointKind:
    """Settings that are read by the same sensors.

    Attributes:
        total: number of these settings in a design.
        function: function from the inputs x (n,) to the rows J (k, q) and their derivatives (k q, n).
        grid: rows at the points of the grid, (points, k, q).
    """

    total: float
    function: ca.Function
    grid: Array


@dataclass(frozen=True)
class PointDesigns:
    """Space of designs that consist of points.

    Attributes:
        kinds: kinds of points: each combination of readings, in descending order of readings.
        known_rows: rows of the prior information, (m, q).
        judged: number of the q parameters that the criterion judges.
        low: smallest inputs, (n,).
        high: largest inputs, (n,).
        grid: points of the grid, (points, n).
        shape: number of values of each input of a regular grid.
    """

    kinds: tuple[PointKind, ...]
    known_rows: Array
    judged: int
    low: Array
    high: Array
    grid: Array
    shape: tuple[int, ...]

    def maxima(self, kind: PointKind, root: Array, points: Array) -> Array:
        """Return local maxima (k, n) of the sensitivity function |J(x) U'|^2.

        They follow from points and from the highest local maxima of the grid.

        Args:
            kind: kind of the points.
            root: root U of Z = U'U, (r, q).
            points: points (k, n).
        """
        values = sensitivity(kind.grid, root)
        table = values.reshape(self.shape)
        is_peak = (table == scipy.ndimage.maximum_filter(table, size=3, mode="nearest")).ravel()
        order = np.argsort(np.where(is_peak, -values, np.inf), kind="stable")
        peaks = self.grid[order[: min(STARTS, int(is_peak.sum()))]]
        size = float(values.max()) or 1.0
        maxima = [self._ascend(kind.function, root, start, size) for start in [*points, *peaks]]
        cells = np.round((np.array(maxima) - self.low) / (SAME * self._width))
        return np.array(maxima)[np.unique(cells, axis=0, return_index=True)[1]]

    @property
    def _width(self) -> Array:
        return np.where(self.high > self.low, self.high - self.low, 1.0)

    def _ascend(self, function: ca.Function, root: Array, start: Array, size: float) -> Array:
        # In shares of the inputs' ranges, and of the largest value on the grid.
        def falling(place: Array) -> tuple[float, Array]:
            rows, slopes = (np.array(part) for part in function(self.low + self._width * place))
            weighted = rows @ root.T
            gradient = 2 * (weighted @ root).ravel(order="F") @ slopes * self._width
            return -float((weighted**2).sum()) / size, -gradient / size

        first, ends = (start - self.low) / self._width, (self.high - self.low) / self._width
        bounds = list(zip(np.zeros(len(ends)), ends, strict=True))
        options = {"ftol": 0.0, "gtol": ROUNDING}
        solution = scipy.optimize.minimize(
            falling, first, jac=True, method="L-BFGS-B", bounds=bounds, options=options
        )
        return np.asarray(np.clip(self.low + self._width * solution.x, self.low, self.high))


def sensitivity(rows: Array, root: Array) -> Array:
    """Return tr(Z M) at points, (k,).

    Args:
        rows: rows J at the points, (k, r, q), with M = J'J.
        root: root U of Z = U'U, (s, q).
    """
    return np.asarray(((rows @ root.T) ** 2).sum(axis=(1, 2)))


def rows_at(function: ca.Function, points: Array) -> Array:
    """Return the rows (points, k, q) of a kind's function at points (points, n)."""
    rows = np.array(function.map(len(points))(points.T)[0])
    return rows.reshape(len(rows), len(points), -1).transpose(1, 0, 2)


def point_designs(problem: Problem) -> PointDesigns | None:
    """Return the designs of points of a problem; None if it has none."""
    sensors, low, high = problem.sensors, *problem.input_bounds.T
    alone = all(sensor.when != "between samples" and sensor.joint_whitening is None for sensor in sensors)
    plain = not any(sensor.nuisances for sensor in sensors) and len(problem.any_estimations) == 1
    if problem.system.states or not sensors or not alone or not plain:
        return None
    if not np.isfinite(problem.input_bounds).all() or 2 ** len(low) > GRID:
        return None
    (estimation,) = problem.any_estimations
    judged, count = len(estimation.judged), len(estimation.parameters)
    scales = np.concatenate([estimation.scales, np.ones(count - judged)])
    columns = [estimation.block.parameters.index(name) for name in estimation.parameters]
    inputs, period = ca.SX.sym("inputs", len(low)), ca.SX.sym("period")
    rows = [_rows(problem, sensor, inputs, period)[:, columns] @ ca.diag(ca.DM(scales)) for sensor in sensors]
    if ca.depends_on(ca.vertcat(*rows), period):
        return None
    axes = _axes(low, high)
    grid, kinds = np.array(list(product(*axes))), []
    for times, total in _kinds(problem, sensors).items():
        stacked = ca.densify(ca.vertcat(*(often**0.5 * row for often, row in zip(times, rows, strict=True))))
        outputs = [stacked, ca.densify(ca.jacobian(stacked, inputs))]
        function = ca.Function("rows", [inputs], outputs)
        kinds.append(PointKind(float(total), function, rows_at(function, grid)))
    prior = np.zeros((count, count)) if estimation.prior is None else estimation.prior
    known_rows = SquareRoot.of_matrix(prior * np.outer(scales, scales)).rows
    shape = tuple(map(len, axes))
    return PointDesigns(tuple(kinds), known_rows, judged, low, high, grid, shape)


def _rows(problem: Problem, sensor: Sensor, inputs: Expression, period: Expression) -> Expression:
    # Derivatives of a sensor's reading at a point by the parameters, in units of the noise.
    system, size = problem.system, len(problem.system.parameters)
    arguments = ca.SX(0, 1), ca.SX(0, size), inputs, ca.DM(system.nominal), ca.SX(0, 1), period
    return moment_reading(sensor, system)(*arguments)[4].T


def _axes(low: Array, high: Array) -> list[Array]:
    # Values of each input: as many as `GRID` allows, but no fewer than both ends.
    count = max(2, int(GRID ** (1 / len(low)) * (1 + SAME)))
    return [np.linspace(*ends, count if ends[1] > ends[0] else 1) for ends in zip(low, high, strict=True)]


def _kinds(problem: Problem, sensors: tuple[Sensor, ...]) -> dict[tuple[int, ...], int]:
    # Number of settings with each combination of readings per sensor.
    samples, runs = problem.design.samples, problem.design.runs
    read = np.zeros((samples, len(sensors)), dtype=int)
    for place, sensor in enumerate(sensors):
        # The inputs at the last sample are those of the last period.
        np.add.at(read[:, place], np.minimum(sensor.columns(samples), samples - 1), 1)
    kinds = Counter(tuple(row) for row in read.tolist() if any(row))
    return {kind: runs * kinds[kind] for kind in sorted(kinds, key=sum, reverse=True)}


def point_bounds(problem: Problem) -> Iterator[Bound]:
    """Yield a bound on E, D and A for systems without states, all runs together."""
    designs = point_designs(problem) if problem.criterion.conjugate else None
    if designs is None or not all(np.isfinite(kind.grid).all() for kind in designs.kinds):
        return
    neglected = [limit.name for limit in problem.limits if not limit.input_bounds(problem.model)]
    omissions = [f"{', '.join(neglected)} left out"] if neglected else []
    lowest = _lowest_bound(problem.criterion, designs)
    if lowest is not None:
        value, multiplier = lowest
        method = METHOD.format(len(designs.grid))
        yield Bound(value, method, (IN_BOX, ON_GRID, *omissions), multiplier)


def _lowest_bound(criterion: Criterion, designs: PointDesigns) -> tuple[float, Array] | None:
    # The lowest bound with its Z, by exchange of points until none is more informative; None if no points
    # identify all parameters.
    totals = np.array([kind.total for kind in designs.kinds])
    first = np.linspace(0, len(designs.grid) - 1, FIRST).round().astype(int)
    points = [designs.grid[np.unique(first)]] * len(totals)
    lowest: tuple[float, Array] | None = None
    for _ in range(ROUNDS):
        rows = [rows_at(kind.function, at) for kind, at in zip(designs.kinds, points, strict=True)]
        groups = np.repeat(np.arange(len(totals)), [len(tables) for tables in rows])
        experiments = [table for tables in rows for table in tables]
        known_rows, judged = designs.known_rows, designs.judged
        mixture = best_mixture(criterion, experiments, known_rows, judged, groups, totals)
        if mixture is None:
            break
        known = float(((known_rows @ mixture.root.T) ** 2).sum())
        before = most = known
        for place, kind in enumerate(designs.kinds):
            present = mixture.weights[groups == place] > ROUNDING * kind.total
            points[place] = designs.maxima(kind, mixture.root, points[place][present])
            tables = rows_at(kind.function, points[place])
            before += kind.total * float(sensitivity(rows[place], mixture.root).max())
            most += kind.total * max(sensitivity(each, mixture.root).max() for each in (tables, kind.grid))
        bound, reached = (
            criterion.trace_bound(mixture.multiplier[:judged, :judged], value) for value in (most, before)
        )
        if lowest is None or bound < lowest[0]:
            lowest = bound, mixture.multiplier
        if criterion.change(bound, reached, judged) <= ROUNDING:
            break
    return lowest


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
    designs = point_designs(problem)
    if designs is None:
        raise ProblemError.about(("model",), NO_POINTS)
    if len(designs.low) != 1:
        raise UserMistake(f"expected a system with one input, got {len(designs.low)}")
    size = designs.known_rows.shape[1]
    if multiplier.shape != (size, size):
        raise UserMistake(f"multiplier: expected {(size, size)}, got {multiplier.shape}")
    values = np.linspace(designs.low[0], designs.high[0], count)
    rows = rows_at(designs.kinds[0].function, values[:, None])
    return values, sensitivity(rows, root_of(multiplier).T)
