"""B-splines: the laws that make their coefficients usable as limits."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oed.kernel.dynamics import spline

DURATION = 3.0
degrees = pytest.mark.parametrize("degree", range(6))


@st.composite
def curves(draw):
    degree = draw(st.integers(0, 5))
    count = degree + draw(st.integers(1, 8))
    coefficients = draw(st.lists(st.floats(-10, 10), min_size=count, max_size=count))
    return degree, spline.clamped_knots(DURATION, count, degree), np.array(coefficients)


@given(curves())
def test_basis_is_a_partition_of_unity(curve):
    degree, knots, _ = curve
    values = spline.values(knots, degree, np.eye(len(knots) - degree - 1), np.linspace(0, DURATION, 77))
    np.testing.assert_allclose(values.sum(axis=1), 1.0, rtol=0, atol=1e-14)
    assert values.min() >= 0


@given(curves())
def test_curve_stays_within_the_hull_of_its_coefficients(curve):
    degree, knots, coefficients = curve
    values = spline.values(knots, degree, coefficients, np.linspace(0, DURATION, 301))
    assert coefficients.min() - 1e-12 <= values.min()
    assert values.max() <= coefficients.max() + 1e-12


@given(curves())
def test_curve_stays_within_the_local_hull(curve):
    degree, knots, coefficients = curve
    for time in np.linspace(0, DURATION, 31):
        span = min(np.searchsorted(knots, time, side="right"), len(coefficients)) - 1
        active = coefficients[span - degree : span + 1]
        value = spline.values(knots, degree, coefficients, np.array([time])).item()
        assert active.min() - 1e-12 <= value <= active.max() + 1e-12


@given(curves())
def test_curve_begins_and_ends_at_its_outer_coefficients(curve):
    degree, knots, coefficients = curve
    ends = spline.values(knots, degree, coefficients, np.array([0.0, DURATION]))
    np.testing.assert_allclose(ends, coefficients[[0, -1]], rtol=0, atol=1e-14)


@pytest.mark.parametrize("degree", range(1, 6))
def test_derivative_is_the_finite_difference(degree: int):
    count, step = degree + 6, 1e-5
    knots = spline.clamped_knots(DURATION, count, degree)
    coefficients = np.random.default_rng(degree).uniform(-5, 5, (count, 2))
    inner_knots, slopes = spline.derivative(knots, degree, coefficients)
    assert slopes.shape == (count - 1, 2)
    times = np.random.default_rng(0).uniform(0.01, DURATION - 0.01, 60)
    times = times[np.abs(times[:, None] - knots).min(axis=1) > 2 * step]
    found = spline.values(knots, degree, coefficients, times, 1)
    np.testing.assert_array_equal(found, spline.values(inner_knots, degree - 1, slopes, times))
    ahead, behind = (spline.values(knots, degree, coefficients, times + sign * step) for sign in (1, -1))
    np.testing.assert_allclose(found, (ahead - behind) / (2 * step), rtol=0, atol=2e-6)


@degrees
def test_knots_are_uniform_and_clamped(degree: int):
    knots = spline.clamped_knots(DURATION, degree + 5, degree)
    assert len(knots) == 2 * degree + 6
    assert np.all(knots[: degree + 1] == 0)
    assert np.all(knots[-degree - 1 :] == DURATION)
    np.testing.assert_allclose(np.diff(knots[degree : len(knots) - degree]), DURATION / 5)


@degrees
def test_a_polynomial_needs_degree_plus_one_coefficients(degree: int):
    assert len(spline.clamped_knots(DURATION, degree + 1, degree)) == 2 * degree + 2
    with pytest.raises(ValueError, match=f"at least {degree + 1} coefficients, got {degree}"):
        spline.clamped_knots(DURATION, degree, degree)


@degrees
def test_times_outside_take_the_end_values(degree: int):
    knots = spline.clamped_knots(DURATION, degree + 3, degree)
    identity = np.eye(degree + 3)
    outside = spline.values(knots, degree, identity, np.array([-1e-9, DURATION + 1e-9]))
    ends = spline.values(knots, degree, identity, np.array([0.0, DURATION]))
    np.testing.assert_array_equal(outside, ends)


def test_piecewise_constant_has_no_derivative():
    with pytest.raises(ValueError, match="no derivative"):
        spline.derivative(spline.clamped_knots(DURATION, 4, 0), 0, np.zeros(4))


@pytest.mark.parametrize(
    ("degree", "knots", "order"),
    [
        (1, [0, 0, 1, 1, 2, 2], 0),
        (2, [0, 0, 0, 1, 1, 1, 2, 2, 2], 0),
        (2, [0, 0, 0, 1, 1, 2, 2, 2], 1),
        (3, [0, 0, 0, 0, 1, 1, 1, 2, 2, 2, 2], 1),
        (3, [0, 0, 0, 0, 0.5, 1, 1, 2, 2, 2, 2], 2),
        (5, [0] * 6 + [1] * 6 + [1.5] * 5 + [2] * 6, 1),
    ],
    ids=str,
)
def test_extremes_have_both_sides_of_every_jump(degree: int, knots: list[float], order: int):
    table = np.array(knots, dtype=float)
    numbers = set()
    for seed in range(20):
        coefficients = np.random.default_rng(seed).uniform(-5, 5, (len(knots) - degree - 1, 2))
        found = spline.extremes(table, degree, coefficients, order)
        numbers.add(len(found))
        # Every piece by itself, as a polynomial through enough points of its inside.
        for first, last in pairwise(sorted(set(knots))):
            inside = (first + last) / 2 + (last - first) * 0.499 * np.cos(np.linspace(0, np.pi, degree + 1))
            values = spline.values(table, degree, coefficients, inside)
            for column in range(2):
                piece = np.polynomial.Polynomial.fit(inside, values[:, column], degree).deriv(order)
                dense = piece(np.linspace(first, last, 501))
                assert found[:, column].min() <= dense.min() + 1e-7
                assert found[:, column].max() >= dense.max() - 1e-7
    assert len(numbers) == 1


@pytest.mark.parametrize("order", [0, 1, 2])
@pytest.mark.parametrize("degree", [2, 3, 5])
def test_extremes_are_values_that_there_are(degree: int, order: int):
    knots = spline.clamped_knots(DURATION, 9, degree)
    coefficients = np.random.default_rng(0).uniform(-5, 5, (9, 2))
    found = spline.extremes(knots, degree, coefficients, order)
    for _ in range(order):
        knots, coefficients = spline.derivative(knots, degree, coefficients)
        degree -= 1
    times = np.union1d(np.linspace(0, DURATION, 40_001), knots)
    values = spline.values(knots, degree, coefficients, times)
    np.testing.assert_allclose(found.max(axis=0), values.max(axis=0), rtol=1e-6)
    np.testing.assert_allclose(found.min(axis=0), values.min(axis=0), rtol=1e-6)


def finer_knots(degree: int, count: int) -> np.ndarray:
    return spline.clamped_knots(DURATION, 2 * count - degree, degree)


@given(curves())
def test_inserted_knots_leave_the_curve_and_the_bounds_of_all_derivatives(curve):
    degree, knots, coefficients = curve
    finer = finer_knots(degree, len(coefficients))
    found = spline.refined(knots, degree, coefficients[:, None], finer)[:, 0]
    times = np.linspace(0, DURATION, 301)
    before = spline.values(knots, degree, coefficients, times)
    np.testing.assert_allclose(spline.values(finer, degree, found, times), before, rtol=0, atol=1e-12)
    for order in range(degree + 1):
        size = 1e-12 * (1 + np.abs(coefficients).max())
        assert coefficients.min() - size <= found.min()
        assert found.max() <= coefficients.max() + size
        if order < degree:
            knots, coefficients = spline.derivative(knots, degree - order, coefficients)
            finer, found = spline.derivative(finer, degree - order, found)


def test_knots_that_leave_some_out_are_refused():
    knots = spline.clamped_knots(DURATION, 8, 3)
    with pytest.raises(ValueError, match="expected knots that have all those of the curves"):
        spline.refined(knots, 3, np.zeros((8, 2)), spline.clamped_knots(DURATION, 9, 3))
