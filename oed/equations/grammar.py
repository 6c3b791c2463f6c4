"""The text of an expression, read into a tree: a small grammar, of which nothing is ever run.

Numbers, names, + - * / ^ (or **), parentheses, the functions of `FUNCTIONS` and pi; spaces and line ends
between them. Signs bind as in Python: -x^2 is -(x^2), and x^y^z is x^(y^z).
"""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

from oed.equations.dimensions import Dimension
from oed.equations.functions import FUNCTIONS, OTHER_NAMES
from oed.equations.tree import (
    Call,
    ExpressionError,
    Name,
    Negative,
    Node,
    Number,
    Power,
    Product,
    Sum,
    finite,
)
from oed.foundation.shown import written
from oed.foundation.text import did_you_mean

__all__ = ["RESERVED", "Expression", "ExpressionError", "name_issue", "parse"]

LONGEST = 10_000
"""Characters of an expression."""
DEEPEST = 30
"""Parentheses, signs and powers inside each other."""
CONSTANTS = {"pi": math.pi}
RESERVED = frozenset((*FUNCTIONS, *CONSTANTS))
"""What no quantity may be called."""

_NAME = r"[A-Za-z_][A-Za-z0-9_]*"
_TOKEN = re.compile(
    rf"(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)|(?P<name>{_NAME})"
    r"|(?P<sign>\*\*|[-+*/^(),])|(?P<space>[ \t\r\n]+)"
)
_SIGNS = {
    "=": "an expression is one side of an equation",
    **dict.fromkeys("<>!", "nothing is compared here"),
    **dict.fromkeys("[]", "nothing has an index"),
    **dict.fromkeys("'\"", "texts are no numbers"),
    "#": "there are no comments inside",
    ".": "nothing has parts",
    "%": "write shares as 0.05",
    **dict.fromkeys("×·⋅∙∗", "write *"),
    **dict.fromkeys("÷∕⁄", "write /"),
    **dict.fromkeys("−–—‐‑", "write -"),
    "²": "write ^2",
    "³": "write ^3",
    "π": "write pi",
}
"""What is not taken, and why, or what to write instead."""


@dataclass(frozen=True)
class Expression:
    """An expression that is well formed.

    Attributes:
        text: as it is written.
        tree: what it is made of.
    """

    text: str
    tree: Node

    @cached_property
    def names(self) -> dict[str, int]:
        """The names in it, in their order, and where each is used first."""
        used = dict[str, int]()
        for node in self.tree.walk():
            if isinstance(node, Name):
                used.setdefault(node.name, node.offset)
        return used

    @property
    def constant(self) -> float | None:
        """The number that it is; None if there are names in it."""
        return self.tree.constant

    def casadi(self, values: Mapping[str, Any]) -> Any:
        """Its value for those of its names, which are SX, MX, DM or numbers; DM if there are none in it.

        Raises:
            ExpressionError: a name without a value.
        """
        return self.tree.casadi(values)

    def dimension(self, dimensions: Mapping[str, Dimension]) -> Dimension | None:
        """Its dimension for those of its names; None for a bare 0, which suits any.

        Raises:
            ExpressionError: an unknown name, or parts whose dimensions do not go together.
        """
        return self.tree.dimension(dimensions)

    def require(self, expected: Dimension, dimensions: Mapping[str, Dimension]) -> None:
        """Check that it has a dimension.

        Raises:
            ExpressionError: it has not, or has none.
        """
        own = self.dimension(dimensions)
        if own is not None and not own.fits(expected):
            wanted = expected.text or expected.words
            raise ExpressionError(f"{self.tree.text} is {own.words}, expected {wanted}", self.tree.offset)


def parse(text: str) -> Expression:
    """The expression that a text is.

    Raises:
        ExpressionError: it is none, is too long or too deep, or a number in it is not finite.
    """
    if len(text) > LONGEST:
        raise ExpressionError(f"expected at most {LONGEST} characters, got {len(text)}", LONGEST)
    return Expression(text, _Reader(text).whole())


def name_issue(text: str) -> str:
    """Why a quantity cannot have a name in expressions; "" if it can."""
    if re.fullmatch(_NAME, text) is None:
        return (
            f"{written(text)} is no name: expected letters A to Z, digits and _, not beginning with a digit"
        )
    return f"{text!r} is a function or a constant already" if text in RESERVED else ""


class _Token(NamedTuple):
    """A piece of text; kind is "number", "name", "sign" or "end"."""

    kind: str
    text: str
    offset: int

    @property
    def end(self) -> int:
        return self.offset + len(self.text)

    @property
    def shown(self) -> str:
        return written(self.text, 30) if self.text else "the end"


def _tokens(text: str) -> list[_Token]:
    found, offset = [], 0
    while offset < len(text):
        match = _TOKEN.match(text, offset)
        if match is None:
            raise ExpressionError(_foreign(text[offset]), offset)
        if match.lastgroup != "space":
            found.append(_Token(str(match.lastgroup), match.group(), offset))
        offset = match.end()
    return [*found, _Token("end", "", found[-1].end if found else 0)]


