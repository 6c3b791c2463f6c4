"""What a command is, and what its exit codes mean."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from oed.record import Record

DONE, FAILED, MISTAKE = 0, 1, 2
"""Exit codes: done, failed (no feasible design, interrupted), the user's mistake."""


def _none(parser: argparse.ArgumentParser) -> None:
    del parser


@dataclass(frozen=True)
class Command:
    """A command of `oed`.

    Attributes:
        name: as it is typed.
        text: what it does, in a line.
        run: does it with the options given, `json` among them; returns the exit code.
        arguments: adds its options to its parser.
    """

    name: str
    text: str
    run: Callable[[argparse.Namespace], int]
    arguments: Callable[[argparse.ArgumentParser], None] = _none


@contextmanager
def saved_in(folder: str | Path) -> Iterator[None]:
    """Write the report of what is saved in a folder: where Ctrl-C comes meanwhile, that is not lost.

    Raises:
        Failure: interrupted; says how the report is made.
    """
    from oed.errors import Failure

    try:
        yield
    except KeyboardInterrupt:
        raise Failure(f"interrupted; the record is saved: `oed report {folder}` makes the report") from None


def verdict(record: Record) -> int:
    """The exit code of a search for drives."""
    # Searches fail one by one; a design anywhere is a design. An interrupted run is not a finished one.
    searched = [entry for entry in record.results if entry["kind"] not in ("baseline", "path")]
    found = any(entry["feasible"] for entry in searched or record.results)
    return DONE if found and not record.data["interrupted"] else FAILED
