"""Intervals of numbers as expressions: what sums, products and choices of all their numbers can be [Moore,
Kearfott, Cloud: Introduction to Interval Analysis, 2009, ch. 5].

Rounding is not directed: bounds hold to about 1e-14 of the numbers that enter.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce
from typing import Any

import casadi as ca

from oed.kernel.dynamics.expression import Expression

INFINITE = float("inf")


@dataclass(frozen=True)
class Interval:
    """Numbers from `low` to `high` (scalar SX); the same object twice for a single number.

    A bound that is not a number stands for any: nothing is known there.
    """

    low: Expression
    high: Expression

    @property
    def single(self) -> bool:
        """Whether it is a number rather than a stretch."""
        return self.low is self.high

    def __add__(self, other: Interval) -> Interval:
        """All sums."""
        if self.single and other.single:
            return number(self.low + other.low)
        return Interval(self.low + other.low, self.high + other.high)

    def __neg__(self) -> Interval:
        """All opposites."""
        return number(-self.low) if self.single else Interval(-self.high, -self.low)

    def __sub__(self, other: Interval) -> Interval:
        """All differences."""
        return self + -other

    def __mul__(self, other: Interval) -> Interval:
        """All products."""
        if self.single and other.single:
            return number(self.low * other.low)
        if self.single or other.single:
            factor, stretch = (self, other) if self.single else (other, self)
            ends = [factor.low * stretch.low, factor.low * stretch.high]
        else:
            ends = [one * two for one in (self.low, self.high) for two in (other.low, other.high)]
        # 0 times something unbounded is not a number, which least and largest leave out as long as there are
        # others: a bound that is none stands for any.
        return Interval(reduce(ca.fmin, ends), reduce(ca.fmax, ends))

    def rising(self, function: Callable[[Any], Any]) -> Interval:
        """All values of a function that never falls."""
        return Interval(function(self.low), function(self.high))

    @property
    def apart(self) -> Expression:
        """Whether 0 is not among the numbers."""
        return ca.logic_or(self.low > 0, self.high < 0)

    @property
    def square(self) -> Interval:
        """All squares."""
        if self.single:
            return number(self.low**2)
        low, high = self.low**2, self.high**2
        around = ca.logic_and(self.low < 0, self.high > 0)
        return Interval(ca.if_else(around, 0, ca.fmin(low, high)), ca.fmax(low, high))

    @property
    def inverse(self) -> Interval:
        """All reciprocals; everything where 0 is among the numbers."""
        if self.single:
            return number(1 / self.low)
        return Interval(1 / self.high, 1 / self.low).where(self.apart, EVERYTHING)

    def hull(self, other: Interval) -> Interval:
        """All numbers of both and between."""
        low, high = ca.fmin(self.low, other.low), ca.fmax(self.high, other.high)
        lows, highs = (self.low, other.low), (self.high, other.high)
        return Interval(known(low, *lows, -INFINITE), known(high, *highs, INFINITE))

    def where(self, condition: Expression, other: Interval) -> Interval:
        """This one under a condition, else the other."""
        low = ca.if_else(condition, self.low, other.low)
        if self.single and other.single:
            return number(low)
        return Interval(low, ca.if_else(condition, self.high, other.high))


def number(value: Expression) -> Interval:
    """The interval of one number."""
    return Interval(value, value) if isinstance(value, ca.SX) else number(ca.SX(value))


def known(bound: Expression, first: Expression, second: Expression, else_: float) -> Expression:
    """A bound that is the least or largest of two, where both are numbers: these leave out what is none.

    Args:
        bound: least or largest of both.
        first: an end.
        second: another end.
        else_: what there is where one is no number.
    """
    return ca.if_else(ca.logic_and(first <= INFINITE, second <= INFINITE), bound, else_)


ZERO, ONE = number(0.0), number(1.0)
EVERYTHING = Interval(ca.SX(-INFINITE), ca.SX(INFINITE))
