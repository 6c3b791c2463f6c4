"""B-splines of inputs over time.

A curve is `basis(t) @ coefficients`. The coefficients are also its convex hull: bounds on them hold for
the curve at all times (de Boor, A Practical Guide to Splines, ch. XI), which is how speed and
acceleration limits become linear constraints.

SciPy's `BSpline` gives the same numbers, but loading it takes longer than a check of a study.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import factorial

import numpy as np

from oed.foundation.arrays import Array, Places

ROUNDING = 1e-12
"""Share of the duration below which two times are equal."""


@dataclass(frozen=True)
class BandMatrix:
    """A matrix of a few neighbouring entries in every row.

    Attributes:
        columns: number of columns n.
        first: column of each row's first entry, (m,).
        entries: entries of each row, (m, k).
    """

    columns: int
    first: Places
    entries: Array

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of rows and columns."""
        return len(self.first), self.columns

    @property
    def places(self) -> Places:
        """Columns of the entries, (m, k)."""
        return np.asarray(self.first[:, None] + np.arange(self.entries.shape[1]))

    def __matmul__(self, other: Array) -> Array:
        """Return the product (m, ...) with an array (n, ...)."""
        wide = self.entries.reshape(*self.entries.shape, *(1,) * (other.ndim - 1))
        total = np.zeros((len(self.first), *other.shape[1:]))
        for offset in range(self.entries.shape[1]):
            total += wide[:, offset] * other[self.first + offset]
        return total

    def toarray(self) -> Array:
        """Return the matrix (m, n) with all its zeros."""
        return self @ np.eye(self.columns)


def clamped_knots(duration: float, count: int, degree: int) -> Array:
    """Return knots (count + degree + 1,) [s] of a uniform spline on [0, duration] that starts and ends at its
    first and last coefficient.

    Args:
        duration: last time [s].
        count: number of coefficients.
        degree: degree of the spline.

    Raises:
        ValueError: there are fewer coefficients than degree + 1.
    """
    if count < degree + 1:
        raise ValueError(f"a degree-{degree} spline needs at least {degree + 1} coefficients, got {count}")
    inner = np.linspace(0.0, duration, count - degree + 1)
    return np.concatenate([np.zeros(degree), inner, np.full(degree, duration)])


def repeated_knots(knots: Array, degree: int, times: int) -> Array:
    """Return the knots of splines that follow each other and have nothing in common where they meet.

    Args:
        knots: clamped knots of one spline [s].
        degree: degree of the splines.
        times: number of splines.
    """
    shifted = [knots[degree + 1 :] + index * knots[-1] for index in range(times)]
    return np.concatenate([knots[: degree + 1], *shifted])


def basis(knots: Array, degree: int, times: Array) -> BandMatrix:
    """Return the matrix (len(times), n) of the basis functions' values at `times` [s], at knots the limits
    from the right [de Boor, ch. X, eq. 4].

    Args:
        knots: knots [s], not decreasing.
        degree: degree of the spline.
        times: times of evaluation [s].
    """
    count = len(knots) - degree - 1
    inside = np.clip(times, knots[degree], knots[-degree - 1])
    if degree == 0:
        # A time at a knot, to rounding, is at the knot: the middle of a period may be.
        inside = inside + ROUNDING * knots[-1]
    place = np.clip(np.searchsorted(knots, inside, side="right") - 1, degree, count - 1)
    values = np.zeros((degree + 1, len(inside)))
    values[0] = 1.0
    for order in range(1, degree + 1):
        lower, values[0] = values[:order].copy(), 0.0
        for index in range(1, order + 1):
            after, before = knots[place + index], knots[place + index - order]
            span = after - before
            share = np.divide(lower[index - 1], span, out=np.zeros_like(span), where=span > 0)
            values[index - 1] += share * (after - inside)
            values[index] = share * (inside - before)
    return BandMatrix(count, place - degree, values.T)


def values(knots: Array, degree: int, coefficients: Array, times: Array) -> Array:
    """Return the values of curves at `times` [s], (len(times), curves), as `basis` has them.

    Args:
        knots: knots of the curves [s].
        degree: degree of the curves.
        coefficients: coefficients (n, curves).
        times: times of evaluation [s].
    """
    return basis(knots, degree, times) @ coefficients


def derivative(knots: Array, degree: int) -> tuple[BandMatrix, Array]:
    """Return the derivative as a spline of one degree less: its coefficients' matrix (n - 1, n), its knots.

    The matrix takes the curve's coefficients to those of its derivative [de Boor, ch. X, eq. 15]. Where two
    curves meet that have nothing in common, there is no derivative, and its coefficient is 0.

    Raises:
        ValueError: the degree is 0, whose derivative is not a function.
    """
    if degree == 0:
        raise ValueError("a piecewise constant spline has no derivative")
    count = len(knots) - degree - 1
    span = knots[degree + 1 : count + degree] - knots[1:count]
    scale = np.where(span > 0, degree / np.where(span > 0, span, 1.0), 0.0)
    return BandMatrix(count, np.arange(count - 1), np.column_stack([-scale, scale])), knots[1:-1]


def refined(knots: Array, degree: int, coefficients: Array, finer: Array) -> Array:
    """Return the coefficients of the same curves on more knots, by inserting these one by one [Boehm, 1980].

    Each is a mean of two neighbours, so that bounds on the coefficients, and on those of derivatives, go on
    to hold.

    Args:
        knots: knots of the curves [s].
        degree: degree of the curves.
        coefficients: coefficients (n, curves).
        finer: all of `knots`, and others inside.

    Raises:
        ValueError: `finer` leaves out some of the knots.
    """
    near = ROUNDING * knots[-1]
    for time in finer[np.abs(finer[:, None] - knots).min(axis=1) > near]:
        knots, coefficients = _with_knot(knots, degree, coefficients, time)
    if knots.shape != finer.shape or np.any(np.abs(knots - finer) > near):
        raise ValueError("expected knots that have all those of the curves, and others inside")
    return coefficients


