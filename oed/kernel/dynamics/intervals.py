"""Interval arithmetic: bounds of elementary operations and of their slopes over many boxes at once.

Each elementary operation of CasADi has an extension to intervals [Moore, Kearfott, Cloud: Introduction to
Interval Analysis, 2009, ch. 5 and 9], which carries along intervals of the derivatives.

An interval is an array (..., 2, boxes) of lower bounds, then upper bounds. An enclosure is an array
(1 + directions, 2, boxes): the interval of all values of a quantity, then one of its slopes in each
direction, which are all numbers where the quantity may jump. An exact quantity is a number, or an array with
a number for each box. NaN as a bound means unknown, and an operation on an unknown interval has an unknown
result. Rounding is not directed: bounds hold to about 1e-14 of the numbers that enter, and callers allow for
more than that.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import reduce
from math import pi
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array, Bools

Function = Callable[..., Any]
EVERYTHING = np.array([[-np.inf], [np.inf]])


class ElementaryOperation(NamedTuple):
    """An elementary operation.

    Attributes:
        exact: function of exact operands.
        rule: function of operands of which at least one is an enclosure.
    """

    exact: Function
    rule: Function


def product(factor: Array, interval: Array) -> Array:
    """Return the intervals of all products of an interval (2, boxes) and intervals (..., 2, boxes)."""
    lows, highs = factor[0] * interval, factor[1] * interval
    least, most = np.minimum(lows, highs), np.maximum(lows, highs)
    np.minimum(least[..., 0, :], least[..., 1, :], out=least[..., 0, :])
    np.maximum(most[..., 0, :], most[..., 1, :], out=least[..., 1, :])
    return np.asarray(least)


def inverse(interval: Array) -> Array:
    """Return the interval of all reciprocals: all numbers where 0 is in the interval."""
    has_zero = (interval[..., 0, :] <= 0) & (interval[..., 1, :] >= 0)
    return np.where(has_zero[..., None, :], EVERYTHING, np.divide(1.0, interval[..., ::-1, :]))


def hull(first: Array, second: Array) -> Array:
    """Return the least interval that contains both intervals."""
    ends = np.minimum(first, second)
    np.maximum(first[..., 1, :], second[..., 1, :], out=ends[..., 1, :])
    return ends


def even(function: Function, interval: Array) -> Array:
    """Return the interval (2, boxes) of all values of an even function that rises from 0 on."""
    ends = function(interval)
    bounds = np.minimum(ends, ends[::-1])
    np.maximum(ends[0], ends[1], out=bounds[1])
    np.copyto(bounds[0], function(0.0), where=(interval[0] < 0) & (interval[1] > 0))
    return np.asarray(bounds)


def power(interval: Array, exponent: float) -> Array:
    """Return the interval of all powers with a constant exponent; unknown where roots are undefined."""
    if exponent < 0:
        return inverse(power(interval, -exponent))
    if exponent % 2 == 0:
        return even(lambda ends: ends**exponent, interval)
    return np.asarray(interval**exponent)


def sine(interval: Array, shift: float = 0.0) -> Array:
    """Return the interval of the sines of all numbers plus `shift` [rad]; unknown where one is infinite."""
    angles = interval + shift
    ends = np.sin(angles)
    bounds = np.minimum(ends, ends[::-1])
    np.maximum(ends[0], ends[1], out=bounds[1])
    troughs, crests = (np.floor(angles / (2 * pi) + turn) for turn in (0.25, -0.25))
    np.copyto(bounds[0], -1.0, where=troughs[1] > troughs[0])
    np.copyto(bounds[1], 1.0, where=crests[1] > crests[0])
    # The sine of an infinite number is none, and so is 0 times an infinite number.
    return np.asarray(bounds + 0.0 * angles)


def is_exact(operand: Any) -> bool:
    """Tell an exact quantity from an enclosure."""
    return np.ndim(operand) < 3


def full(operand: Any, shape: tuple[int, ...]) -> Array:
    """Return an enclosure of this shape of what may be an exact quantity."""
    if not is_exact(operand):
        return np.asarray(operand)
    enclosure = np.zeros(shape)
    enclosure[0] = operand
    return enclosure


def _all_full(*operands: Any) -> list[Array]:
    (shape, *_) = (operand.shape for operand in operands if not is_exact(operand))
    return [full(operand, shape) for operand in operands]


def _ends(operand: Any) -> tuple[Any, Any]:
    return (operand, operand) if is_exact(operand) else (operand[0, 0], operand[0, 1])


def _chain(value: Array, derivative: Array, inner: Array) -> Any:
    outer = np.empty_like(inner)
    outer[0] = value
    outer[1:] = product(derivative, inner[1:])
    return outer


def _sum(first: Any, second: Any) -> Any:
    if is_exact(first):
        return _sum(second, first)
    if not is_exact(second):
        return first + second
    total = first.copy()
    total[0] += second
    return total


def _negative(inner: Any) -> Any:
    return -inner if is_exact(inner) else -inner[:, ::-1]


def _product(first: Any, second: Any) -> Any:
    if is_exact(first):
        return _product(second, first)
    if is_exact(second):
        scaled = first * second
        return np.where(second < 0, scaled[:, ::-1], scaled)
    both = product(first[0], second)
    both[1:] += product(second[0], first[1:])
    return both


def _inverse(inner: Array) -> Any:
    # The derivative may be any number at a pole, where the reciprocal jumps.
    return _chain(inverse(inner[0]), -inverse(power(inner[0], 2))[::-1], inner)


def _quotient(first: Any, second: Any) -> Any:
    return _product(first, np.divide(1.0, second) if is_exact(second) else _inverse(second))


def _square(inner: Any) -> Any:
    return np.square(inner) if is_exact(inner) else _chain(even(np.square, inner[0]), 2 * inner[0], inner)


def _rising(function: Function, derivative: Callable[[Array], Array]) -> ElementaryOperation:
    return ElementaryOperation(
        function, lambda inner: _chain(function(inner[0]), derivative(inner[0]), inner)
    )


def _even(function: Function, derivative: Function) -> ElementaryOperation:
    return ElementaryOperation(
        function, lambda inner: _chain(even(function, inner[0]), derivative(inner[0]), inner)
    )


def _sine(shift: float) -> Function:
    return lambda inner: _chain(sine(inner[0], shift), sine(inner[0], shift + pi / 2), inner)


def _power(base: Any, exponent: Any) -> Any:
    if np.ndim(exponent) == 0:
        return _chain(power(base[0], exponent), _scaled(power(base[0], exponent - 1), exponent), base)
    base, exponent = _all_full(base, exponent)
    return EXPONENTIAL.rule(_product(exponent, LOGARITHM.rule(base)))


def _scaled(interval: Array, factor: float) -> Any:
    return factor * (interval if factor > 0 else interval[::-1])


def _angle(first: Any, second: Any) -> Any:
    # The angle of the vector (second, first) jumps by a turn where second < 0.
    first, second = _all_full(first, second)
    angle = ARC_TANGENT.rule(_quotient(first, second))
    anywhere = np.empty_like(angle)
    anywhere[0] = pi * np.sign(EVERYTHING) + 0.0 * (first[0] + second[0])
    anywhere[1:] = EVERYTHING
    return np.where(second[0, 0] > 0, angle, anywhere)


def _larger(first: Any, second: Any) -> Any:
    first, second = _all_full(first, second)
    larger = np.maximum(first, second)
    slope = np.where(first[0, 1] < second[0, 0], second[1:], hull(first[1:], second[1:]))
    larger[1:] = np.where(first[0, 0] > second[0, 1], first[1:], slope)
    return larger


def _smaller(first: Any, second: Any) -> Any:
    return _negative(_larger(_negative(first), _negative(second)))


def _jumping(value: Array, shape: tuple[int, ...]) -> Any:
    # Constant where its bounds agree, and jumping elsewhere.
    steps = np.empty(shape)
    steps[0] = value
    steps[1:] = np.where(value[0] == value[1], 0.0, EVERYTHING)
    return steps


def _steps(function: Function) -> ElementaryOperation:
    return ElementaryOperation(function, lambda inner: _jumping(function(inner[0]), inner.shape))


def _condition(function: Function, bounds: Callable[..., Iterable[Bools]]) -> ElementaryOperation:
    # 1 where a condition certainly holds, between 0 and 1 where it possibly does.
    def rule(*operands: Any) -> Any:
        (shape, *_) = (operand.shape for operand in operands if not is_exact(operand))
        ends = [_ends(operand) for operand in operands]
        value = np.array([*bounds(*ends)], dtype=float)
        value[:, reduce(np.logical_or, (np.isnan(low) | np.isnan(high) for low, high in ends))] = np.nan
        return _jumping(value, shape)

    return ElementaryOperation(lambda *operands: function(*operands) * 1.0, rule)


def _truth(ends: tuple[Any, Any]) -> tuple[Bools, Bools]:
    # Flags of the boxes all of whose numbers are true, and of those some of whose numbers are. Unknown ends,
    # which are not in order, are not true.
    low, high = ends
    is_certain = ((low > 0) | (high < 0)) & (low <= high)
    return np.asarray(is_certain), np.asarray((low != 0) | (high != 0))


def _logical(function: Function) -> ElementaryOperation:
    return _condition(
        function, lambda *both: (function(*flags) for flags in zip(*map(_truth, both), strict=True))
    )


def _equality(first: tuple[Any, Any], second: tuple[Any, Any]) -> tuple[Bools, Bools]:
    is_certain = (first[0] == second[1]) & (first[1] == second[0])
    return is_certain, (first[0] <= second[1]) & (second[0] <= first[1])


def _opposite(flags: tuple[Bools, Bools]) -> tuple[Bools, Bools]:
    is_certain, is_possible = flags
    return ~is_possible, ~is_certain


def _choice(condition: Any, chosen: Any, otherwise: Any) -> Any:
    if is_exact(condition):
        chosen, otherwise = _all_full(chosen, otherwise)
        return np.where(condition, chosen, otherwise)
    condition, chosen, otherwise = _all_full(condition, chosen, otherwise)
    either = np.empty_like(condition)
    # Unknown where the condition is.
    either[0] = hull(chosen[0], otherwise[0]) + 0.0 * condition[0]
    either[1:] = EVERYTHING
    is_certain, is_possible = _truth((condition[0, 0], condition[0, 1]))
    return np.where(is_certain, chosen, np.where(is_possible, either, otherwise))


def _below(inner: Any, bound: Any) -> Any:
    inner, bound = _all_full(inner, bound)
    part = inner.copy()
    np.minimum(inner[0, 1], bound[0, 1], out=part[0, 1])
    return part


def _above(inner: Any, bound: Any) -> Any:
    return _negative(_below(_negative(inner), _negative(bound)))


EXPONENTIAL, LOGARITHM = _rising(np.exp, np.exp), _rising(np.log, inverse)
ROOT = _rising(np.sqrt, lambda value: inverse(2 * np.sqrt(value)))
ARC_TANGENT = _rising(np.arctan, lambda value: inverse(1 + power(value, 2)))
ARC_SINE = _rising(np.arcsin, lambda value: inverse(np.sqrt(1 - power(value, 2)[::-1])))
CHOICE = ElementaryOperation(np.where, _choice)
BELOW, ABOVE = (
    ElementaryOperation(lambda inner, _: inner, _below),
    ElementaryOperation(lambda inner, _: inner, _above),
)
AT_LEAST_ONE = ElementaryOperation(lambda inner: inner, lambda inner: _above(inner, 1.0))
OPERATIONS: dict[int, ElementaryOperation] = {
    ca.OP_ASSIGN: ElementaryOperation(lambda inner: inner, lambda inner: inner),
    ca.OP_ADD: ElementaryOperation(np.add, _sum),
    ca.OP_SUB: ElementaryOperation(np.subtract, lambda first, second: _sum(first, _negative(second))),
    ca.OP_MUL: ElementaryOperation(np.multiply, _product),
    ca.OP_DIV: ElementaryOperation(np.divide, _quotient),
    ca.OP_NEG: ElementaryOperation(np.negative, _negative),
    ca.OP_INV: ElementaryOperation(lambda inner: np.divide(1.0, inner), _inverse),
    ca.OP_TWICE: ElementaryOperation(lambda inner: 2 * inner, lambda inner: 2 * inner),
    ca.OP_SQ: ElementaryOperation(np.square, _square),
    ca.OP_SQRT: ROOT,
    ca.OP_HYPOT: ElementaryOperation(
        np.hypot, lambda first, second: ROOT.rule(_sum(_square(first), _square(second)))
    ),
    ca.OP_POW: ElementaryOperation(np.power, _power),
    ca.OP_CONSTPOW: ElementaryOperation(np.power, _power),
    ca.OP_EXP: EXPONENTIAL,
    ca.OP_EXPM1: _rising(np.expm1, np.exp),
    ca.OP_LOG: LOGARITHM,
    ca.OP_LOG1P: _rising(np.log1p, lambda value: inverse(1 + value)),
    ca.OP_SIN: ElementaryOperation(np.sin, _sine(0.0)),
    ca.OP_COS: ElementaryOperation(np.cos, _sine(pi / 2)),
    ca.OP_TAN: ElementaryOperation(np.tan, lambda inner: _quotient(_sine(0.0)(inner), _sine(pi / 2)(inner))),
    ca.OP_ASIN: ARC_SINE,
    ca.OP_ACOS: ElementaryOperation(np.arccos, lambda inner: _sum(_negative(ARC_SINE.rule(inner)), pi / 2)),
    ca.OP_ATAN: ARC_TANGENT,
    ca.OP_ATAN2: ElementaryOperation(np.arctan2, _angle),
    ca.OP_SINH: _rising(np.sinh, lambda value: even(np.cosh, value)),
    ca.OP_COSH: _even(np.cosh, np.sinh),
    ca.OP_TANH: _rising(np.tanh, lambda value: 1 - power(np.tanh(value), 2)[::-1]),
    ca.OP_FABS: _even(np.abs, np.sign),
    ca.OP_FMIN: ElementaryOperation(np.fmin, _smaller),
    ca.OP_FMAX: ElementaryOperation(np.fmax, _larger),
    ca.OP_FLOOR: _steps(np.floor),
    ca.OP_CEIL: _steps(np.ceil),
    ca.OP_SIGN: _steps(np.sign),
    ca.OP_LT: _condition(np.less, lambda first, second: (first[1] < second[0], first[0] < second[1])),
    ca.OP_LE: _condition(np.less_equal, lambda first, second: (first[1] <= second[0], first[0] <= second[1])),
    ca.OP_EQ: _condition(np.equal, _equality),
    ca.OP_NE: _condition(np.not_equal, lambda *operands: _opposite(_equality(*operands))),
    ca.OP_NOT: _condition(np.logical_not, lambda inner: _opposite(_truth(inner))),
    ca.OP_AND: _logical(np.logical_and),
    ca.OP_OR: _logical(np.logical_or),
    ca.OP_IF_ELSE_ZERO: ElementaryOperation(
        lambda condition, chosen: np.where(condition, chosen, 0.0),
        lambda condition, chosen: _choice(condition, chosen, 0.0),
    ),
}
"""Elementary operations that have a rule; the others are rare in kinematics."""
