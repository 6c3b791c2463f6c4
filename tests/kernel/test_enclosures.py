"""Interval enclosures of CasADi's functions, against the functions themselves at many points."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from oed.kernel.dynamics.enclosures import Enclosure, NotEnclosed, enclosed
from oed.kernel.dynamics.intervals import ONE, Interval, number
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


def compiled(name: str) -> tuple[ca.Function, ca.Function, ca.Function]:
    """The function, its derivative, and (begin, end, a) -> bounds of both."""
    x, a = ca.SX.sym("x"), ca.SX.sym("a")
    function = ca.Function("f", [x, a], [FUNCTIONS[name](x, a)])
    slope = ca.Function("slope", [x, a], [ca.jacobian(function(x, a), x)])
    begin, end = ca.SX.sym("begin"), ca.SX.sym("end")
    (found,) = enclosed(function, [[Enclosure(Interval(begin, end), ONE)], [Enclosure(number(a))]])
    bounds = [found.value.low, found.value.high, found.slope.low, found.slope.high]
    return function, slope, ca.Function("bounds", [begin, end, a], bounds)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_everything_is_inside(name: str):
    function, slope, bounds = compiled(name)
    rng = np.random.default_rng(7)
    for _ in range(80):
        begin, a = rng.uniform(-3, 3), rng.uniform(0.5, 2)
        times = np.linspace(begin, begin + 10 ** rng.uniform(-4, 0.3), 30)
        found = [float(one) for one in bounds(times[0], times[-1], a)]
        # A bound that is not a number stands for any.
        low, high, least, most = np.where(np.isnan(found), [-np.inf, np.inf] * 2, found)
        values, slopes = (np.array(one(times[None, :], a)).ravel() for one in (function, slope))
        # Also from one point to the next: no jump escapes.
        chords = np.diff(values) / np.diff(times)
        for one, least_of, most_of in (
            (values, low, high),
            (slopes[1:-1], least, most),
            (chords, least - 1e-7, most + 1e-7),
        ):
            one = one[np.isfinite(one)]
            assert np.all(least_of - 1e-12 * abs(least_of) <= one)
            assert np.all(one <= most_of + 1e-12 * abs(most_of))


JUMPING = {"choice", "either", "steps", "lag", "guards", "poles"}


@pytest.mark.parametrize("name", [one for one in FUNCTIONS if one not in JUMPING and " " not in one])
def test_narrow_stretches_have_close_bounds(name: str):
    # So that halving ends: in proportion to the width, but where a condition changes.
    _, slope, bounds = compiled(name)
    for begin in (-1.7, 0.3, 2.1):
        widths = []
        for width in (1e-2, 1e-4):
            _, _, least, most = (float(one) for one in bounds(begin, begin + width, 1.3))
            assert least <= float(slope(begin + width / 2, 1.3)) <= most
            widths.append(most - least)
        assert widths[1] <= 0.03 * widths[0] + 1e-12


@pytest.mark.parametrize("exchanged", [False, True])
def test_a_choice_is_bounded_as_one(*, exchanged: bool):
    # Not term by term, which would bound this constant by 0 and 2.
    x, end = ca.SX.sym("x"), ca.SX.sym("end")
    early, late, curved = ca.logic_and(x < 0.5, x < 0.6), 1.0, ca.cos(x - 0.5)
    choice = ca.if_else(ca.logic_not(early), curved, late) if exchanged else ca.if_else(early, late, curved)
    (found,) = enclosed(ca.Function("f", [x], [choice]), [[Enclosure(Interval(x, end), ONE)]])
    low, high = ca.Function("bounds", [x, end], [found.value.low, found.value.high])(0.4, 0.6)
    assert 0.99 < float(low) <= float(high) == 1


@pytest.mark.parametrize("name", ["series", "lag", "guards", "other guards"])
def test_what_a_condition_keeps_from_0_is_bounded(name: str):
    # Over a stretch with quotients on one side of the condition and series on the other.
    function, _, bounds = compiled(name)
    for begin, end in ((0.0, 1.5), (0.0, 3.0), (0.0, 2.0)):
        low, high, *_ = (float(one) for one in bounds(begin, end, 1.0))
        values = np.array(function(np.linspace(begin, end, 50)[None, :], 1.0))
        assert -np.inf < low <= values.min() <= values.max() <= high < np.inf


def test_slopes_of_the_larger_of_two_are_bounded():
    x, end, a = ca.SX.sym("x"), ca.SX.sym("end"), ca.SX.sym("a")
    function = ca.Function("f", [x, a], [ca.jacobian(ca.fmax(x, a) * a + ca.fmin(a, x) ** 2, a)])
    (found,) = enclosed(function, [[Enclosure(Interval(x, end), ONE)], [Enclosure(number(a))]])
    bounds = ca.Function("bounds", [x, end, a], [found.value.low, found.value.high])
    for begin in np.linspace(0, 2, 21):
        low, high = (float(one) for one in bounds(begin, begin + 0.3, 1.0))
        values = np.array(function(np.linspace(begin, begin + 0.3, 61)[None, :], 1.0))
        assert -5 < low <= values.min() <= values.max() <= high < 8


def test_an_operation_without_bounds_is_refused():
    x = ca.SX.sym("x")
    with pytest.raises(NotEnclosed):
        enclosed(ca.Function("f", [x], [ca.erf(x)]), [[Enclosure(Interval(x, x + 1), ONE)]])


def test_a_call_that_is_not_written_out_is_refused():
    x = ca.SX.sym("x", 2)
    inner = ca.Function("inner", [x], [x**2], {"never_inline": True})
    stretches = [Enclosure(Interval(x[0], x[0] + 1), ONE), Enclosure(number(2.0))]
    with pytest.raises(NotEnclosed):
        enclosed(ca.Function("f", [x], [inner(x)]), [stretches])
