"""The largest value of a function over a box, with proof: interval branch and bound.

Of every box the lowest of four bounds counts: that of interval arithmetic; the mean-value form; Taylor's with
second derivatives; and, where the function is concave all over the box, any tangent plane. Where it rises all
along an input, its largest value is at that end [Neumaier, Complete search in continuous global optimization,
2004]. Rounding is not directed: see `intervals`.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array, Bools, Places
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.interval_function import IntervalFunction
from oed.kernel.dynamics.intervals import EVERYTHING, full

TIGHT = 1e-10
"""Share by which the bound may exceed the largest value found."""
MOST_BOXES = 8_000
"""MaximumEnclosure number of boxes that are bounded."""
NARROW = 1e-12
"""Share of the root box's width below which a box is not split."""
CHUNK = 2000
"""Number of boxes that are bounded in one call."""
NEWTON = 6
"""Newton steps towards the largest value of a box on which the function is concave."""
STEPS = 60
"""MaximumEnclosure number of steps towards local maxima."""
SHORTEST = 1e-6
"""Share of Newton's step below which the line search ends."""
FLAT = 1e-10
"""Share of the largest curvature that replaces smaller curvatures."""


@dataclass(frozen=True)
class MaximumEnclosure:
    """Enclosure of a function's largest value over a box.

    Attributes:
        upper: proved upper bound on the largest value.
        value: largest value found.
        point: point with that value, (n,).
    """

    upper: float
    value: float
    point: Array


class Landscape:
    """Function f(x) = tr(Z J(x)' J(x)) of inputs x, for any Z = U'U: at points, and over boxes.

    Attributes:
        rows: CasADi function x -> J.
        count: number of inputs.
        is_bounded: True if every operation of f has interval bounds.
    """

    def __init__(self, inputs: Expression, rows: Expression) -> None:
        """Differentiate f.

        Args:
            inputs: symbols x, (n,).
            rows: J, (rows, q).
        """
        count, size = inputs.numel(), rows.shape[1]
        factor = ca.SX.sym("factor", size, size)
        value = ca.sumsqr(factor @ rows.T)
        second, gradient = ca.hessian(value, inputs)
        arguments = [inputs, factor]
        self.rows, self.count = ca.Function("rows", [inputs], [ca.densify(rows)]), count
        self._points = ca.Function(
            "points", arguments, [value, ca.densify(gradient), ca.vec(ca.densify(second))]
        )
        derivatives = ca.Function("derivatives", arguments, [ca.densify(ca.vertcat(value, gradient))])
        self._derivatives = IntervalFunction(derivatives, range(count))
        self.is_bounded = self._derivatives.is_bounded

    def matrix(self, point: Array) -> Array:
        """Return J'J at a point (n,), (q, q)."""
        rows = np.array(self.rows(point))
        return np.asarray(rows.T @ rows)

    def at(self, points: Array, factor: Array) -> tuple[Array, Array, Array]:
        """Return values (k,), gradients (k, n) and second derivatives (k, n, n) at points (k, n)."""
        results = self._points.call([ca.DM(points.T), ca.DM(np.tile(factor, (1, len(points))))])
        value, gradient, second = (np.array(result).T for result in results)
        return value[:, 0], gradient, second.reshape(-1, self.count, self.count)

    def over(self, low: Array, high: Array, factor: Array) -> tuple[Array, Array, Array]:
        """Return bounds of values (k, 2), gradients (k, n, 2) and second derivatives (k, n, n, 2) over boxes.

        Args:
            low: smallest x of each box, (k, n).
            high: largest x of each box, (k, n).
            factor: U.
        """
        parts = [
            self._over(low[first : first + CHUNK], high[first : first + CHUNK], factor)
            for first in range(0, len(low), CHUNK)
        ]
        value, gradient, second = (np.concatenate(bounds) for bounds in zip(*parts, strict=True))
        return value, gradient, second

    def _over(self, low: Array, high: Array, factor: Array) -> tuple[Array, Array, Array]:
        boxes = np.zeros((self.count, 1 + self.count, 2, len(low)))
        boxes[:, 0] = np.stack([low.T, high.T], axis=1)
        boxes[np.arange(self.count), 1 + np.arange(self.count)] = 1.0
        rows = self._derivatives.bounds([*boxes, *factor.ravel(order="F")])
        table = np.array([full(row, boxes[0].shape) for row in rows])
        table = np.where(np.isnan(table).any(axis=2, keepdims=True), EVERYTHING, table).transpose(3, 0, 1, 2)
        value, slopes, gradient, second = table[:, 0, 0], table[:, 0, 1:], table[:, 1:, 0], table[:, 1:, 1:]
        # The gradient as a function misses jumps; the value's slopes, which do not, are infinite there.
        is_smooth = np.isfinite(slopes).all(axis=(1, 2))[:, None, None]
        closer = np.stack(
            [
                np.maximum(gradient[..., 0], slopes[..., 0]),
                np.minimum(gradient[..., 1], slopes[..., 1]),
            ],
            axis=-1,
        )
        return (
            value,
            np.where(is_smooth, closer, slopes),
            np.where(is_smooth[..., None], second.transpose(0, 2, 1, 3), [-np.inf, np.inf]),
        )


