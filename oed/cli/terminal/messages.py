"""Plain output, on standard streams that may be closed, full or read by nobody: it ends no work halfway.

What every command needs, and nothing heavy to load for it (tables and bars: console).
"""

from __future__ import annotations

import json
import os
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from typing import Any, TextIO, cast

from oed.foundation.errors import Failure
from oed.foundation.shown import shown, shown_lines

MODES = {"stdin": "r", "stdout": "w", "stderr": "w"}
"""Modes of the standard streams, by name in the order of their numbers."""


def print_json(data: Mapping[str, Any]) -> None:
    """One JSON object on standard output."""
    sys.stdout.write(json.dumps(data, indent=1, allow_nan=False) + "\n")


def tell(*lines: str) -> None:
    """Lines on standard output."""
    sys.stdout.write("".join(f"{shown_lines(text)}\n" for text in lines))


def say(text: str) -> None:
    """A line on standard error."""
    sys.stderr.write(f"{shown_lines(text)}\n")


def ask(question: str) -> str | None:
    """The line that answers a question, which goes to standard error: standard output stays what a command
    prints. None at the end of the input.
    """
    sys.stderr.write(f"{shown(question)}: ")
    sys.stderr.flush()
    given = sys.stdin.readline()
    return given.strip() if given else None


class _Steady:
    """A stream that outlives its reader: what nobody reads any more goes nowhere.

    Nor does it end with those who close it, for it is not theirs.
    """

    def __init__(self, stream: TextIO, *, needed: bool) -> None:
        """Keep a stream; where it is `needed`, a full one is a failure, if somebody still reads."""
        self._stream, self._needed = stream, needed

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Write a text; returns its length."""
        self._try(lambda: self._stream.write(text))
        return len(text)

    def flush(self) -> None:
        """Write what waits."""
        self._try(self._stream.flush)

    def close(self) -> None:
        """Write what waits, too."""
        self.flush()

    def _try(self, act: Callable[[], object]) -> None:
        try:
            act()
        except OSError as error:
            # What still waits in the stream would fail again when the program ends.
            _lead_nowhere(self._stream)
            if self._needed and not isinstance(error, BrokenPipeError):
                text = f"standard output cannot be written: {error.strerror or error}"
                raise Failure(text) from None


def _lead_nowhere(stream: TextIO) -> None:
    with suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)


@contextmanager
def steady_streams() -> Iterator[None]:
    """Have all three standard streams while the context lasts, whoever has closed them or stops reading."""
    before = {name: getattr(sys, name) for name in MODES}
    with ExitStack() as opened:
        for name, mode in MODES.items():
            if before[name] is None:
                setattr(sys, name, opened.enter_context(_nowhere(mode)))
        sys.stdout = cast("TextIO", _Steady(sys.stdout, needed=True))
        sys.stderr = cast("TextIO", _Steady(sys.stderr, needed=False))
        try:
            yield
        finally:
            sys.stderr.flush()
            for name, stream in before.items():
                setattr(sys, name, stream)


def _nowhere(mode: str) -> TextIO:
    # It has the number of the closed stream, which some other file would have otherwise: here and in workers.
    stream = cast("TextIO", open(os.devnull, mode, encoding="utf-8"))  # noqa: SIM115 - closed by the caller
    os.set_inheritable(stream.fileno(), True)
    return stream


@contextmanager
def warnings_shown() -> Iterator[None]:
    """Let what libraries warn of take a line, and not steer the terminal, while the context lasts."""

    def show(message: Warning | str, category: type[Warning], file: str, line: int, *_: object) -> None:
        say(shown(f"{file}:{line}: {category.__name__}: {message}"))

    with warnings.catch_warnings():
        warnings.showwarning = cast("Any", show)
        yield
