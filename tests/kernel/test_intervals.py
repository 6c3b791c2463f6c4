"""Interval enclosures of operations and functions, against the functions themselves at many points."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oed.foundation.arrays import Array
from oed.kernel.dynamics.interval_function import IntervalFunction
from oed.kernel.dynamics.intervals import EVERYTHING, OPERATIONS, hull, inverse, power, product, sine
from oed.robots.models.arcs import sinc
from oed.robots.models.lag import lag_shares

FUNCTIONS = {
    "polynomial": lambda x, a: x**3 - a * x**2 + (x - 1) ** 5 + (x + 9) ** -3,
    "waves": lambda x, a: ca.sin(a * x) * ca.cos(3 * x),
    "tangent": lambda x, a: ca.tan(0.3 * x) + ca.atan(a * x),
    "quotient": lambda x, a: (x + 1) / (x**2 + a),
    "roots": lambda x, a: ca.sqrt(x**2 + 1e-3 * a) + ca.hypot(x, a),
    "corners": lambda x, a: ca.fabs(x - a) + ca.fmax(ca.sin(x), a - 1) - ca.fmin(x, a * x),
    "exponentials": lambda x, a: ca.exp(-a * x) + ca.expm1(x) + ca.cosh(x) * ca.sinh(x / 2) - ca.tanh(a * x),
    "logarithms": lambda x, a: ca.log(x + 4) + ca.log1p(x / 9 + 0.5) + (x + 4) ** 1.5,
    "powers": lambda x, a: a**x + (x + 4) ** a + (x + 4) ** (0.1 * x) + 2.5**-x,
    "roots down to 0": lambda x, a: ca.fmax(x, 0) ** 1.5 + ca.fmax(x, 0) ** 0.25,
    "arcs": lambda x, a: ca.asin(x / 6) - ca.acos(a * ca.sin(x) / 3),
    "arcs of what may be none": lambda x, a: ca.fmax(ca.asin(x), -a) + ca.fmin(ca.acos(a * x), 3),
    "angle": lambda x, a: ca.atan2(x, a + 0.1 * x),
    "choice": lambda x, a: ca.if_else(ca.logic_and(x > 0, x <= a), x, -(x**2)),
    "either": lambda x, a: ca.if_else(ca.logic_or(x < -a, ca.logic_not(x < a)), 2.0, x),
    "steps": lambda x, a: ca.floor(x) - ca.ceil(2 * x) + ca.sign(x) + (x == a) + (x != a),
    "poles": lambda x, a: 0.002 / (a - x) + 1 / ca.tan(x) + (x + 1) ** -1,
    "numbers as conditions": lambda x, a: ca.if_else(x - a, x, 3 * a) + ca.if_else(ca.floor(x), a, -x),
    "logic of numbers": lambda x, a: (
        ca.logic_and(ca.floor(x), ca.sign(x)) + 2 * ca.logic_or(ca.ceil(x), x > a) + ca.logic_not(ca.floor(x))
    ),
    "nothing times everything": lambda x, a: (
        ca.fmax((a > 5) / x, -3) + ca.if_else((a > 5) / x < 1, 7, 2) + ca.fmin(-1, (a > 5) * ca.log(x**2))
    ),
    "roots of what may be negative": lambda x, a: ca.fmin(ca.sqrt(x), a) + ca.fmax(ca.log(a - x), -1),
    "series": lambda x, a: sinc(a * x),
    "lag": lambda x, a: lag_shares(a, ca.fabs(x))[0],
    "guards": lambda x, a: ca.if_else(x < a, 2 * x, a / ca.if_else(x < a, 1.0, x)) + ca.if_else(x <= a, x, 0),
    "other guards": lambda x, a: ca.if_else(a < x, ca.log(ca.if_else(a < x, x, a)), ca.if_else(x <= 0, x, 1)),
}


JUMPING = {"choice", "either", "steps", "lag", "guards", "poles"}


def written(name: str) -> ca.Function:
    """Return a function f(x, a) of the table."""
    x, a = ca.SX.sym("x"), ca.SX.sym("a")
    return ca.Function("f", [x, a], [FUNCTIONS[name](x, a)])


def bounds_of(function: ca.Function, begin: Array, end: Array, a: Array | float) -> tuple[Array, Array]:
    """Return bounds (2, K) of f(x, a) and of its slope by x, for x from begin (K,) to end (K,)."""
    x, a_symbol = function.sx_in()
    value = function(x, a_symbol)
    with_slope = ca.Function("f", [x, a_symbol], [value, ca.densify(ca.jacobian(value, x))])
    (value,), (slope,) = IntervalFunction(with_slope, [0]).bounds([np.array([begin, end]), a])
    return value, slope


def unless_unknown(bounds: Array) -> Array:
    """Return bounds that stand for all numbers where one of them is NaN."""
    return np.where(np.isnan(bounds).any(axis=0), EVERYTHING, bounds)


def is_inside(numbers: Array, bounds: Array, spare: float = 0.0) -> np.bool_:
    """Tell if all finite numbers (n, K) are within bounds (2, K), but for rounding."""
    low, high = unless_unknown(bounds)
    low, high = low - 1e-12 * np.abs(low) - spare, high + 1e-12 * np.abs(high) + spare
    return np.all(((low <= numbers) & (numbers <= high)) | ~np.isfinite(numbers))


@pytest.mark.parametrize("name", FUNCTIONS)
def test_values_slopes_and_chords_are_within_their_bounds(name: str):
    function = written(name)
    slope_of = ca.Function(
        "slope", function.sx_in(), [ca.jacobian(function(*function.sx_in()), function.sx_in(0))]
    )
    rng = np.random.default_rng(7)
    begin, a = rng.uniform(-3, 3, 200), rng.uniform(0.5, 2, 200)
    end = begin + 10 ** rng.uniform(-4, 0.3, 200)
    value, slope = bounds_of(function, begin, end, a)
    points = begin + (end - begin) * np.linspace(0, 1, 40)[:, None]
    values, slopes = (
        np.array(evaluated(points.reshape(1, -1), np.tile(a, 40)[None])).reshape(points.shape)
        for evaluated in (function, slope_of)
    )
    assert is_inside(values, value)
    assert is_inside(slopes[1:-1], slope)
    # No jump escapes between one point and the next.
    assert is_inside(np.diff(values, axis=0) / np.diff(points, axis=0), slope, spare=1e-7)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_exact_entries_give_what_casadi_gives(name: str):
    function = written(name)
    x, a = np.linspace(-3, 3, 61), 1.3
    (values,) = IntervalFunction(function, []).exact([x, a])
    np.testing.assert_allclose(values, np.array(function(x[None], a)).ravel(), rtol=1e-13, atol=1e-300)


@pytest.mark.parametrize("name", [name for name in FUNCTIONS if name not in JUMPING and " " not in name])
def test_bounds_of_slopes_get_closer_in_proportion_to_the_width(name: str):
    begin = np.array([-1.7, 0.3, 2.1])
    widths = []
    for width in (1e-2, 1e-4):
        least, most = bounds_of(written(name), begin, begin + width, 1.3)[1]
        assert np.all(least <= most)
        widths.append(most - least)
    assert np.all(widths[1] <= 0.03 * widths[0] + 1e-12)


intervals = st.tuples(*[st.floats(-1e3, 1e3)] * 2).map(lambda ends: np.sort(ends)[:, None])
shares = st.floats(0, 1)


def number_in(interval: Array, share: float) -> float:
    """Return a number of an interval (2, 1)."""
    low, high = interval[:, 0]
    return float(np.clip(low + share * (high - low), low, high))


@np.errstate(all="ignore")
@given(first=intervals, second=intervals, share=shares, other=shares)
def test_results_of_numbers_are_in_the_intervals_results(
    first: Array, second: Array, share: float, other: float
):
    x, y = number_in(first, share), number_in(second, other)
    results = [(x * y, product(first, second)), (x, hull(first, second)), (np.sin(x), sine(first))]
    results += [(x**exponent, power(first, exponent)) for exponent in (2, 3, 4)]
    if x:
        results += [(1 / x, inverse(first)), (x**-2, power(first, -2))]
    for number, interval in results:
        assert is_inside(np.array([[number]]), interval, spare=1e-9 * abs(number))


@pytest.mark.parametrize("place", [0, 1])
def test_products_with_an_unknown_bound_are_unknown(place: int):
    unknown = np.array([[-1.0], [5.0]])
    unknown[place] = np.nan
    other = np.array([[1.0], [2.0]])
    assert np.isnan(product(unknown, other)).all()
    assert np.isnan(product(other, unknown)).all()


ARITHMETIC = {ca.OP_ADD, ca.OP_SUB, ca.OP_MUL, ca.OP_DIV, ca.OP_POW, ca.OP_CONSTPOW, ca.OP_HYPOT, ca.OP_ATAN2}
CONDITIONS = {ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE, ca.OP_AND, ca.OP_OR, ca.OP_IF_ELSE_ZERO}
BINARY = {*ARITHMETIC, *CONDITIONS, ca.OP_FMIN, ca.OP_FMAX}


@np.errstate(all="ignore")
@pytest.mark.parametrize("place", [0, 1])
@pytest.mark.parametrize("code", OPERATIONS)
def test_operations_on_unknown_intervals_are_unknown(code: int, place: int):
    unknown, known = (np.array([[0.2], [0.4]]) for _ in range(2))
    unknown[place] = np.nan
    rule = OPERATIONS[code].rule
    operands = [(unknown, known), (unknown, 0.3), (known, unknown)] if code in BINARY else [(unknown,)]
    for chosen in operands:
        assert np.isnan(rule(*chosen)).any(), chosen


@pytest.mark.parametrize("code", OPERATIONS)
def test_numbers_of_intervals_give_numbers_of_the_results(code: int):
    box = np.array([[0.2], [0.4]])
    count = 2 if code in BINARY else 1
    operation = OPERATIONS[code]
    assert is_inside(np.array([[float(operation.exact(*[0.3] * count))]]), operation.rule(*[box] * count))


@pytest.mark.parametrize("exchanged", [False, True])
def test_a_choice_is_bounded_as_one(*, exchanged: bool):
    # Term by term, the bounds of this constant would be 0 and 2.
    x, a = ca.SX.sym("x"), ca.SX.sym("a")
    early, late, curved = ca.logic_and(x < 0.5, x < 0.6), 1.0, ca.cos(x - 0.5)
    choice = ca.if_else(ca.logic_not(early), curved, late) if exchanged else ca.if_else(early, late, curved)
    (low, high), _ = bounds_of(ca.Function("f", [x, a], [choice]), np.array([0.4]), np.array([0.6]), 0.0)
    assert 0.99 < low <= high == 1


@pytest.mark.parametrize("name", ["series", "lag", "guards", "other guards"])
def test_bounds_are_finite_where_a_condition_keeps_divisors_from_0(name: str):
    # The stretches have quotients on one side of the condition and series on the other.
    begin, end = np.zeros(3), np.array([1.5, 3.0, 2.0])
    value, _ = bounds_of(written(name), begin, end, 1.0)
    assert np.isfinite(value).all()
    points = end * np.linspace(0, 1, 50)[:, None]
    assert is_inside(np.array(written(name)(points.reshape(1, -1), 1.0)).reshape(points.shape), value)


def test_slopes_of_the_larger_of_two_are_bounded():
    x, a = ca.SX.sym("x"), ca.SX.sym("a")
    function = ca.Function("f", [x, a], [ca.jacobian(ca.fmax(x, a) * a + ca.fmin(a, x) ** 2, a)])
    begin = np.linspace(0, 2, 21)
    value, _ = bounds_of(function, begin, begin + 0.3, 1.0)
    points = begin + 0.3 * np.linspace(0, 1, 61)[:, None]
    assert np.all((value[0] > -5) & (value[1] < 8))
    assert is_inside(np.array(function(points.reshape(1, -1), 1.0)).reshape(points.shape), value)


def test_derivatives_by_several_arguments():
    x = ca.SX.sym("x", 2)
    value = ca.vertcat(x[0] ** 2 * x[1], 7 * x[1])
    function = ca.Function("f", [x], [value, ca.densify(ca.vec(ca.jacobian(value, x).T))])
    values, slopes = IntervalFunction(function, [0, 1]).bounds(np.array([[[1.0], [2]], [[3], [4]]]))
    np.testing.assert_allclose(values[..., 0], [[3, 16], [21, 28]])
    np.testing.assert_allclose(slopes[..., 0], [[6, 16], [1, 4], [0, 0], [7, 7]])


def test_where_a_derivative_jumps_the_next_may_be_anything():
    x = ca.SX.sym("x")
    value = ca.fabs(x) * x
    slope = ca.jacobian(value, x)
    function = ca.Function("f", [x], [value, slope, ca.jacobian(slope, x)])
    _, slopes, bends = IntervalFunction(function, [0]).bounds([np.array([[-1.0, 0.5], [1.0, 1.0]])])
    assert np.isfinite(slopes).all()
    np.testing.assert_array_equal(np.isfinite(bends), [[[False, True], [False, True]]])


def test_operations_without_a_rule_are_unknown():
    x, a = ca.SX.sym("x"), ca.SX.sym("a")
    function = ca.Function("f", [x, a], [ca.vertcat(ca.erf(x) * a, x + ca.erf(a))])
    without = IntervalFunction(function, [0])
    assert not without.is_bounded
    ((unknown, known),) = without.bounds([np.array([np.zeros(2), np.ones(2)]), np.array([0.5, 0.7])])
    np.testing.assert_array_equal(unknown, np.repeat(EVERYTHING, 2, axis=1))
    np.testing.assert_allclose(known, [[0.52049988, 0.67780119], [1.52049988, 1.67780119]])
    # Only what moves needs a rule.
    assert not IntervalFunction(function, [1]).is_bounded
    assert IntervalFunction(ca.Function("g", [x, a], [x + ca.erf(a)]), [0]).is_bounded


def test_functions_with_calls_that_are_not_written_out_are_unknown():
    x = ca.SX.sym("x", 2)
    inner = ca.Function("inner", [x], [x**2], {"never_inline": True})
    function = IntervalFunction(ca.Function("f", [x], [inner(x)]), [0])
    assert not function.is_bounded
    (bounds,) = function.bounds([np.array([[0.0], [1.0]]), 2.0])
    np.testing.assert_array_equal(bounds, [EVERYTHING, EVERYTHING])
