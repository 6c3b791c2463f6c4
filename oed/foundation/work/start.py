"""Beginning and end of the process of the command `oed`: Ctrl-C shows no traceback at either.

The first line of `oed` loads this module, before anything that takes time.
"""

from __future__ import annotations

import atexit
import os
import signal
import sys
from contextlib import suppress
from types import FrameType

ENDING = [
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK") if hasattr(signal, name)
]
"""Ctrl-C, a polite request to end, and a terminal that is closed."""
INTERRUPTED = 1
"""Exit code of a command that a signal ended before it was done."""


class Leaving:
    """Answer to signals before a command runs and after it: the process ends at once.

    Attributes:
        code: exit code of the command; None until it is done.
    """

    def __init__(self) -> None:
        """Begin without an exit code."""
        self.code: int | None = None

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Leave with the exit code, or say that the command was interrupted."""
        if self.code is None:
            with suppress(OSError):
                os.write(2, b"interrupted\n")
        os._exit(INTERRUPTED if self.code is None else self.code)


LEAVING: Leaving | None = None
"""Answer of this process, if it is that of the command."""


def is_command() -> bool:
    """Return whether the program of this process is `oed` or `python -m oed`, and no worker of it."""
    # Python calls a module that it is still looking for "-m". A worker has its parent's name, but not by its
    # own command line.
    program = sys.argv[0] if getattr(sys, "argv", None) else ""
    return program == "-m" or (program in sys.orig_argv and os.path.basename(program) in ("oed", "oed.exe"))


def begin() -> None:
    """Answer signals that end a program by leaving, if this process is that of the command."""
    global LEAVING
    if not is_command():
        return
    LEAVING = Leaving()
    # An ignored signal (by `nohup`, say) stays ignored.
    for number in ENDING:
        if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
            signal.signal(number, LEAVING)
    # Functions registered first run last: from there on Python would answer by the system's default.
    atexit.register(_ignore)


def _ignore() -> None:
    for number in ENDING:
        if signal.getsignal(number) is LEAVING:
            signal.signal(number, signal.SIG_IGN)


def done(code: int) -> None:
    """Have signals from here on end the process with the command's exit code."""
    if LEAVING is not None:
        LEAVING.code = code
