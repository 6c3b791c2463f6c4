"""Contexts for calls of a compiled solver: Ctrl-C, which it swallows, and one thread of linear algebra."""

from __future__ import annotations

import ctypes
import io
import signal
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, redirect_stderr
from functools import cache
from pathlib import Path
from threading import Lock
from types import FrameType
from typing import Any

import casadi

from oed.foundation.work.signals import Answer, answered, immediate

Control = tuple[Callable[[], int], Callable[[int], Any]]


@contextmanager
def interrupts_kept() -> Iterator[None]:
    """Raise KeyboardInterrupt at the end of the context if one was signalled, and lost, inside it."""
    signalled = False
    # A signal that is ignored, as in a worker, stays ignored.
    previous = answered()

    def noting(answer: Answer) -> Answer:
        def note(number: int, frame: FrameType | None) -> None:
            nonlocal signalled
            signalled = True
            # CasADi prints the name of the exception and a line of its own source.
            quiet.enter_context(redirect_stderr(io.StringIO()))
            # The exception ends the solver, even where its wrapper swallows it.
            immediate(answer)(number, frame)

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
def one_thread() -> Iterator[None]:
    """Restrict the OpenBLAS of CasADi to one thread while the context lasts.

    The number of threads changes the last digits of a product of two small matrices, and with them the design
    on which the search of a flat problem ends. Every solve therefore uses one thread, in this process as in
    every worker; parallel work is done by processes.
    """
    control = _openblas()
    if control is None:
        yield
        return
    _single.enter(control)
    try:
        yield
    finally:
        _single.leave(control)


class _Single:
    # The number of threads is global: the first of all concurrent solves sets it, the last one restores it.

    def __init__(self) -> None:
        self._lock, self._solves, self._before = Lock(), 0, 0

    def enter(self, control: Control) -> None:
        get, put = control
        with self._lock:
            self._solves += 1
            if self._solves == 1:
                self._before = get()
                put(1)

    def leave(self, control: Control) -> None:
        with self._lock:
            self._solves -= 1
            if self._solves == 0:
                control[1](self._before)


_single = _Single()


@cache
def _openblas() -> Control | None:
    # Packages of CasADi bring an OpenBLAS under a name of their own; a build from source may not.
    # Ipopt links the file with a single version number; files of other names may be other copies.
    for file in sorted(Path(casadi.__file__).parent.glob("libcasadi*openblas*.so.[0-9]")):
        library = ctypes.CDLL(str(file))
        for suffix in ("", "64_"):
            get = getattr(library, f"openblas_get_num_threads{suffix}", None)
            put = getattr(library, f"openblas_set_num_threads{suffix}", None)
            if get is not None and put is not None:
                return get, put
    return None
