"""Interval arithmetic: bounds of elementary operations over many boxes at once.

Each elementary operation of CasADi has an extension to intervals [Moore, Kearfott, Cloud: Introduction to
Interval Analysis, 2009, ch. 5].

An interval is an array (2, boxes) of lower bounds, then upper bounds. An exact quantity is a number, or an
array with a number for each box. NaN as a bound means unknown, and an operation on an unknown interval has an
unknown result. Rounding is not directed: bounds hold to about 1e-14 of the numbers that enter, and callers
allow for more than that.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import reduce
from math import pi
from operator import or_
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
        rule: function of operands of which at least one is an interval, for the interval of the results.
        jumps: function of the flags of the boxes in which the operands may jump, of the result and of the
            operands, for the flags of the boxes in which the result may.
    """

    exact: Function
    rule: Function
    jumps: Function = lambda flags, *_: reduce(or_, flags)


def intervals(*operands: Any) -> list[Array]:
    """Return operands of which at least one is an interval as intervals."""
    (shape, *_) = (operand.shape for operand in operands if np.ndim(operand) == 2)
    return [operand if np.ndim(operand) == 2 else np.full(shape, operand) for operand in operands]


def product(first: Any, second: Any) -> Array:
    """Return the interval of all products."""
    if np.ndim(first) < 2:
        first, second = second, first
    if np.ndim(second) < 2:
        scaled = first * second
        return np.asarray(np.where(second < 0, scaled[::-1], scaled))
    lows, highs = first[0] * second, first[1] * second
    least, most = np.minimum(lows, highs), np.maximum(lows, highs)
    return np.array([np.minimum(*least), np.maximum(*most)])


def inverse(interval: Array) -> Array:
    """Return the interval of all reciprocals: all numbers where 0 is in the interval."""
    has_zero = (interval[0] <= 0) & (interval[1] >= 0)
    return np.where(has_zero, EVERYTHING, np.divide(1.0, interval[::-1]))


def hull(first: Array, second: Array) -> Array:
    """Return the least interval that contains both intervals."""
    return np.array([np.minimum(first[0], second[0]), np.maximum(first[1], second[1])])


def even(function: Function, interval: Array) -> Array:
    """Return the interval of all values of an even function that rises from 0 on."""
    ends = function(interval)
    has_zero = (interval[0] < 0) & (interval[1] > 0)
    return np.array([np.where(has_zero, function(0.0), np.minimum(*ends)), np.maximum(*ends)])


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
    troughs, crests = (np.floor(angles / (2 * pi) + turn) for turn in (0.25, -0.25))
    least = np.where(troughs[1] > troughs[0], -1.0, np.minimum(*ends))
    most = np.where(crests[1] > crests[0], 1.0, np.maximum(*ends))
    # The sine of an infinite number is none, and so is 0 times an infinite number.
    return np.array([least, most]) + 0.0 * angles


def _negative(operand: Any) -> Any:
    return -operand if np.ndim(operand) < 2 else -operand[::-1]


def _quotient(first: Any, second: Any) -> Array:
    return product(first, np.divide(1.0, second) if np.ndim(second) < 2 else inverse(second))


def _square(operand: Any) -> Any:
    return np.square(operand) if np.ndim(operand) < 2 else even(np.square, operand)


def _power(base: Any, exponent: Any) -> Array:
    if np.ndim(exponent) == 0:
        return power(base, exponent)
    base, exponent = intervals(base, exponent)
    return np.asarray(np.exp(product(exponent, np.log(base))))


def _angle(first: Any, second: Any) -> Array:
    # The angle of the vector (second, first) jumps by a turn where second < 0.
    first, second = intervals(first, second)
    anywhere = pi * np.sign(EVERYTHING) + 0.0 * (first + second)
    return np.where(second[0] > 0, np.arctan(_quotient(first, second)), anywhere)


def _ends(operand: Any) -> tuple[Any, Any]:
    return (operand, operand) if np.ndim(operand) < 2 else (operand[0], operand[1])


def _differs(_: Sequence[Any], result: Array, *__: Any) -> Bools:
    # A function that is constant but for jumps may jump where its bounds differ.
    return np.asarray(result[0] != result[1])


def _monotone(function: Function) -> ElementaryOperation:
    return ElementaryOperation(function, function)


def _steps(function: Function) -> ElementaryOperation:
    return ElementaryOperation(function, function, _differs)


def _condition(function: Function, bounds: Callable[..., Iterable[Bools]]) -> ElementaryOperation:
    # 1 where a condition certainly holds, between 0 and 1 where it possibly does.
    def rule(*operands: Any) -> Array:
        ends = [_ends(operand) for operand in operands]
        value = np.array([*bounds(*ends)], dtype=float)
        value[:, reduce(np.logical_or, (np.isnan(low) | np.isnan(high) for low, high in ends))] = np.nan
        return value

    return ElementaryOperation(lambda *operands: function(*operands) * 1.0, rule, _differs)


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


