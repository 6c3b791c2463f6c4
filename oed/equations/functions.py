"""Functions that expressions may call, and the dimensions that they take and give."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import reduce
from typing import Any

import casadi as ca

from oed.equations.dimensions import ANGLE, PLAIN, Dimension

MOST_ARGUMENTS = 100
"""Of one call: an expression of more is none that a person wrote."""
NUMBER = "a plain number"
TURN = "an angle or a plain number"
Rule = Callable[[Dimension], Dimension]


@dataclass(frozen=True)
class Function:
    """A function of expressions.

    Attributes:
        apply: to CasADi's expressions, or its numbers.
        gives: dimension of the result, from that of the arguments, which is one.
        takes: what the arguments must be; "" where any dimension will do.
        least: number of arguments.
        most: number of arguments.
        keeps_zero: whether of a 0, which suits any dimension, it makes another.
    """

    apply: Callable[..., Any]
    gives: Rule
    takes: str = ""
    least: int = 1
    most: int = 1
    keeps_zero: bool = False

    @property
    def count(self) -> str:
        """How many arguments it takes, in words."""
        few = {1: "1 argument", 2: "2 arguments"}
        return few.get(self.most, f"{self.least} to {self.most} arguments")


def _least(*values: Any) -> Any:
    return reduce(ca.fmin, values)


def _largest(*values: Any) -> Any:
    return reduce(ca.fmax, values)


def _plain(_: Dimension) -> Dimension:
    return PLAIN


def _angle(_: Dimension) -> Dimension:
    return ANGLE


def _own(dimension: Dimension) -> Dimension:
    return dimension


def _root(dimension: Dimension) -> Dimension:
    return dimension ** Fraction(1, 2)


FUNCTIONS: dict[str, Function] = {
    **{
        name: Function(getattr(ca, name), _plain, NUMBER)
        for name in ("exp", "log", "log10", "sinh", "cosh", "tanh")
    },
    **{name: Function(getattr(ca, name), _plain, TURN) for name in ("sin", "cos", "tan")},
    **{name: Function(getattr(ca, name), _angle, NUMBER) for name in ("asin", "acos", "atan")},
    "atan2": Function(ca.atan2, _angle, least=2, most=2),
    "sqrt": Function(ca.sqrt, _root, keeps_zero=True),
    "abs": Function(ca.fabs, _own, keeps_zero=True),
    "min": Function(_least, _own, least=2, most=MOST_ARGUMENTS, keeps_zero=True),
    "max": Function(_largest, _own, least=2, most=MOST_ARGUMENTS, keeps_zero=True),
}
"""By name."""
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
"""What functions, and powers, are called elsewhere."""
