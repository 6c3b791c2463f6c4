"""Ctrl-C inside compiled solvers, which swallow the exception that Python raises for it."""

from __future__ import annotations

import io
import signal
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, redirect_stderr
from types import FrameType
from typing import Any

from oed.foundation.work.signals import Ending, answered


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
            # CasADi says of the exception what it is called, and in which line of its own it met it.
            quiet.enter_context(redirect_stderr(io.StringIO()))
            # A solver ends by the exception, whatever its wrapper then makes of it.
            at_once = answer.at_once if isinstance(answer, Ending) else answer
            at_once(number, frame)

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
