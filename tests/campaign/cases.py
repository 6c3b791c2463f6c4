"""Cases, what is asked of each, and what becomes of it."""

from __future__ import annotations

import re
from dataclasses import dataclass

SECONDS = 60.0
"""After which a case counts as hanging."""
MEMORY = 2 * 2**30
"""Bytes that no case may need."""


@dataclass(frozen=True)
class Verdict:
    """One thing asked of a case: what, and a sentence about it where it does not hold."""

    asked: str
    wrong: str = ""


@dataclass(frozen=True)
class Outcome:
    """What became of one case.

    Attributes:
        sort: "problem", "file", "signal" or "experiment".
        index: of the case among its sort.
        verdicts: on everything that was asked of it.
        seconds: it took.
    """

    sort: str
    index: int
    verdicts: tuple[Verdict, ...]
    seconds: float = 0.0

    @property
    def failures(self) -> tuple[Verdict, ...]:
        """What does not hold."""
        return tuple(verdict for verdict in self.verdicts if verdict.wrong)


def quoted(text: str, most: int = 160) -> str:
    """A text on one line, cut short."""
    line = re.sub(r"\s+", " ", text.strip())
    return line if len(line) <= most else f"{line[: most - 1]}…"


def place_of(trace: str) -> str:
    """What a traceback ends with, and where in the package."""
    lines = trace.strip().splitlines()
    within = [line.strip() for line in lines if "/oed/" in line and line.strip().startswith("File")]
    where = within[-1].rsplit("/oed/", 1)[1].replace('"', "") if within else "beyond the package"
    return quoted(f"{lines[-1]} ({where})")
