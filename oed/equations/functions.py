"""Functions and operators that expressions may use, and the dimensions that they take and give."""

from __future__ import annotations

import operator
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca

from oed.equations.dimensions import ANGLE, PLAIN, Dimension
from oed.foundation.text import count

MOST_ARGUMENTS = 100
"""Largest number of arguments in a call: nobody writes more."""
NUMBER = "a plain number"
TURN = "an angle or a plain number"


def _same(dimension: Dimension | None) -> Dimension | None:
    return dimension


@dataclass(frozen=True)
class Function:
    """A function or an operator.

    Attributes:
        apply: computes the value of one argument, or of two; further ones are applied to that value in turn.
        gives: derives the dimension of the value from that of the arguments, which is None for a bare 0; None
            where `apply` computes dimensions as well as values.
        takes: kind of the arguments; "" where any dimension will do.
        least: smallest number of arguments.
        most: largest number of arguments.
        verb: what cannot be done with arguments of different dimensions.
    """

    apply: Callable[..., Any]
    gives: Callable[[Dimension | None], Dimension | None] | None = _same
    takes: str = ""
    least: int = 1
    most: int = 1
    verb: str = "compared"

    @property
    def arity(self) -> str:
        """Number of arguments in words."""
        if self.least == self.most:
            return count(self.most, "argument")
        return f"{self.least} to {self.most} arguments"


def _plain(_: Dimension | None) -> Dimension:
    return PLAIN


def _angle(_: Dimension | None) -> Dimension:
    return ANGLE


def _root(dimension: Dimension | None) -> Dimension | None:
    return None if dimension is None else dimension**0.5


FUNCTIONS: dict[str, Function] = {
    **{
        name: Function(getattr(ca, name), gives, takes)
        for names, gives, takes in (
            ("exp log log10 sinh cosh tanh", _plain, NUMBER),
            ("sin cos tan", _plain, TURN),
            ("asin acos atan", _angle, NUMBER),
        )
        for name in names.split()
    },
    "atan2": Function(ca.atan2, _angle, least=2, most=2),
    "sqrt": Function(ca.sqrt, _root),
    "abs": Function(ca.fabs),
    "min": Function(ca.fmin, least=2, most=MOST_ARGUMENTS),
    "max": Function(ca.fmax, least=2, most=MOST_ARGUMENTS),
}
"""Functions by their names in calls."""
MINUS = "-()"
OPERATORS = {
    MINUS: Function(operator.neg),
    "+": Function(operator.add, verb="added"),
    "-": Function(operator.sub, verb="subtracted"),
    "*": Function(operator.mul, None),
    "/": Function(operator.truediv, None),
    "^": Function(operator.pow, None),
}
"""Operators by their signs; `MINUS` is the one before a single operand."""
OTHER_NAMES = {
    "ln": "log",
    "lg": "log10",
    "arcsin": "asin",
    "arccos": "acos",
    "arctan": "atan",
    "arctan2": "atan2",
    "fabs": "abs",
    "pow": "^",
    "power": "^",
}
"""Names of functions, and of powers, in other languages."""
