"""Ctrl-C inside compiled solvers, which swallow the exception that Python raises for it."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from types import FrameType
from typing import Any

from oed.signals import answered

STDERR = 2
"""File descriptor of standard error."""


@contextmanager
def interrupts_kept() -> Iterator[None]:
    """Raise KeyboardInterrupt at the end of the context if one was signalled, and lost, inside it."""
    signalled = False
    # An ignored signal (a worker's) is not ours to answer.
    previous = answered()

    def noting(answer: Callable[[int, FrameType | None], Any]) -> Callable[[int, FrameType | None], None]:
        def note(number: int, frame: FrameType | None) -> None:
            nonlocal signalled
            signalled = True
            quiet.enter_context(_silenced())
            answer(number, frame)

        return note

    with ExitStack() as quiet:
        for number, answer in previous.items():
            signal.signal(number, noting(answer))
        try:
            yield
        finally:
            for number, answer in previous.items():
                signal.signal(number, answer)
    if signalled:
        raise KeyboardInterrupt


@contextmanager
def _silenced() -> Iterator[None]:
    # CasADi writes of the exception to standard error, past Python's own.
    try:
        kept = os.dup(STDERR)
    except OSError:
        yield
        return
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, STDERR)
    os.close(nowhere)
    try:
        yield
    finally:
        os.dup2(kept, STDERR)
        os.close(kept)


@contextmanager
def interrupts_named() -> Iterator[None]:
    """Raise KeyboardInterrupt for what CasADi's wrappers make of it in the middle of a call."""
    try:
        yield
    except SystemError as error:
        if not isinstance(error.__cause__ or error.__context__, KeyboardInterrupt):
            raise
        raise KeyboardInterrupt from None