def local_maxima(landscape: Landscape, factor: Array, low: Array, high: Array, starts: Array) -> Array:
    """Return local maxima (k, n) over a box, by Newton's method with step control from given starts.

    Args:
        landscape: the function.
        factor: U, (q, q).
        low: smallest inputs, (n,).
        high: largest inputs, (n,).
        starts: points from which the steps begin, (k, n).
    """
    point, lengths = starts, np.ones(len(starts))
    value, slope, second = landscape.at(point, factor)
    for _ in range(STEPS):
        outwards = ((point <= low) & (slope < 0)) | ((point >= high) & (slope > 0))
        step = _ascent(slope, second, np.asarray(np.logical_and(~outwards, high > low)))
        trial = np.clip(point + lengths[:, None] * step, low, high)
        at_trial = landscape.at(trial, factor)
        higher = at_trial[0] > value
        if not higher.any() and (lengths < SHORTEST).all():
            break
        lengths = np.where(higher, np.minimum(2 * lengths, 1.0), lengths / 4)
        point = np.where(higher[:, None], trial, point)
        value, slope = np.where(higher, at_trial[0], value), np.where(higher[:, None], at_trial[1], slope)
        second = np.where(higher[:, None, None], at_trial[2], second)
    return point


def enclose_maximum(
    landscape: Landscape, factor: Array, low: Array, high: Array, peaks: Array
) -> MaximumEnclosure:
    """Enclose the largest value over a box.

    Args:
        landscape: the function.
        factor: U, (q, q).
        low: smallest inputs, (n,).
        high: largest inputs, (n,).
        peaks: points (k, n) at which the function may be large, at least one.
    """
    return _BoxSearch(landscape, factor, low, high, peaks).run()


