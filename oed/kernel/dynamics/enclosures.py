"""Bounds of a function and of its slope over a whole stretch of its arguments: interval arithmetic.

CasADi's functions are lists of elementary operations. Each is replaced by the operation on intervals [Moore,
Kearfott, Cloud: Introduction to Interval Analysis, 2009, ch. 5 and 9], carried along with the interval of the
derivative by one variable. The result is again an expression, so that it costs what the function costs,
some ten times. Rounding is not directed: bounds hold to about 1e-14 of the numbers that enter.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import pi
from typing import Any

import casadi as ca

from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.intervals import EVERYTHING, INFINITE, ONE, ZERO, Interval, known, number


class NotEnclosed(Exception):
    """The function has an operation that no bounds are known for."""


@dataclass(frozen=True)
class Enclosure:
    """What a quantity and its slope are over a stretch.

    Attributes:
        value: all its values.
        slope: all its derivatives by the one variable, everything where it may jump.
    """

    value: Interval
    slope: Interval = ZERO

    @property
    def constant(self) -> bool:
        """Whether it is the same number all along."""
        return self.value.single and self.slope is ZERO


def enclosed(function: ca.Function, arguments: Sequence[Sequence[Enclosure]]) -> list[Enclosure]:
    """Enclosures of the output (r,) of a function of SX from those of its arguments' entries.

    Raises:
        NotEnclosed: an operation that no bounds are known for.
    """
    if any(function.instruction_id(place) == ca.OP_CALL for place in range(function.n_instructions())):
        raise NotEnclosed
    choices, made, either = _choices(function), _sources(function), _either_way(function)
    found: list[Enclosure] = []
    results = [Enclosure(ZERO)] * function.nnz_out(0)
    for place in range(function.n_instructions()):
        operation, read = function.instruction_id(place), function.instruction_input(place)
        if operation == ca.OP_INPUT:
            found.append(arguments[read[0]][read[1]])
        elif operation == ca.OP_CONST:
            found.append(Enclosure(number(function.instruction_constant(place))))
        elif place in choices:
            condition, *ways = choices[place]
            found.append(_either(found[condition], *_guarded(condition, ways, found, made, function)))
        else:
            operands = [found[one] for one in made[place]]
            if operation == ca.OP_IF_ELSE_ZERO:
                condition, way = made[place]
                operands[1:] = _guarded(condition, [way], found, made, function)
            found.append(operands[0] if operation == ca.OP_OUTPUT else _applied(operation, operands))
            if place in either:
                found[-1] = Enclosure(_at_least_one(found[-1].value), found[-1].slope)
            if operation == ca.OP_OUTPUT:
                results[function.instruction_output(place)[1]] = operands[0]
    return results


def _sources(function: ca.Function) -> list[list[int]]:
    # Of every instruction those that made what it reads: registers are used again and again.
    last: dict[int, int] = {}
    sources = []
    for place in range(function.n_instructions()):
        operation = function.instruction_id(place)
        read = [] if operation == ca.OP_INPUT else function.instruction_input(place)
        sources.append([last[register] for register in read])
        if operation != ca.OP_OUTPUT:
            last[function.instruction_output(place)[0]] = place
    return sources


def _choices(function: ca.Function) -> dict[int, tuple[int, int, int]]:
    # if_else is written as a sum of two terms, one of which is 0. Bounded apart, they would not know of each
    # other. By the adding instruction: those that made the condition and what it chooses between.
    made = _sources(function)
    kinds = [function.instruction_id(place) for place in range(len(made))]
    found = {}
    for place, operands in enumerate(made):
        if kinds[place] != ca.OP_ADD or any(kinds[one] != ca.OP_IF_ELSE_ZERO for one in operands):
            continue
        (first, yes), (second, no) = (made[one] for one in operands)
        if kinds[second] == ca.OP_NOT and made[second] == [first]:
            found[place] = (first, yes, no)
        elif kinds[first] == ca.OP_NOT and made[first] == [second]:
            found[place] = (second, no, yes)
    return found


def _either_way(function: ca.Function) -> set[int]:
    # Sums of a <= b and b <= a, of which one holds: derivatives of the larger of two divide by them.
    made = _sources(function)
    kinds = [function.instruction_id(place) for place in range(len(made))]
    return {
        place
        for place, operands in enumerate(made)
        if kinds[place] == ca.OP_ADD
        and all(kinds[one] == ca.OP_LE for one in operands)
        and made[operands[0]] == made[operands[1]][::-1]
    }


def _at_least_one(one: Interval) -> Interval:
    return one if one.single else Interval(ca.fmax(one.low, 1), one.high)


def _applied(operation: int, operands: Sequence[Enclosure]) -> Enclosure:
    if all(one.constant for one in operands):
        elementary = ca.SX.unary if len(operands) == 1 else ca.SX.binary
        return Enclosure(number(elementary(operation, *(one.value.low for one in operands))))
    rule = _RULES.get(operation)
    if rule is None:
        raise NotEnclosed
    return rule(*operands)


def _guarded(
    condition: int, ways: Sequence[int], found: list[Enclosure], made: list[list[int]], function: ca.Function
) -> list[Enclosure]:
    # What a condition lets through, where it holds and where it does not, of the very number that it compares
    # is beyond what it is compared with: so a quotient is kept away from 0.
    chosen = [found[way] for way in ways]
    if function.instruction_id(condition) not in (ca.OP_LT, ca.OP_LE):
        return chosen
    less, more = made[condition]
    for side, way in enumerate(ways):
        if way == less:
            chosen[side] = _cut(found[way], found[more].value, below=side == 0)
        elif way == more:
            chosen[side] = _cut(found[way], found[less].value, below=side == 1)
    return chosen


def _cut(one: Enclosure, other: Interval, *, below: bool) -> Enclosure:
    # The part that is below, or above, some of the others.
    low, high = one.value.low, one.value.high
    value = Interval(low, ca.fmin(high, other.high)) if below else Interval(ca.fmax(low, other.low), high)
    return Enclosure(value, one.slope)


def _either(condition: Enclosure, yes: Enclosure, no: Enclosure) -> Enclosure:
    # What a condition chooses; where it is true only for a part of the stretch, anything between both.
    surely, possibly = _truth(condition)
    never = ca.logic_not(possibly)
    if condition.constant:
        return Enclosure(yes.value.where(surely, no.value), yes.slope.where(surely, no.slope))
    value, slope = yes.value.hull(no.value).where(possibly, no.value), EVERYTHING
    return Enclosure(yes.value.where(surely, value), yes.slope.where(surely, no.slope.where(never, slope)))


def _truth(condition: Enclosure) -> tuple[Expression, Expression]:
    # Whether it holds all along, and whether it holds somewhere: every number but 0 is true.
    one = condition.value
    return one.apart, ca.logic_or(one.low != 0, one.high != 0)


def _sum(first: Enclosure, second: Enclosure) -> Enclosure:
    return Enclosure(first.value + second.value, first.slope + second.slope)


def _negative(one: Enclosure) -> Enclosure:
    return Enclosure(-one.value, -one.slope)


def _difference(first: Enclosure, second: Enclosure) -> Enclosure:
    return _sum(first, _negative(second))


def _product(first: Enclosure, second: Enclosure) -> Enclosure:
    slope = _times(first.value, second.slope) + _times(second.value, first.slope)
    return Enclosure(first.value * second.value, slope)


def _times(factor: Interval, slope: Interval) -> Interval:
    # What does not move keeps not moving, whatever it is multiplied with.
    return ZERO if slope is ZERO else factor * slope


def _chained(value: Interval, derivative: Interval, inner: Enclosure) -> Enclosure:
    return Enclosure(value, _times(derivative, inner.slope))


def _square(one: Enclosure) -> Enclosure:
    return _chained(one.value.square, one.value + one.value, one)


def _inverse(one: Enclosure) -> Enclosure:
    # At a pole it jumps from one end of all numbers to the other.
    inverse = one.value.inverse
    found = _chained(inverse, -inverse.square, one)
    return found if one.value.single else Enclosure(inverse, found.slope.where(one.value.apart, EVERYTHING))


def _quotient(first: Enclosure, second: Enclosure) -> Enclosure:
    return _product(first, _inverse(second))


def _rising(
    one: Enclosure, function: Callable[[Any], Any], derivative: Callable[[Interval], Interval]
) -> Enclosure:
    return _chained(one.value.rising(function), derivative(one.value), one)


def _root(one: Enclosure) -> Enclosure:
    value = one.value.rising(lambda end: ca.sqrt(ca.fmax(end, 0)))
    found = _chained(value, Interval(0.5 / value.high, 0.5 / value.low), one)
    return _where(one.value.low >= 0, found)


def _logarithm(one: Enclosure) -> Enclosure:
    return _where(one.value.low > 0, _rising(one, ca.log, lambda inner: inner.inverse))


def _where(defined: Expression, found: Enclosure) -> Enclosure:
    # Where it is a number, all along; elsewhere it may be anything, even none.
    return Enclosure(found.value.where(defined, EVERYTHING), found.slope.where(defined, EVERYTHING))


def _wave(one: Interval, shift: float) -> Interval:
    # The sine of all numbers and a quarter turn or so more; its crests and troughs where it passes them.
    low, high = one.low + shift, one.high + shift
    ends = ca.sin(low), ca.sin(high)

    def passed(angle: float) -> Expression:
        return ca.floor((high - angle) / (2 * pi)) - ca.floor((low - angle) / (2 * pi)) >= 1

    least = ca.if_else(passed(-pi / 2), -1, ca.fmin(*ends))
    return Interval(least, ca.if_else(passed(pi / 2), 1, ca.fmax(*ends)))


def _turned(one: Enclosure, shift: float) -> Enclosure:
    found = _chained(_wave(one.value, shift), _wave(one.value, shift + pi / 2), one)
    # Of what is infinite, or no number, it is none.
    return _where(one.value.high - one.value.low < INFINITE, found)


def _larger(first: Enclosure, second: Enclosure) -> Enclosure:
    highs = first.value.high, second.value.high
    value = Interval(ca.fmax(first.value.low, second.value.low), known(ca.fmax(*highs), *highs, INFINITE))
    above, below = first.value.low > second.value.high, first.value.high < second.value.low
    both = first.slope.hull(second.slope)
    return Enclosure(value, first.slope.where(above, second.slope.where(below, both)))


def _any_power(one: Enclosure, exponent: Enclosure) -> Enclosure:
    power = exponent.value.low
    if exponent.constant and power.is_constant():
        return _power(one, float(power))
    return _exponential(_product(exponent, _applied(ca.OP_LOG, [one])))


def _power(one: Enclosure, exponent: float) -> Enclosure:
    if exponent < 0:
        return _inverse(_power(one, -exponent))
    if not exponent.is_integer():
        return _fractional_power(one, exponent)
    if exponent == 0:
        return Enclosure(ONE)
    half = _power(one, exponent // 2)
    return _square(half) if exponent % 2 == 0 else one if exponent == 1 else _product(one, _square(half))


def _fractional_power(one: Enclosure, exponent: float) -> Enclosure:
    # Of what is not negative: rising, and so is its slope, or falling.
    def raised(end: Expression, power: float) -> Expression:
        return ca.fmax(end, 0) ** power

    slopes = [exponent * raised(end, exponent - 1) for end in (one.value.low, one.value.high)]
    derivative = Interval(*(slopes if exponent > 1 else slopes[::-1]))
    found = _chained(one.value.rising(lambda end: raised(end, exponent)), derivative, one)
    return _where(one.value.low >= 0, found)


def _arc_sine(one: Enclosure) -> Enclosure:
    slope = _inverse(_root(Enclosure(ONE - one.value.square)))
    found = _rising(one, ca.asin, lambda _: slope.value)
    return _where(ca.logic_and(one.value.low >= -1, one.value.high <= 1), found)


def _hyperbolic_cosine(one: Interval) -> Interval:
    low, high = ca.cosh(one.low), ca.cosh(one.high)
    around = ca.logic_and(one.low < 0, one.high > 0)
    return Interval(ca.if_else(around, 1, ca.fmin(low, high)), ca.fmax(low, high))


def _angle(first: Enclosure, second: Enclosure) -> Enclosure:
    # The angle of (second, first): a quarter turn more or less where the second is not positive all along.
    ahead = _rising(_quotient(first, second), ca.atan, lambda inner: (ONE + inner.square).inverse)
    around = Interval(ca.SX(-pi), ca.SX(pi))
    front = second.value.low > 0
    return Enclosure(ahead.value.where(front, around), ahead.slope.where(front, EVERYTHING))


def _exponential(one: Enclosure) -> Enclosure:
    value = one.value.rising(ca.exp)
    return _chained(value, value, one)


def _jumping(function: Callable[[Any], Any], one: Enclosure) -> Enclosure:
    # Steps that never fall: between them nothing moves.
    value = one.value.rising(function)
    return Enclosure(value, ZERO.where(value.low == value.high, EVERYTHING))


def _compared(surely: Expression, possibly: Expression) -> Enclosure:
    # A condition: 1 where it holds all along, between 0 and 1 where it holds somewhere.
    value = Interval(ca.if_else(surely, 1, 0), ca.if_else(possibly, 1, 0))
    return Enclosure(value, ZERO.where(value.low == value.high, EVERYTHING))


def _less(first: Enclosure, second: Enclosure) -> Enclosure:
    one, other = first.value, second.value
    return _compared(one.high < other.low, ca.logic_not(one.low >= other.high))


def _at_most(first: Enclosure, second: Enclosure) -> Enclosure:
    one, other = first.value, second.value
    return _compared(one.high <= other.low, ca.logic_not(one.low > other.high))


def _equal(first: Enclosure, second: Enclosure) -> Enclosure:
    one, other = first.value, second.value
    single = ca.logic_and(one.low == other.high, one.high == other.low)
    return _compared(single, ca.logic_not(ca.logic_or(one.low > other.high, other.low > one.high)))


def _together(logic: Callable[[Any, Any], Any], first: Enclosure, second: Enclosure) -> Enclosure:
    return _compared(*(logic(*both) for both in zip(_truth(first), _truth(second), strict=True)))


def _not(one: Enclosure) -> Enclosure:
    surely, possibly = _truth(one)
    return _compared(ca.logic_not(possibly), ca.logic_not(surely))


_RULES: dict[int, Callable[..., Enclosure]] = {
    ca.OP_ASSIGN: lambda one: one,
    ca.OP_ADD: _sum,
    ca.OP_SUB: _difference,
    ca.OP_MUL: _product,
    ca.OP_DIV: _quotient,
    ca.OP_NEG: _negative,
    ca.OP_EXP: _exponential,
    ca.OP_EXPM1: lambda one: _rising(one, ca.expm1, lambda inner: inner.rising(ca.exp)),
    ca.OP_LOG: _logarithm,
    ca.OP_LOG1P: lambda one: _logarithm(_sum(one, Enclosure(ONE))),
    ca.OP_POW: _any_power,
    ca.OP_CONSTPOW: _any_power,
    ca.OP_SQRT: _root,
    ca.OP_SQ: _square,
    ca.OP_TWICE: lambda one: _sum(one, one),
    ca.OP_SIN: lambda one: _turned(one, 0.0),
    ca.OP_COS: lambda one: _turned(one, pi / 2),
    ca.OP_TAN: lambda one: _quotient(_turned(one, 0.0), _turned(one, pi / 2)),
    ca.OP_ASIN: _arc_sine,
    ca.OP_ACOS: lambda one: _difference(Enclosure(number(pi / 2)), _arc_sine(one)),
    ca.OP_ATAN: lambda one: _rising(one, ca.atan, lambda inner: (ONE + inner.square).inverse),
    ca.OP_ATAN2: _angle,
    ca.OP_SINH: lambda one: _rising(one, ca.sinh, _hyperbolic_cosine),
    ca.OP_COSH: lambda one: _chained(_hyperbolic_cosine(one.value), one.value.rising(ca.sinh), one),
    ca.OP_TANH: lambda one: _rising(one, ca.tanh, lambda inner: ONE - inner.rising(ca.tanh).square),
    ca.OP_LT: _less,
    ca.OP_LE: _at_most,
    ca.OP_EQ: _equal,
    ca.OP_NE: lambda first, second: _not(_equal(first, second)),
    ca.OP_NOT: _not,
    ca.OP_AND: lambda first, second: _together(ca.logic_and, first, second),
    ca.OP_OR: lambda first, second: _together(ca.logic_or, first, second),
    ca.OP_FLOOR: lambda one: _jumping(ca.floor, one),
    ca.OP_CEIL: lambda one: _jumping(ca.ceil, one),
    ca.OP_SIGN: lambda one: _jumping(ca.sign, one),
    ca.OP_FABS: lambda one: _larger(one, _negative(one)),
    ca.OP_FMIN: lambda first, second: _negative(_larger(_negative(first), _negative(second))),
    ca.OP_FMAX: _larger,
    ca.OP_HYPOT: lambda first, second: _root(_sum(_square(first), _square(second))),
    ca.OP_INV: _inverse,
    ca.OP_IF_ELSE_ZERO: lambda condition, yes: _either(condition, yes, Enclosure(ZERO)),
}
"""Enclosures of the elementary operations; the others are rare in kinematics."""
