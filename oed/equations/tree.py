"""What an expression is made of: numbers, names, sums, products, powers and calls.

Sums and products of any length are one node, so that a tree is no deeper than its text's parentheses.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from itertools import repeat
from typing import Any

import casadi as ca

from oed.equations.dimensions import PLAIN, Dimension
from oed.equations.functions import FUNCTIONS
from oed.foundation.shown import written
from oed.foundation.text import did_you_mean

LONGEST_SHOWN = 40
"""Characters of a part of an expression that messages show."""
MOST_SHOWN = 12
"""Names that a message lists."""
LARGEST_POWER = 100
"""Of what has a unit."""

Dimensions = Mapping[str, Dimension]


class ExpressionError(ValueError):
    """What is wrong with an expression.

    Attributes:
        message: in words.
        offset: where in its text, from 0.
    """

    def __init__(self, message: str, offset: int) -> None:
        """What is wrong, and where."""
        super().__init__(message)
        self.message, self.offset = message, offset

    def __reduce__(self) -> tuple[type[ExpressionError], tuple[str, int]]:
        """For other processes."""
        return type(self), (self.message, self.offset)


def unknown_name(name: str, known: Iterable[str], offset: int) -> ExpressionError:
    """Why a name is refused.

    Args:
        name: that is used.
        known: names that there are.
        offset: of the name.
    """
    names = list(known)
    more = ", ..." if len(names) > MOST_SHOWN else ""
    there_are = f"; known here: {', '.join(names[:MOST_SHOWN])}{more}" if names else ""
    return ExpressionError(f"unknown name {written(name)}{did_you_mean(name, names) or there_are}", offset)


@dataclass(frozen=True)
class Node(ABC):
    """A part of an expression.

    Attributes:
        source: the text of the whole expression.
        offset: where the part begins in it.
        end: where it ends.
    """

    source: str
    offset: int
    end: int

    @property
    def text(self) -> str:
        """The part as it is written, on one line, cut where it is long."""
        text = " ".join(self.source[self.offset : self.end].split())
        return text if len(text) <= LONGEST_SHOWN else f"{text[: LONGEST_SHOWN - 3]}..."

    @property
    def children(self) -> tuple[Node, ...]:
        """The parts that it is made of."""
        return ()

    @abstractmethod
    def apply(self, *values: Any) -> Any:
        """Its value in CasADi, from those of its children."""

    @abstractmethod
    def dimension(self, known: Dimensions) -> Dimension | None:
        """Its dimension, from those of names; None for a 0, which suits any."""

    @cached_property
    def constant(self) -> float | None:
        """The number that it is, whatever names stand for; None if there are names in it."""
        values = [child.constant for child in self.children]
        return None if None in values else float(self.apply(*map(ca.DM, values)))

    def casadi(self, values: Mapping[str, Any]) -> Any:
        """Its value in CasADi, from those of names."""
        if self.constant is not None:
            return ca.DM(self.constant)
        return self.apply(*[child.casadi(values) for child in self.children])

    def walk(self) -> Iterator[Node]:
        """This and all parts of it."""
        yield self
        for child in self.children:
            yield from child.walk()


@dataclass(frozen=True)
class Number(Node):
    """A number that is written out, or pi."""

    value: float

    def apply(self, *_: Any) -> Any:
        """The number."""
        return ca.DM(self.value)

    def dimension(self, _: Dimensions) -> Dimension | None:
        """A plain number, unless it is 0."""
        return PLAIN if self.value else None


@dataclass(frozen=True)
class Name(Node):
    """The name of a quantity."""

    name: str

    constant = None

    def apply(self, *_: Any) -> Any:
        """Names have no value of their own."""
        raise NotImplementedError

    def casadi(self, values: Mapping[str, Any]) -> Any:
        """What the name stands for."""
        value = self._of(values)
        return ca.DM(value) if isinstance(value, int | float) else value

    def dimension(self, known: Dimensions) -> Dimension | None:
        """That of the quantity."""
        found: Dimension = self._of(known)
        return found

    def _of(self, known: Mapping[str, Any]) -> Any:
        if self.name not in known:
            raise unknown_name(self.name, known, self.offset)
        return known[self.name]


@dataclass(frozen=True)
class Negative(Node):
    """Something with a minus before it."""

    of: Node

    children = property(lambda self: (self.of,))

    def apply(self, *values: Any) -> Any:
        """The negative of its child."""
        return -values[0]

    def dimension(self, known: Dimensions) -> Dimension | None:
        """That of its child."""
        return self.of.dimension(known)


@dataclass(frozen=True)
class Sum(Node):
    """Terms, each with the sign before it; the first has "+"."""

    terms: tuple[Node, ...]
    signs: tuple[str, ...]

    children = property(lambda self: self.terms)

    def apply(self, *values: Any) -> Any:
        """Added and subtracted from the left."""
        total = values[0]
        for sign, value in zip(self.signs[1:], values[1:], strict=True):
            total = total + value if sign == "+" else total - value
        return total

    def dimension(self, known: Dimensions) -> Dimension | None:
        """That of every term."""
        verbs = ["added" if sign == "+" else "subtracted" for sign in self.signs]
        return one_dimension(self.terms, known, verbs)


@dataclass(frozen=True)
class Product(Node):
    """Factors, each with the sign before it; the first has "*"."""

    factors: tuple[Node, ...]
    signs: tuple[str, ...]

    children = property(lambda self: self.factors)

    def apply(self, *values: Any) -> Any:
        """Multiplied and divided from the left."""
        total = values[0]
        for sign, value in zip(self.signs[1:], values[1:], strict=True):
            total = total * value if sign == "*" else total / value
        return total

    def dimension(self, known: Dimensions) -> Dimension | None:
        """The factors' product; a 0 is a plain number here."""
        total = PLAIN
        for sign, factor in zip(self.signs, self.factors, strict=True):
            own = factor.dimension(known) or PLAIN
            total = total * own if sign == "*" else total / own
        return total


