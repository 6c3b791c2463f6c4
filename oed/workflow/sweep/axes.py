"""What a sweep varies: a key of the study and its values, read from `KEY=V1,V2,... [UNIT]`."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from oed.foundation.errors import StudyError, UserMistake
from oed.study.yaml_source import parse_yaml

_QUANTITY = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(\D.*)?")
"""A number, and its unit if it has one."""
FORM = "expected KEY=V1,V2,... [UNIT], e.g. 'limits.wheel_speed=5,10,20 rad/s'"
"""What is expected of a key and its values."""


@dataclass(frozen=True)
class Axis:
    """A key and the values that it takes.

    Attributes:
        key: where in the study, dotted; lists by index from 0 ("solvers.0.starts").
        texts: of the values, each with its unit.
        numbers: the values in `unit`; None where they are no numbers of one unit.
        unit: as it was given; "" for plain numbers and for words.
        studies: what the study's keys are at each value, where more changes with it than that key alone.
    """

    key: str
    texts: tuple[str, ...]
    numbers: tuple[float, ...] | None
    unit: str
    studies: tuple[Mapping[str, Any], ...] = ()

    @property
    def path(self) -> tuple[str | int, ...]:
        """The key's parts."""
        return tuple(int(part) if part.isdecimal() else part for part in self.key.split("."))

    @property
    def values(self) -> tuple[Any, ...]:
        """The values as YAML reads them."""
        return tuple(parse_yaml(text, self.key).data for text in self.texts)


def parse_axis(text: str) -> Axis:
    """What `KEY=V1,V2,... [UNIT]` asks for: a unit after the last number is that of all.

    Raises:
        UserMistake: not of this form, a value that is no YAML, one given twice, or units on some only.
    """
    key, equals, given = text.partition("=")
    key, texts = key.strip(), [part.strip() for part in _parts(given)]
    if not equals or not key or not all(key.split(".")) or not all(texts):
        raise UserMistake(f"--over {text!r}: {FORM}")
    matches = [_QUANTITY.fullmatch(part) for part in texts]
    units = [(match[2] or "").strip() for match in matches if match is not None]
    last = units[-1] if matches[-1] is not None else ""
    if last and not all(units) and any(units[:-1]):
        raise UserMistake(f"--over {text!r}: give every value its unit, or one unit after the last value")
    if last:
        # What is no number keeps to itself: `null,5 rad/s`.
        texts = [
            f"{part} {last}" if match is not None and not match[2] else part
            for part, match in zip(texts, matches, strict=True)
        ]
        units = [unit or last for unit in units]
    _require_values(text, texts)
    same = len(units) == len(texts) and len(set(units)) == 1
    numbers = tuple(float(match[1]) for match in matches if match is not None) if same else None
    return Axis(key, tuple(texts), numbers, units[0] if same else "")


def _require_values(given: str, texts: list[str]) -> None:
    for text in texts:
        try:
            parse_yaml(text, given)
        except StudyError:
            raise UserMistake(f"--over {given!r}: {text!r} is not a value as a study has them") from None
    twice = [text for index, text in enumerate(texts) if text in texts[:index]]
    if twice:
        raise UserMistake(f"--over {given!r}: {twice[0]} is given twice")


def _parts(text: str) -> Iterator[str]:
    # Split at commas, but those in brackets and quotes.
    depth, quote, part = 0, "", ""
    for letter in text:
        if quote:
            quote = "" if letter == quote else quote
        elif letter in "'\"":
            quote = letter
        else:
            depth += (letter in "[{(") - (letter in "]})")
            if letter == "," and depth <= 0:
                yield part
                part = ""
                continue
        part += letter
    yield part