def _foreign(char: str) -> str:
    if char.isascii() or char in _SIGNS:
        return f"{char!r} has no meaning here{f'; {_SIGNS[char]}' if char in _SIGNS else ''}"
    # Letters of other alphabets look like those of this one.
    name = unicodedata.name(char, "a character without a name")
    return f"{char!a} ({name}) has no meaning here; names are of letters A to Z, digits and _"


class _Reader:
    """Reads tokens from the left, one method for each rule of the grammar."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.tokens = _tokens(text)
        self.place = 0
        self.depth = 0

    @property
    def next(self) -> _Token:
        return self.tokens[self.place]

    def take(self) -> _Token:
        self.place += 1
        return self.tokens[self.place - 1]

    def span(self, start: int) -> tuple[str, int, int]:
        # What a node says of its text, which ends with the last token.
        return self.text, start, self.tokens[self.place - 1].end

    def whole(self) -> Node:
        node = self.sum()
        if self.next.kind != "end":
            raise self.surplus()
        return node

    def sum(self) -> Node:
        return self.chain(("+", "-"), self.product, Sum)

    def product(self) -> Node:
        return self.chain(("*", "/"), self.signed, Product)

    def chain(self, signs: tuple[str, str], operand: Callable[[], Node], kind: type[Sum | Product]) -> Node:
        """Operands with signs of one strength between them.

        Args:
            signs: that go on; the first operand has the first of them.
            operand: reads one.
            kind: what they make.
        """
        start, before, nodes = self.next.offset, [signs[0]], [operand()]
        while self.next.text in signs:
            before.append(self.take().text)
            nodes.append(operand())
        return finite(kind(*self.span(start), tuple(nodes), tuple(before))) if len(nodes) > 1 else nodes[0]

    def signed(self) -> Node:
        # All that is nested passes here.
        self.depth += 1
        if self.depth > DEEPEST:
            raise ExpressionError(f"nested more than {DEEPEST} deep", self.next.offset)
        start, sign = self.next.offset, self.next.text
        if sign in ("+", "-"):
            self.take()
        node = self.signed() if sign in ("+", "-") else self.power()
        self.depth -= 1
        return Negative(*self.span(start), node) if sign == "-" else node

    def power(self) -> Node:
        start, base = self.next.offset, self.primary()
        if self.next.text not in ("^", "**"):
            return base
        self.take()
        exponent = self.signed()
        return finite(Power(*self.span(start), base, exponent))

    def primary(self) -> Node:
        token = self.take()
        if token.kind == "number":
            return self.number(token)
        if token.kind == "name":
            return self.call(token) if self.next.text == "(" else self.name(token)
        if token.text != "(":
            self.place -= 1
            raise ExpressionError(f"expected a number, a name or '(', got {token.shown}", token.offset)
        node = self.sum()
        self.close(token)
        return node

    def number(self, token: _Token) -> Node:
        value = float(token.text)
        if not value and re.search("[1-9]", re.split("[eE]", token.text)[0]):
            raise ExpressionError(f"{token.text} is too small a number", token.offset)
        return finite(Number(*self.span(token.offset), value))

    def name(self, token: _Token) -> Node:
        if token.text in FUNCTIONS:
            raise ExpressionError(f"{token.text} is a function: expected '(' after it", token.end)
        if token.text in CONSTANTS:
            return Number(*self.span(token.offset), CONSTANTS[token.text])
        return Name(*self.span(token.offset), token.text)

    def call(self, token: _Token) -> Node:
        if token.text not in FUNCTIONS:
            raise ExpressionError(_no_function(token.text), token.offset)
        opening = self.take()
        arguments = [self.sum()] if self.next.text != ")" else []
        while arguments and self.next.text == ",":
            self.take()
            arguments.append(self.sum())
        self.close(opening)
        function = FUNCTIONS[token.text]
        if not function.least <= len(arguments) <= function.most:
            message = f"{token.text} takes {function.count}, got {len(arguments)}"
            raise ExpressionError(message, token.offset)
        return finite(Call(*self.span(token.offset), token.text, tuple(arguments)))

    def close(self, opening: _Token) -> None:
        if self.next.kind == "end":
            raise ExpressionError("'(' is never closed", opening.offset)
        if self.next.text != ")":
            raise self.surplus()
        self.take()

    def surplus(self) -> ExpressionError:
        # What follows something whole, and is no sign that goes on.
        token, before = self.next, self.tokens[self.place - 1]
        if token.text == ")":
            return ExpressionError("')' closes nothing", token.offset)
        if token.text == ",":
            return ExpressionError("',' has no meaning here; decimals need a point", token.offset)
        hint = f"; products are written {before.text}*{token.text}" if len(token.text) < 20 else ""
        return ExpressionError(
            f"expected a sign between {before.shown} and {token.shown}{hint}", token.offset
        )


def _no_function(name: str) -> str:
    instead = OTHER_NAMES.get(name.lower())
    hint = f"; did you mean {instead}?" if instead else did_you_mean(name, FUNCTIONS)
    return f"{written(name)} is no function{hint or f'; products are written {name[:20]}*(...)'}"