def _with_knot(knots: Array, degree: int, coefficients: Array, time: float) -> tuple[Array, Array]:
    last = int(np.searchsorted(knots, time, side="right")) - 1
    mixed = np.arange(last - degree + 1, last + 1)
    share = ((time - knots[mixed]) / (knots[mixed + degree] - knots[mixed]))[:, None] if degree else 0.0
    inserted = np.insert(coefficients, last, coefficients[last], axis=0)
    inserted[mixed] = share * coefficients[mixed] + (1 - share) * coefficients[mixed - 1]
    return np.insert(knots, last + 1, time), inserted


def jumps(knots: Array, degree: int, order: int) -> Array:
    """Return times [s] inside at which the derivative of an order may jump, for their knots are repeated.

    Args:
        knots: knots of the spline [s].
        degree: degree of the spline.
        order: order of the derivative.
    """
    inner, times = np.unique(knots, return_counts=True)
    return np.asarray(inner[1:-1][times[1:-1] > degree - order])


def extremes(knots: Array, degree: int, coefficients: Array, order: int) -> Array:
    """Return values (K, curves) among which the derivative of an order (0 to degree) of every curve has its
    least and largest, those on both sides of its jumps included. K depends on knots and degree alone.

    They are the values at both ends of every piece, and those where the next derivative vanishes inside.

    Args:
        knots: knots of the curves [s].
        degree: degree of the curves.
        coefficients: coefficients (n, curves).
        order: order of the derivative.
    """
    inner = np.unique(knots)
    middles, halves = (inner[1:] + inner[:-1]) / 2, np.diff(inner)[:, None] / 2
    taylor = _derivatives(knots, degree, coefficients, middles)[order:]
    # Every piece is a polynomial in units of half its length, from -1 to 1.
    powers = [slope * halves**power / factorial(power) for power, slope in enumerate(taylor)]
    even, odd = sum(powers[::2]), sum(powers[1::2], np.zeros_like(powers[0]))
    candidates = [even - odd, even + odd]
    if degree - order > 1:
        roots = _real_roots([power * term for power, term in enumerate(powers)][1:])
        inside = np.moveaxis(np.clip(roots, -1.0, 1.0), -1, 0)
        stationary = powers[-1] * np.ones_like(inside)
        for term in powers[-2::-1]:
            stationary = stationary * inside + term
        candidates += list(stationary)
    return np.concatenate(candidates)


def _derivatives(knots: Array, degree: int, coefficients: Array, times: Array) -> Array:
    """Return values and all derivatives of curves between their knots, (degree + 1, times, curves)."""
    derivatives = [values(knots, degree, coefficients, times)]
    for lower in range(degree - 1, -1, -1):
        steps, knots = derivative(knots, lower + 1)
        coefficients = steps @ coefficients
        derivatives.append(values(knots, lower, coefficients, times))
    return np.stack(derivatives)


def _real_roots(powers: Sequence[Array]) -> Array:
    """Return roots (..., degree) of polynomials with coefficients (...,) from the constant upwards; a number
    stands also where there is no real root.
    """
    if len(powers) == 2:
        constant, slope = powers
        return np.asarray(_quotient(-constant, slope)[..., None])
    if len(powers) == 3:
        constant, slope, bend = powers
        root = np.sqrt(np.maximum(slope**2 - 4 * bend * constant, 0.0))
        larger = -(slope + np.copysign(root, slope)) / 2
        return np.stack([_quotient(larger, bend), _quotient(constant, larger)], axis=-1)
    table = np.stack(powers[::-1], axis=-1)
    roots = np.zeros((*table.shape[:-1], len(powers) - 1))
    for place in np.ndindex(table.shape[:-1]):
        real = np.roots(table[place]).real
        roots[place][: len(real)] = real
    return roots


def _quotient(top: Array, bottom: Array) -> Array:
    return np.divide(top, bottom, out=np.zeros_like(top), where=bottom != 0)


@dataclass(frozen=True)
class Bounds:
    """Values and bounds of curves over stretches of time, (K, curves) each.

    Attributes:
        begin, end: values at the ends.
        low, high: bounds of the values.
        least, most: bounds of the derivatives.
    """

    begin: Array
    end: Array
    low: Array
    high: Array
    least: Array
    most: Array


def enclosure(knots: Array, degree: int, coefficients: Array, begin: Array, end: Array) -> Bounds:
    """Return bounds of curves over stretches without a knot inside, where they are polynomials.

    Args:
        knots: knots of the curves [s].
        degree: degree of the curves, at least 1.
        coefficients: coefficients (n, curves).
        begin: begins of the stretches [s], (K,).
        end: ends of the stretches [s], (K,).
    """
    middle, half = (begin + end) / 2, (end - begin)[:, None] / 2
    taylor = _derivatives(knots, degree, coefficients, middle)
    powers = np.stack([half**power / factorial(power) for power in range(degree + 1)])
    terms = taylor * powers
    even, odd, reach = terms[::2].sum(axis=0), terms[1::2].sum(axis=0), np.abs(terms[1:]).sum(axis=0)
    # How far the slope strays from its value in the middle.
    bend = (np.abs(taylor[2:]) * powers[1:degree]).sum(axis=0)
    value, slope = taylor[:2]
    return Bounds(even - odd, even + odd, value - reach, value + reach, slope - bend, slope + bend)
