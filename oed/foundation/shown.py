"""Text from files as a terminal may have it: what would steer the terminal is shown, not obeyed."""

from __future__ import annotations

import unicodedata

STEERING = frozenset(("Cc", "Cf", "Cs", "Zl", "Zp"))
"""Unicode categories of control characters, of what turns the direction of writing, and of line ends."""


class _Escapes(dict[int, str]):
    """Each character by its number: as it is, or as Python would write it."""

    def __missing__(self, number: int) -> str:
        char = chr(number)
        steers = unicodedata.category(char) in STEERING
        self[number] = char.encode("ascii", "backslashreplace").decode() if steers else char
        if steers and number < 128:
            self[number] = repr(char)[1:-1]
        return self[number]


_ESCAPES = _Escapes()


def shown(text: str) -> str:
    """Text on one line, in which escape sequences, line ends and the like are written out: `\\x1b[2J`."""
    return text if text.isascii() and text.isprintable() else text.translate(_ESCAPES)


def shown_lines(text: str) -> str:
    """Text of several lines, in which escape sequences and the like are written out."""
    return "\n".join(map(shown, text.split("\n")))


def page_text(text: str) -> str:
    """A page's text, in which escape sequences and the like are written out, but tabs stay."""
    return "\t".join(map(shown_lines, text.split("\t")))


def written(value: object, most: int = 60) -> str:
    """A value as messages show it, cut after `most` characters."""
    try:
        text = repr(value)
    except ValueError:
        # Python writes no whole numbers of thousands of digits.
        text = "a number of thousands of digits"
    return text if len(text) <= most else f"{text[: most - 3]}..."