class _BoxSearch:
    def __init__(self, landscape: Landscape, factor: Array, low: Array, high: Array, peaks: Array) -> None:
        self.landscape, self.factor, self.peaks = landscape, factor, peaks
        self.width = np.where(high > low, high - low, 1.0)
        self.low, self.high = low[None], high[None]
        self.value, self.point = -np.inf, peaks[0]
        self._record_best(peaks)

    def run(self) -> MaximumEnclosure:
        closed, examined, uppers = -np.inf, 0, np.full(1, np.inf)
        while len(self.low) and examined < MOST_BOXES:
            examined += len(self.low)
            uppers, gradients = self._bounds()
            wide = ((self.high - self.low) > NARROW * self.width).any(axis=1)
            is_open = wide & (uppers > self.value + TIGHT * abs(self.value))
            closed = max(closed, float(uppers[~is_open].max(initial=-np.inf)))
            self.low, self.high, uppers = self.low[is_open], self.high[is_open], uppers[is_open]
            uppers = self._split(gradients[is_open], uppers)
        upper = max(closed, self.value, float(uppers.max(initial=-np.inf)))
        return MaximumEnclosure(upper, self.value, self.point)

    def _record_best(self, points: Array) -> None:
        values, *_ = self.landscape.at(points, self.factor)
        values = np.where(np.isnan(values), -np.inf, values)
        if values.max(initial=-np.inf) > self.value:
            best = int(np.argmax(values))
            self.value, self.point = float(values[best]), points[best]

    def _bounds(self) -> tuple[Array, Array]:
        # Upper bounds on the values over the open boxes, (k,), and bounds on the gradients, (k, n, 2).
        low, high, radius = self.low, self.high, (self.high - self.low) / 2
        middle = (low + high) / 2
        natural, gradients, second = self.landscape.over(low, high, self.factor)
        value, slope, _ = self.landscape.at(middle, self.factor)
        self._record_best(middle)
        moving = np.asarray(radius > 0)
        both = _pairs(moving)
        second = np.where(both[..., None], second, 0.0)
        steepest = np.where(moving, np.abs(gradients).max(axis=-1), 0.0)
        mean_value = value + (steepest * radius).sum(axis=1)
        curvature = np.abs(second).max(axis=-1)
        diagonal = np.arange(low.shape[1])
        curvature[:, diagonal, diagonal] = np.maximum(second[:, diagonal, diagonal, 1], 0.0)
        taylor = value + (np.abs(slope) * radius).sum(axis=1)
        taylor = taylor + np.einsum("kab,ka,kb->k", curvature, radius, radius) / 2
        estimates = np.stack([natural[:, 1], mean_value, taylor])
        uppers = np.where(np.isnan(estimates), np.inf, estimates).min(axis=0)
        chosen = np.flatnonzero(_concave(second) & (uppers > self.value + TIGHT * abs(self.value)))
        if len(chosen):
            uppers[chosen] = np.minimum(uppers[chosen], self._tangent(chosen))
        return uppers, gradients

    def _tangent(self, chosen: Places) -> Array:
        # A concave function is below each of its tangent planes; the plane near its maximum is the lowest.
        low, high = self.low[chosen], self.high[chosen]
        point, lowest = (low + high) / 2, np.full(len(chosen), np.inf)
        for place in self.peaks:
            inside = ((place >= low) & (place <= high)).all(axis=1)
            point[inside] = place
        for _ in range(NEWTON):
            value, slope, second = self.landscape.at(point, self.factor)
            self._record_best(point)
            most = value + np.maximum(slope * (high - point), slope * (low - point)).sum(axis=1)
            lowest = np.fmin(lowest, most)
            point = np.clip(point + _ascent(slope, second, np.asarray(high > low)), low, high)
        return lowest

    def _split(self, gradients: Array, uppers: Array) -> Array:
        # Where the function is monotonic along an input, its largest value over the box is at that end.
        moving = self.high > self.low
        # A zero gradient counts as rising.
        rising = moving & (gradients[..., 0] >= 0)
        falling = moving & ~rising & (gradients[..., 1] <= 0)
        low, high = np.where(rising, self.high, self.low), np.where(falling, self.low, self.high)
        flat = (rising | falling).any(axis=1)
        steepest = np.abs(gradients).max(axis=-1)
        is_finite = np.isfinite(steepest).all(axis=1, keepdims=True)
        width = (high - low) * np.where(is_finite, steepest, 1 / self.width)
        width = np.where(width.max(axis=1, keepdims=True) > 0, width, high - low)
        along, rows = np.argmax(width, axis=1), np.flatnonzero(~flat)
        middle = (low[rows, along[rows]] + high[rows, along[rows]]) / 2
        upper_low, lower_high = low[rows].copy(), high[rows].copy()
        lower_high[np.arange(len(rows)), along[rows]] = middle
        upper_low[np.arange(len(rows)), along[rows]] = middle
        self.low = np.concatenate([low[flat], low[rows], upper_low])
        self.high = np.concatenate([high[flat], lower_high, high[rows]])
        return np.concatenate([uppers[flat], uppers[rows], uppers[rows]])


def _concave(second: Array) -> Bools:
    # True if no matrix between the ends has a positive eigenvalue: the middle's largest eigenvalue plus the
    # Frobenius norm of the radius bounds them all.
    finite: Bools = np.asarray(np.isfinite(second).all(axis=(1, 2, 3)))
    ends = np.where(finite[:, None, None, None], second, 0.0)
    ends = (ends + ends.transpose(0, 2, 1, 3)) / 2
    middle, radius = ends.mean(axis=-1), (ends[..., 1] - ends[..., 0]) / 2
    spread = np.sqrt((radius**2).sum(axis=(1, 2)))
    return np.asarray(finite & (np.linalg.eigvalsh(middle)[:, -1] + spread <= 0))


def _pairs(moving: Bools) -> Bools:
    # True for second derivatives by two inputs that both vary in the box, (k, n, n).
    return np.asarray(np.einsum("ka,kb->kab", moving, moving))


def _ascent(slope: Array, second: Array, moving: Bools) -> Array:
    # Newton's ascent step along the moving inputs, with all curvatures taken as negative.
    both = _pairs(moving)
    finite: Bools = np.asarray(np.isfinite(second).all(axis=(1, 2)) & np.isfinite(slope).all(axis=1))
    curved = np.where(both & finite[:, None, None], second, 0.0)
    values, vectors = np.linalg.eigh(curved)
    least = FLAT * np.abs(values).max(axis=1, keepdims=True) + np.finfo(float).tiny
    uphill = np.where(moving & finite[:, None], slope, 0.0)
    along = np.einsum("kab,ka->kb", vectors, uphill) / np.maximum(np.abs(values), least)
    return np.asarray(np.einsum("kab,kb->ka", vectors, along))
