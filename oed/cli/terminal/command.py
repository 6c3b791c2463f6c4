"""What a command is, and what its exit codes mean."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

from oed.cli.terminal.messages import print_json, say, tell
from oed.foundation.shown import shown

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


@dataclass
class CommandResult:
    """Where a command has saved what it found, and what is wrong with that.

    Attributes:
        folder: where it is saved; None where it is not.
        out: where it was to be saved; None for nowhere.
        trouble: why it could not be saved, or the page of it not be written.
        interrupted: whether the work was cut short.
        hint: what else to say then.
        page: the page of what is saved; None without one.
    """

    folder: Path | None
    out: Path | None
    trouble: OedError | None
    interrupted: bool = False
    hint: str = ""
    page: Path | None = None

    @property
    def place(self) -> dict[str, str | None]:
        """Where, and what is wrong, for JSON."""
        directory = {"directory": None if self.folder is None else str(self.folder)}
        return directory if self.trouble is None else {**directory, "error": str(self.trouble)}

    def report(self, write: Callable[[], Path]) -> None:
        """Have the page written of what is saved.

        Raises:
            Failure: interrupted; says that the record is saved, and how the report is made.
        """
        from oed.foundation.errors import Failure, OedError

        # Whoever interrupts waits for nothing that can be made later.
        if self.folder is None or self.interrupted:
            return
        command = shlex.join(["oed", "report", str(self.out)])
        later = f"the record is saved: `{command}` makes the report"
        try:
            self.page = write()
        except KeyboardInterrupt:
            raise Failure(f"interrupted; {later}") from None
        except (OedError, OSError) as error:
            self.trouble = Failure(f"{error}; {later}")
        # A defect of the report must not cost the answer, which is printed next.
        except Exception as error:
            self.trouble = Failure(f"the report failed ({type(error).__name__}: {error}); {later}")

    def show(
        self,
        options: argparse.Namespace,
        data: Mapping[str, Any],
        lines: Callable[[], None],
        notes: Iterable[str] = (),
        further: Iterable[str] = (),
    ) -> None:
        """Print what was found and, on standard error, what is to be known of it.

        Args:
            options: of the command, `json` among them.
            data: what was found, for JSON.
            lines: prints it for readers.
            notes: on it.
            further: what to do next, where all is saved.
        """
        if options.json:
            print_json(data)
        else:
            lines()
            if self.page is not None:
                tell(f"Page:  {self.page}")
                for line in further:
                    tell(shown(line))
        for note in notes:
            say(shown(f"note: {note}"))
        if self.trouble is not None:
            say(str(self.trouble))
        elif self.interrupted:
            say(f"interrupted: {self._kept}{self.hint}")

    @property
    def _kept(self) -> str:
        # What had been done by then, in words.
        from oed.foundation.work.folders import kept_in

        if self.out is None:
            return "this is what had been done by then"
        kept = "nothing had been found by then" if self.folder is None else kept_in(self.folder)
        return kept if self.folder == self.out else f"{kept}; {self.out} is as it was"


def answered(options: argparse.Namespace, data: Any, lines: Callable[[], object]) -> int:
    """Print what was done, as JSON or for readers; returns the exit code.

    Args:
        options: of the command, `json` among them.
        data: what was done, for JSON.
        lines: prints it for readers.
    """
    if options.json:
        print_json(data)
    else:
        lines()
    return DONE


def verdict(record: Record) -> int:
    """The exit code of a search for drives."""
    # Searches fail one by one; a design anywhere is a design. A run that was interrupted, or one of whose
    # later steps failed, is not a finished one.
    searched = [one for one in record.results if one.kind not in ("baseline", "path")]
    found = any(one.feasible for one in searched or record.results)
    return DONE if found and not (record.interrupted or record.failures) else FAILED
