"""B-splines of inputs over time.

The coefficients of a curve are also its convex hull: bounds on them hold for the curve at all times (de Boor,
A Practical Guide to Splines, ch. XI), which is how speed and acceleration limits become linear constraints.

SciPy's `BSpline` gives the same numbers, but loading it takes longer than a check of a study.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from math import factorial

import numpy as np

from oed.foundation.arrays import Array, Places

ROUNDING = 1e-12
"""Share of the duration below which two times are equal."""


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


def basis(knots: Array, degree: int, times: Array) -> tuple[Array, Places]:
    """Return the basis functions that are not 0 at `times` [s]: their values, at knots the limits from the
    right, and their places among the coefficients, (len(times), degree + 1) each [de Boor, ch. X, eq. 4].

    Args:
        knots: knots [s], not decreasing.
        degree: degree of the spline.
        times: times of evaluation [s].
    """
    inside = np.clip(times, knots[degree], knots[-degree - 1])
    if degree == 0:
        # A time at a knot, to rounding, is at the knot: the middle of a period may be.
        inside = inside + ROUNDING * knots[-1]
    last = np.clip(np.searchsorted(knots, inside, side="right") - 1, degree, len(knots) - degree - 2)
    functions = np.zeros((degree + 1, len(inside)))
    functions[0] = 1.0
    for order in range(1, degree + 1):
        lower, functions[0] = functions[:order].copy(), 0.0
        for index in range(1, order + 1):
            after, before = knots[last + index], knots[last + index - order]
            share = _quotient(lower[index - 1], after - before)
            functions[index - 1] += share * (after - inside)
            functions[index] = share * (inside - before)
    return functions.T, last[:, None] - degree + np.arange(degree + 1)


def values(knots: Array, degree: int, coefficients: Array, times: Array, order: int = 0) -> Array:
    """Return the values (len(times), ...) of curves, or of their derivatives, at `times` [s], see `basis`.

    Args:
        knots: knots of the curves [s].
        degree: degree of the curves.
        coefficients: coefficients (n, ...); with the identity, the values are the matrix that takes
            coefficients to values.
        times: times of evaluation [s].
        order: order of the derivative, at most the degree.
    """
    knots, coefficients = derivative(knots, degree, coefficients, order)
    functions, places = basis(knots, degree - order, times)
    return np.asarray(np.einsum("tk,tk...->t...", functions, coefficients[places]))


def derivative(knots: Array, degree: int, coefficients: Array, order: int = 1) -> tuple[Array, Array]:
    """Return knots and coefficients of the derivative of curves, a spline of a lower degree [de Boor, ch. X,
    eq. 15].

    Where two curves meet that have nothing in common, there is no derivative, and its coefficient is 0.

    Args:
        knots: knots of the curves [s].
        degree: degree of the curves.
        coefficients: coefficients (n, ...).
        order: order of the derivative.

    Raises:
        ValueError: the order is above the degree, and the derivative is not a function.
    """
    if order > degree:
        raise ValueError("a piecewise constant spline has no derivative")
    for lower in range(degree, degree - order, -1):
        count = len(coefficients)
        scale = _quotient(np.full(count - 1, float(lower)), knots[lower + 1 : count + lower] - knots[1:count])
        knots, coefficients = knots[1:-1], (np.diff(coefficients, axis=0).T * scale).T
    return knots, coefficients


def refined(knots: Array, degree: int, coefficients: Array, finer: Array) -> Array:
    """Return the coefficients of the same curves on more knots, from their values at the means of knots
    [Greville's abscissae; de Boor, ch. IX].

    Args:
        knots: knots of the curves [s].
        degree: degree of the curves.
        coefficients: coefficients (n, curves).
        finer: all of `knots`, and others inside, none of them twice.

    Raises:
        ValueError: `finer` leaves out some of the knots.
    """
    near = ROUNDING * knots[-1]
    is_old, is_twin = (np.abs(table[:, None] - knots) <= near for table in (finer, knots))
    if np.any(is_old.sum(axis=0) < is_twin.sum(axis=0)):
        raise ValueError("expected knots that have all those of the curves, and others inside")
    width = max(degree, 1)
    means = np.convolve(finer[1:-1] if degree else finer[:-1], np.full(width, 1 / width), "valid")
    matrix = values(finer, degree, np.eye(len(means)), means)
    return np.asarray(np.linalg.solve(matrix, values(knots, degree, coefficients, means)))


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
    # Every piece is a polynomial in units of half its length, from -1 to 1.
    terms = [
        values(knots, degree, coefficients, middles, order + power) * halves**power / factorial(power)
        for power in range(degree - order + 1)
    ]
    points = [-np.ones_like(terms[0]), np.ones_like(terms[0])]
    if degree - order > 1:
        points += list(_real_roots([power * term for power, term in enumerate(terms)][1:]))
    return np.concatenate([reduce(lambda total, term: total * x + term, terms[::-1]) for x in points])


def _real_roots(terms: Sequence[Array]) -> Array:
    """Return points (degree, ...) of [-1, 1], among which are the real roots inside of polynomials with
    coefficients (...,) from the constant upwards.
    """
    if len(terms) <= 3:
        constant, slope, bend = [*terms, np.zeros_like(terms[0])][:3]
        root = np.sqrt(np.maximum(slope**2 - 4 * bend * constant, 0.0))
        larger = -(slope + np.copysign(root, slope)) / 2
        roots = np.stack([_quotient(larger, bend), _quotient(constant, larger)])
    else:
        table = np.stack(terms[::-1])
        roots = np.zeros((len(terms) - 1, *table.shape[1:]))
        for place in np.ndindex(table.shape[1:]):
            real = np.roots(table[(slice(None), *place)]).real
            roots[(slice(len(real)), *place)] = real
    return np.clip(roots, -1.0, 1.0)


def _quotient(top: Array, bottom: Array) -> Array:
    # 0 where the divisor is.
    return np.divide(top, bottom, out=np.zeros_like(top), where=bottom != 0)


def enclosure(knots: Array, degree: int, coefficients: Array, begin: Array, end: Array) -> Array:
    """Return bounds of curves over stretches without a knot inside, where they are polynomials: values at
    both ends, least and largest value, least and largest derivative, (6, K, curves).

    Args:
        knots: knots of the curves [s].
        degree: degree of the curves, at least 1.
        coefficients: coefficients (n, curves).
        begin: begins of the stretches [s], (K,).
        end: ends of the stretches [s], (K,).
    """
    middle, half = (begin + end) / 2, (end - begin)[:, None] / 2
    taylor = np.stack([values(knots, degree, coefficients, middle, order) for order in range(degree + 1)])
    powers = np.stack([half**power / factorial(power) for power in range(degree + 1)])
    terms = taylor * powers
    even, odd, reach = terms[::2].sum(axis=0), terms[1::2].sum(axis=0), np.abs(terms[1:]).sum(axis=0)
    # Most by which the slope differs from its value in the middle.
    bend = (np.abs(taylor[2:]) * powers[1:degree]).sum(axis=0)
    value, slope = taylor[:2]
    return np.stack([even - odd, even + odd, value - reach, value + reach, slope - bend, slope + bend])
