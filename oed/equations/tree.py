"""Expressions: numbers, names and operations on other expressions.

A sum or product of any length is one operation, so that a tree is no deeper than its text's parentheses.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from oed.equations.dimensions import PLAIN, Dimension
from oed.equations.functions import FUNCTIONS, OPERATORS
from oed.foundation.shown import written
from oed.foundation.text import did_you_mean

LONGEST_SHOWN = 40
"""Largest number of characters of a part of an expression that messages show."""
MOST_SHOWN = 12
"""Largest number of names that a message lists."""
LARGEST_POWER = 100
"""Largest power of a quantity with a unit."""
_TABLE = {**FUNCTIONS, **OPERATORS}


@dataclass(eq=False)
class ExpressionError(ValueError):
    """A mistake in an expression.

    Attributes:
        message: what is wrong.
        offset: where in the text, from 0.
    """

    message: str
    offset: int

    def __str__(self) -> str:
        """Return the message."""
        return self.message


@dataclass(frozen=True)
class Expression(ABC):
    """An expression, or a part of one.

    Attributes:
        text: text of the expression.
        offset: where the text begins in that of the outermost expression.
    """

    text: str
    offset: int

    @property
    def shown(self) -> str:
        """Text on one line, cut where it is long."""
        text = " ".join(self.text.split())
        return text if len(text) <= LONGEST_SHOWN else f"{text[: LONGEST_SHOWN - 3]}..."

    @property
    def names(self) -> dict[str, int]:
        """Names that are used, in their order, and the offset of the first use."""
        return {}

    @property
    def constant(self) -> float | None:
        """Value of an expression without names; None if there are names in it."""
        return None

    @abstractmethod
    def casadi(self, values: Mapping[str, Any]) -> Any:
        """Compute the value; DM if there are no names in the expression.

        Args:
            values: SX, MX, DM or numbers by name.

        Raises:
            ExpressionError: a name without a value.
        """

    @abstractmethod
    def dimension(self, dimensions: Mapping[str, Dimension]) -> Dimension | None:
        """Derive the dimension from those of the names; None for a bare 0, which suits any.

        Raises:
            ExpressionError: an unknown name, or parts whose dimensions do not go together.
        """

    def require(self, expected: Dimension, dimensions: Mapping[str, Dimension]) -> None:
        """Check the dimension.

        Raises:
            ExpressionError: it is not the one that is expected, or there is none.
        """
        dimension = self.dimension(dimensions)
        if dimension is not None and not dimension.fits(expected):
            wanted = expected.text or expected.words
            raise ExpressionError(f"{self.shown} is {dimension.words}, expected {wanted}", self.offset)


@dataclass(frozen=True)
class Number(Expression):
    """A number that is written out, pi, or an operation on numbers.

    Attributes:
        value: the number.
        unit: dimension of the number; None for a bare 0, which suits any.
    """

    value: float
    unit: Dimension | None

    def __post_init__(self) -> None:
        """Refuse what is not finite, such as 9**9**9 and 1/0."""
        if not math.isfinite(self.value):
            raise ExpressionError(f"{self.shown} is no finite number", self.offset)

    @property
    def constant(self) -> float:
        """Value of the number."""
        return self.value

    def casadi(self, values: Mapping[str, Any]) -> Any:
        """Return the number."""
        return ca.DM(self.value)

    def dimension(self, dimensions: Mapping[str, Dimension]) -> Dimension | None:
        """Return the dimension of the number."""
        return self.unit


@dataclass(frozen=True)
class Name(Expression):
    """The name of a quantity."""

    @property
    def names(self) -> dict[str, int]:
        """The name itself."""
        return {self.text: self.offset}

    def casadi(self, values: Mapping[str, Any]) -> Any:
        """Return the value that the name stands for."""
        value = self._look_up(values)
        return ca.DM(value) if isinstance(value, int | float) else value

    def dimension(self, dimensions: Mapping[str, Dimension]) -> Dimension | None:
        """Return the dimension of the quantity."""
        dimension: Dimension = self._look_up(dimensions)
        return dimension

    def _look_up(self, entries: Mapping[str, Any]) -> Any:
        if self.text in entries:
            return entries[self.text]
        names = list(entries)
        more = ", ..." if len(names) > MOST_SHOWN else ""
        there_are = f"; known here: {', '.join(names[:MOST_SHOWN])}{more}" if names else ""
        hint = did_you_mean(self.text, names) or there_are
        raise ExpressionError(f"unknown name {written(self.text)}{hint}", self.offset)


@dataclass(frozen=True)
class Operation(Expression):
    """A function of operands, or operators of one strength between them.

    Attributes:
        symbols: for each operand but the first the function's name, or the operator before it; the only
            one's name or sign where there is one operand.
        operands: arguments of the function or the operators, which are applied from the left.
    """

    symbols: tuple[str, ...]
    operands: tuple[Expression, ...]

    @property
    def names(self) -> dict[str, int]:
        """Names in the operands."""
        names = dict[str, int]()
        for operand in self.operands:
            for name, offset in operand.names.items():
                names.setdefault(name, offset)
        return names

    def casadi(self, values: Mapping[str, Any]) -> Any:
        """Apply the function, or the operators, to the operands' values."""
        return self._apply([operand.casadi(values) for operand in self.operands])

    def dimension(self, dimensions: Mapping[str, Dimension]) -> Dimension | None:
        """Derive the dimension from those of the operands; the exponent of a unit must be a number."""
        if self.symbols == ("^",):
            return self._power(dimensions)
        function = _TABLE[self.symbols[0]]
        if function.gives is None:
            product: Dimension = self._apply([part.dimension(dimensions) or PLAIN for part in self.operands])
            return product
        first, common = self.operands[0], None
        for symbol, operand in zip((self.symbols[0], *self.symbols), self.operands, strict=False):
            dimension = operand.dimension(dimensions)
            if common is None:
                first, common = operand, dimension
            elif dimension is not None and not common.fits(dimension):
                raise ExpressionError(
                    f"{first.shown} is {common.words}, {operand.shown} is {dimension.words}: they cannot be "
                    f"{_TABLE[symbol].verb}",
                    operand.offset,
                )
        if function.takes and common is not None and not common.plain:
            message = f"{first.shown} is {common.words}: {self.symbols[0]} takes {function.takes}"
            raise ExpressionError(message, first.offset)
        return function.gives(common)

    def _apply(self, values: Sequence[Any]) -> Any:
        total, *further = values
        if not further:
            return _TABLE[self.symbols[0]].apply(total)
        for symbol, value in zip(self.symbols, further, strict=True):
            total = _TABLE[symbol].apply(total, value)
        return total

    def _power(self, dimensions: Mapping[str, Dimension]) -> Dimension:
        base, exponent = (operand.dimension(dimensions) or PLAIN for operand in self.operands)
        base_text, exponent_text = (operand.shown for operand in self.operands)
        power, issue = self.operands[1].constant, ""
        if not exponent.plain:
            issue = f"{exponent_text} is {exponent.words}: an exponent is a plain number"
        elif not base.plain and (power is None or abs(power) > LARGEST_POWER):
            size = "" if power is None else f" of at most {LARGEST_POWER}"
            issue = f"{base_text} is {base.words}: its exponent must be a number{size}, not {exponent_text}"
        if issue:
            raise ExpressionError(issue, self.operands[1].offset)
        return PLAIN if base.plain else base ** (power or 0)
