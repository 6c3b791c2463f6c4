"""Ctrl-C inside compiled solvers, which swallow the exception that Python raises for it."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def interrupts_kept() -> Iterator[None]:
    """Raise KeyboardInterrupt at the end of the context if one was signalled, and lost, inside it."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    signalled = False
    previous = signal.getsignal(signal.SIGINT)

    def note(number: int, frame: FrameType | None) -> None:
        nonlocal signalled
        signalled = True
        if callable(previous):
            previous(number, frame)

    signal.signal(signal.SIGINT, note)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, previous)
    # An ignored signal (a worker's) is not ours to answer.
    if signalled and previous is not signal.SIG_IGN:
        raise KeyboardInterrupt
