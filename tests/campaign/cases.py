"""Cases and what becomes of them."""

from __future__ import annotations

import re
from dataclasses import dataclass

SECONDS = 60.0
"""After which a case counts as hanging."""


@dataclass(frozen=True)
class Failure:
    """Something wrong: its kind, and a sentence."""

    kind: str
    text: str


@dataclass(frozen=True)
class Outcome:
    """What became of one case.

    Attributes:
        sort: "problem", "file" or "signal".
        index: of the case among its sort.
        failures: what is wrong, nothing if all is well.
        seconds: it took.
        peak: largest memory of its process [bytes].
    """

    sort: str
    index: int
    failures: tuple[Failure, ...]
    seconds: float = 0.0
    peak: int = 0


def quoted(text: str, most: int = 160) -> str:
    """A text on one line, cut short."""
    line = re.sub(r"\s+", " ", text.strip())
    return line if len(line) <= most else f"{line[: most - 1]}…"