@dataclass(frozen=True)
class Power(Node):
    """A power."""

    base: Node
    exponent: Node

    children = property(lambda self: (self.base, self.exponent))

    def apply(self, *values: Any) -> Any:
        """The first to the power of the second."""
        return values[0] ** values[1]

    def dimension(self, known: Dimensions) -> Dimension | None:
        """That of the base to the exponent, which is a number where the base has a unit."""
        base, exponent = self.base.dimension(known) or PLAIN, self.exponent.dimension(known) or PLAIN
        if not exponent.plain:
            raise ExpressionError(
                f"{self.exponent.text} is {exponent.words}: an exponent is a plain number",
                self.exponent.offset,
            )
        power = self.exponent.constant
        if not base.plain and (power is None or abs(power) > LARGEST_POWER):
            size = "" if power is None else f" of at most {LARGEST_POWER}"
            raise ExpressionError(
                f"{self.base.text} is {base.words}: its exponent must be a number{size}, not "
                f"{self.exponent.text}",
                self.exponent.offset,
            )
        return PLAIN if base.plain else base ** Fraction(power or 0)


@dataclass(frozen=True)
class Call(Node):
    """A function of arguments."""

    function: str
    arguments: tuple[Node, ...]

    children = property(lambda self: self.arguments)

    def apply(self, *values: Any) -> Any:
        """The function's value."""
        return FUNCTIONS[self.function].apply(*values)

    def dimension(self, known: Dimensions) -> Dimension | None:
        """What the function gives."""
        function = FUNCTIONS[self.function]
        own = one_dimension(self.arguments, known, repeat("compared"))
        if function.takes and own is not None and not own.plain:
            first = self.arguments[0]
            message = f"{first.text} is {own.words}: {self.function} takes {function.takes}"
            raise ExpressionError(message, first.offset)
        return None if own is None and function.keeps_zero else function.gives(own or PLAIN)


def one_dimension(nodes: Sequence[Node], known: Dimensions, verbs: Iterable[str]) -> Dimension | None:
    """The dimension that all of some parts have; None if all are 0.

    Args:
        nodes: the parts.
        known: dimensions of names.
        verbs: what cannot be done to each if it differs from the first.

    Raises:
        ExpressionError: two differ.
    """
    first: tuple[Node, Dimension] | None = None
    for node, verb in zip(nodes, verbs, strict=False):
        own = node.dimension(known)
        if own is not None and first is not None and not first[1].fits(own):
            there = f"{first[0].text} is {first[1].words}"
            raise ExpressionError(f"{there}, {node.text} is {own.words}: they cannot be {verb}", node.offset)
        if own is not None and first is None:
            first = node, own
    return first[1] if first else None


def finite(node: Node) -> Node:
    """A part, checked to be no number that is not finite, such as 9**9**9 and 1/0.

    Raises:
        ExpressionError: it is.
    """
    if node.constant is not None and not math.isfinite(node.constant):
        raise ExpressionError(f"{node.text} is no finite number", node.offset)
    return node
