"""What a command is, and what its exit codes mean."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar, cast

from oed.cli.terminal.messages import say

if TYPE_CHECKING:
    from oed.foundation.errors import Failure, OedError
    from oed.records.record import Record

Found = TypeVar("Found")

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


def saved(work: Callable[[], Found]) -> tuple[Found, Failure | None]:
    """What work has found; where it could not be saved, found all the same, and the error."""
    from oed.workflow.saving import NotSaved

    try:
        return work(), None
    except NotSaved as error:
        return cast("Found", error.found), error


def reported(work: Callable[[], Path], folder: str | Path) -> tuple[Path | None, OedError | None]:
    """The page that work writes of what is saved in a folder; None, and the error, where it cannot.

    The error says that the record is saved, and how the report is made.

    Raises:
        Failure: interrupted; says the same.
    """
    from oed.foundation.errors import Failure, OedError

    later = f"the record is saved: `oed report {folder}` makes the report"
    try:
        return work(), None
    except KeyboardInterrupt:
        raise Failure(f"interrupted; {later}") from None
    except (OedError, OSError) as error:
        return None, Failure(f"{error}; {later}")


def cut_short(folder: Path | None, out: Path | None) -> str:
    """Where an interrupted run into `out` is kept, in a line."""
    from oed.foundation.work.folders import kept_in

    if out is None:
        return "interrupted: this is what had been done by then"
    kept = "nothing had been found by then" if folder is None else kept_in(folder)
    untouched = f"; {out} is as it was" if folder != out else ""
    return f"interrupted: {kept}{untouched}"


def place(folder: Path | None, trouble: Exception | None) -> dict[str, str | None]:
    """Where results are saved, and what is wrong with that, for JSON."""
    directory = {"directory": None if folder is None else str(folder)}
    return directory if trouble is None else {**directory, "error": str(trouble)}


def noted(notes: Sequence[str], trouble: Exception | None) -> None:
    """Say on standard error what is to be known of a run."""
    from oed.foundation.shown import shown
    from oed.workflow.runner import CUT_SHORT

    for note in notes:
        if note != CUT_SHORT:
            say(shown(f"note: {note}"))
    if trouble is not None:
        say(str(trouble))


def verdict(record: Record) -> int:
    """The exit code of a search for drives."""
    # Searches fail one by one; a design anywhere is a design. An interrupted run is not a finished one.
    searched = [one for one in record.results if one.kind not in ("baseline", "path")]
    found = any(one.feasible for one in searched or record.results)
    return DONE if found and not record.interrupted else FAILED