def _choice(condition: Any, chosen: Any, otherwise: Any = 0.0) -> Array:
    is_certain, is_possible = _truth(_ends(condition))
    _, chosen, otherwise = intervals(condition, chosen, otherwise)
    # Unknown where the condition is.
    either = hull(chosen, otherwise) + 0.0 * condition
    return np.asarray(np.where(is_certain, chosen, np.where(is_possible, either, otherwise)))


def _choice_jumps(flags: Sequence[Any], _: Array, condition: Any, *__: Any) -> Bools:
    # What is not chosen may jump.
    is_certain, is_possible = _truth(_ends(condition))
    otherwise = flags[2] if len(flags) > 2 else False
    return np.asarray(np.where(is_certain, flags[1], np.where(is_possible, True, otherwise)))


def _angle_jumps(flags: Sequence[Any], _: Array, __: Any, second: Any) -> Bools:
    return np.asarray(reduce(or_, flags) | np.logical_not(_ends(second)[0] > 0))


def _below(inner: Any, bound: Any) -> Array:
    inner, bound = intervals(inner, bound)
    return np.array([inner[0], np.minimum(inner[1], bound[1])])


def _above(inner: Any, bound: Any) -> Array:
    inner, bound = intervals(inner, bound)
    return np.array([np.maximum(inner[0], bound[0]), inner[1]])


CHOICE = ElementaryOperation(np.where, _choice, _choice_jumps)
BELOW, ABOVE = (ElementaryOperation(lambda inner, _: inner, rule) for rule in (_below, _above))
AT_LEAST_ONE = ElementaryOperation(lambda inner: inner, lambda inner: _above(inner, 1.0))
OPERATIONS: dict[int, ElementaryOperation] = {
    ca.OP_ASSIGN: _monotone(lambda inner: inner),
    ca.OP_ADD: _monotone(np.add),
    ca.OP_SUB: ElementaryOperation(np.subtract, lambda first, second: first + _negative(second)),
    ca.OP_MUL: ElementaryOperation(np.multiply, product),
    ca.OP_DIV: ElementaryOperation(np.divide, _quotient),
    ca.OP_NEG: ElementaryOperation(np.negative, _negative),
    ca.OP_INV: ElementaryOperation(lambda inner: np.divide(1.0, inner), inverse),
    ca.OP_TWICE: _monotone(lambda inner: 2 * inner),
    ca.OP_SQ: ElementaryOperation(np.square, _square),
    ca.OP_SQRT: _monotone(np.sqrt),
    ca.OP_HYPOT: ElementaryOperation(
        np.hypot, lambda first, second: np.sqrt(_square(first) + _square(second))
    ),
    ca.OP_POW: ElementaryOperation(np.power, _power),
    ca.OP_CONSTPOW: ElementaryOperation(np.power, _power),
    ca.OP_EXP: _monotone(np.exp),
    ca.OP_EXPM1: _monotone(np.expm1),
    ca.OP_LOG: _monotone(np.log),
    ca.OP_LOG1P: _monotone(np.log1p),
    ca.OP_SIN: ElementaryOperation(np.sin, sine),
    ca.OP_COS: ElementaryOperation(np.cos, lambda inner: sine(inner, pi / 2)),
    ca.OP_TAN: ElementaryOperation(np.tan, lambda inner: _quotient(sine(inner), sine(inner, pi / 2))),
    ca.OP_ASIN: _monotone(np.arcsin),
    ca.OP_ACOS: ElementaryOperation(np.arccos, lambda inner: np.arccos(inner[::-1])),
    ca.OP_ATAN: _monotone(np.arctan),
    ca.OP_ATAN2: ElementaryOperation(np.arctan2, _angle, _angle_jumps),
    ca.OP_SINH: _monotone(np.sinh),
    ca.OP_COSH: ElementaryOperation(np.cosh, lambda inner: even(np.cosh, inner)),
    ca.OP_TANH: _monotone(np.tanh),
    ca.OP_FABS: ElementaryOperation(np.abs, lambda inner: even(np.abs, inner)),
    ca.OP_FMIN: ElementaryOperation(np.fmin, np.minimum),
    ca.OP_FMAX: ElementaryOperation(np.fmax, np.maximum),
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
        lambda condition, chosen: np.where(condition, chosen, 0.0), _choice, _choice_jumps
    ),
}
"""Elementary operations that have a rule; the others are rare in kinematics."""
