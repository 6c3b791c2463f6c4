"""The text of an expression, read into a tree: a small grammar, of which nothing is ever run.

Numbers, names, + - * / ^ (or **), parentheses, the functions of `FUNCTIONS` and pi; spaces and line ends
between them. Signs bind as in Python: -x^2 is -(x^2), and x^y^z is x^(y^z).
"""

from __future__ import annotations

import math
import re
import unicodedata
from typing import NamedTuple

from oed.equations.dimensions import PLAIN
from oed.equations.functions import FUNCTIONS, MINUS, OTHER_NAMES
from oed.equations.tree import Expression, ExpressionError, Name, Number, Operation
from oed.foundation.shown import written
from oed.foundation.text import did_you_mean

__all__ = ["RESERVED", "Expression", "ExpressionError", "name_issue", "parse"]

LONGEST = 10_000
"""Largest number of characters of an expression."""
DEEPEST = 30
"""Largest number of parentheses, signs and powers inside each other."""
CONSTANTS = {"pi": math.pi}
RESERVED = frozenset((*FUNCTIONS, *CONSTANTS))
"""Names that no quantity may have."""

_NAME = r"[A-Za-z_][A-Za-z0-9_]*"
_TOKEN = re.compile(
    rf"(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)|(?P<name>{_NAME})"
    r"|(?P<sign>\*\*|[-+*/^(),])|(?P<space>[ \t\r\n]+)|(?P<foreign>(?s:.))"
)
_LEVELS = (("+", "-"), ("*", "/"))
"""Operators that are applied from the left, those that bind least first."""
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
"""Characters without a meaning, and the reason or the remedy."""


def parse(text: str) -> Expression:
    """Read an expression.

    Raises:
        ExpressionError: the text is none, is too long or too deep, or a number in it is not finite.
    """
    if len(text) > LONGEST:
        raise ExpressionError(f"expected at most {LONGEST} characters, got {len(text)}", LONGEST)
    reader = _Reader(text)
    expression = reader.chain()
    reader.close()
    return expression


def name_issue(text: str) -> str:
    """Return the reason why a quantity cannot have a name in expressions; "" if it can."""
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
    end: int

    @property
    def shown(self) -> str:
        return written(self.text, 30) if self.text else "the end"


def _tokens(text: str) -> list[_Token]:
    tokens = [
        _Token(str(match.lastgroup), match.group(), *match.span())
        for match in _TOKEN.finditer(text)
        if match.lastgroup != "space"
    ]
    for token in tokens:
        if token.kind == "foreign":
            raise ExpressionError(_foreign(token.text), token.offset)
    end = tokens[-1].end if tokens else 0
    return [*tokens, _Token("end", "", end, end)]


def _foreign(char: str) -> str:
    if char.isascii() or char in _SIGNS:
        return f"{char!r} has no meaning here{f'; {_SIGNS[char]}' if char in _SIGNS else ''}"
    # Letters of other alphabets look like those of this one.
    name = unicodedata.name(char, "a character without a name")
    return f"{char!a} ({name}) has no meaning here; names are of letters A to Z, digits and _"


class _Reader:
    """Recursive descent over the tokens, from the left."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.tokens = _tokens(text)
        self.place = self.depth = 0

    @property
    def next(self) -> _Token:
        return self.tokens[self.place]

    def take(self, *signs: str) -> str:
        """Take the next token if it is one of these signs; return it, else ""."""
        sign = self.next.text if self.next.text in signs else ""
        self.place += bool(sign)
        return sign

    def chain(self, level: int = 0) -> Expression:
        """Read operands with operators of a level, and of those that bind more, between them."""
        if level == len(_LEVELS):
            return self.signed()
        start, symbols, operands = self.next.offset, list[str](), [self.chain(level + 1)]
        while sign := self.take(*_LEVELS[level]):
            symbols.append(sign)
            operands.append(self.chain(level + 1))
        return self.operation(start, symbols, operands) if symbols else operands[0]

    def signed(self) -> Expression:
        """Read a power, or its negative. Whatever is nested passes here."""
        self.depth += 1
        start = self.next.offset
        if self.depth > DEEPEST:
            raise ExpressionError(f"nested more than {DEEPEST} deep", start)
        if sign := self.take("+", "-"):
            node = self.signed()
            node = self.operation(start, [MINUS], [node]) if sign == "-" else node
        else:
            node = self.primary()
            if self.take("^", "**"):
                node = self.operation(start, ["^"], [node, self.signed()])
        self.depth -= 1
        return node

    def primary(self) -> Expression:
        """Read a number, a name, a call or an expression in parentheses."""
        token = self.next
        if self.take("("):
            node = self.chain()
            self.close(token)
            return node
        if token.kind not in ("number", "name"):
            raise ExpressionError(f"expected a number, a name or '(', got {token.shown}", token.offset)
        self.place += 1
        if token.kind == "number":
            return _number(token)
        if self.next.text == "(":
            return self.call(token)
        if token.text in FUNCTIONS:
            raise ExpressionError(f"{token.text} is a function: expected '(' after it", token.end)
        if token.text in CONSTANTS:
            return Number(token.text, token.offset, CONSTANTS[token.text], PLAIN)
        return Name(token.text, token.offset)

    def call(self, token: _Token) -> Expression:
        """Read the arguments of a function."""
        function = FUNCTIONS.get(token.text)
        if function is None:
            raise ExpressionError(_no_function(token.text), token.offset)
        opening = self.next
        self.place += 1
        operands = [self.chain()] if self.next.text != ")" else []
        while operands and self.take(","):
            operands.append(self.chain())
        self.close(opening)
        count = len(operands)
        if not function.least <= count <= function.most:
            raise ExpressionError(f"{token.text} takes {function.arity}, got {count}", token.offset)
        return self.operation(token.offset, [token.text] * max(count - 1, 1), operands)

    def operation(self, start: int, symbols: list[str], operands: list[Expression]) -> Expression:
        """Make an operation that ends with the last token; a number where all its operands are numbers.

        Args:
            start: offset at which the text of the operation begins.
            symbols: function or operators.
            operands: parts that they are applied to.
        """
        text = self.text[start : self.tokens[self.place - 1].end]
        node = Operation(text, start, tuple(symbols), tuple(operands))
        if any(operand.constant is None for operand in operands):
            return node
        return Number(text, start, float(node.casadi({})), node.dimension({}))

    def close(self, opening: _Token | None = None) -> None:
        """Take the parenthesis that closes an opening one; the end of the text without one."""
        before, token = self.tokens[self.place - 1], self.next
        if token.text == (")" if opening else ""):
            self.place += 1
            return
        if opening and token.kind == "end":
            raise ExpressionError("'(' is never closed", opening.offset)
        hint = f"; products are written {before.text}*{token.text}" if len(token.text) < 20 else ""
        message = {
            ")": "')' closes nothing",
            ",": "',' has no meaning here; decimals need a point",
        }.get(token.text, f"expected a sign between {before.shown} and {token.shown}{hint}")
        raise ExpressionError(message, token.offset)


def _number(token: _Token) -> Number:
    value = float(token.text)
    if not value and re.search("[1-9]", re.split("[eE]", token.text)[0]):
        raise ExpressionError(f"{token.text} is too small a number", token.offset)
    return Number(token.text, token.offset, value, PLAIN if value else None)


def _no_function(name: str) -> str:
    instead = OTHER_NAMES.get(name.lower())
    hint = f"; did you mean {instead}?" if instead else did_you_mean(name, FUNCTIONS)
    return f"{written(name)} is no function{hint or f'; products are written {name[:20]}*(...)'}"
