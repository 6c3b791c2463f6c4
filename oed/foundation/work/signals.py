"""Signals that end the program: answered alike, held back for a moment, and what workers make of them."""

from __future__ import annotations

import ctypes
import math
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import FrameType
from typing import Any

from oed.foundation.errors import OedError
from oed.foundation.work.start import ENDING, Leaving

WATCH = 0.5
"""Time [s] between looks at whether the parent is still there, where the system does not say."""
WRAPPERS = "casadi.casadi"
"""Module of CasADi's wrappers."""
GRACE = 2.0
"""Time [s] after an interrupt in which what is done is kept: signals that repeat it do nothing."""
SOON = 1e-3
"""Time [s] after which a signal that would have been lost is answered again."""
Answer = Callable[[int, FrameType | None], Any]
"""To a signal, in the frame where it came."""
PARENT_DIED = 1
"""Of Linux's `prctl`: the signal that a process gets when its parent ends."""


def _in_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()


@contextmanager
def ending_alike(numbers: Sequence[int] = ENDING) -> Iterator[Ending]:
    """Answer every signal that ends a program as Ctrl-C is answered, while the context lasts.

    Args:
        numbers: of the signals.
    """
    ending = Ending()
    if not _in_main_thread():
        yield ending
        return
    # What is ignored (by `nohup`, say) stays so, and a handler of somebody else's stays in place.
    with (
        _handled({number: ending for number in numbers if _is_default(signal.getsignal(number))}),
        _unraisable_raised(ending),
    ):
        try:
            yield ending
        finally:
            ending.forget()


def _is_default(handler: Any) -> bool:
    return handler in (signal.SIG_DFL, signal.default_int_handler) or isinstance(handler, Leaving)


@contextmanager
def _unraisable_raised(ending: Ending) -> Iterator[None]:
    # Python prints an interrupt of a finaliser or a callback of its own, and goes on.
    before = sys.unraisablehook

    def hook(unraisable: sys.UnraisableHookArgs) -> None:
        if issubclass(unraisable.exc_type, KeyboardInterrupt):
            ending.hear_unraisable()
        else:
            before(unraisable)

    sys.unraisablehook = hook
    try:
        yield
    finally:
        sys.unraisablehook = before


@contextmanager
def interrupts_answered() -> Iterator[None]:
    """Answer Ctrl-C where CasADi's wrappers do not lose it, while the context lasts, or at its end."""
    with ending_alike([signal.SIGINT]) as ending:
        yield
        if ending.waits:
            raise KeyboardInterrupt


@contextmanager
def _handled(handlers: Mapping[int, Answer]) -> Iterator[None]:
    # Answer signals by other handlers while the context lasts.
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class Ending:
    """The answer to a signal: KeyboardInterrupt, raised where it is not lost.

    What CasADi's wrappers call while they look at their arguments may raise what it likes: they try another
    way. There the signal waits until the program is out of them. Signals that repeat it within `GRACE` do
    nothing, and none does when the command is over.

    Attributes:
        over: whether the command is over, and only its exit code is left.
    """

    def __init__(self) -> None:
        """Begin without a signal."""
        self.over = False
        self._waiting: threading.Timer | None = None
        self._raised = -math.inf

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Raise it, or see again very soon."""
        if _is_lost(frame):
            self.come_again(number)
        else:
            self.at_once(number, frame)

    def come_again(self, number: int) -> None:
        """Send a signal that could not be answered again very soon, as if it had not come before."""
        self.forget()
        self._raised = -math.inf
        self._waiting = threading.Timer(SOON, _send, [number])
        self._waiting.daemon = True
        self._waiting.start()

    def hear_unraisable(self) -> None:
        """Send an interrupt again that Python could not raise; it waits on if it comes before this ends."""
        self.come_again(signal.SIGINT)

    @property
    def waits(self) -> bool:
        """Whether a signal waits."""
        return self._waiting is not None and self._waiting.is_alive()

    def forget(self) -> None:
        """Let no signal wait any longer."""
        if self._waiting is not None:
            self._waiting.cancel()

    def at_once(self, number: int, frame: FrameType | None) -> None:
        """Raise it: for solvers, which end by it."""
        now = time.monotonic()
        if self.over or now < self._raised + GRACE:
            return
        self._raised = now
        raise KeyboardInterrupt


class _Noting:
    # An answer that is noted before it is given.

    def __init__(self, answer: Answer, noted: list[int]) -> None:
        self._answer, self._noted = answer, noted

    def __call__(self, number: int, frame: FrameType | None) -> None:
        self._noted.append(number)
        self._answer(number, frame)

    def at_once(self, number: int, frame: FrameType | None) -> None:
        self._noted.append(number)
        immediate(self._answer)(number, frame)


def immediate(answer: Answer) -> Answer:
    """What a handler does where nothing is lost: it does not wait, nor comes again later."""
    found: Answer = getattr(answer, "at_once", answer)
    return found


def _send(number: int) -> None:
    # To the thread that answers signals: it may be asleep.
    if hasattr(signal, "pthread_kill"):
        signal.pthread_kill(threading.main_thread().ident or 0, number)
    else:
        signal.raise_signal(number)


def _is_lost(frame: FrameType | None) -> bool:
    # Whether what a handler raises in a frame is caught by CasADi's wrappers, or printed by Python.
    while frame is not None:
        if frame.f_globals.get("__name__") == WRAPPERS or frame.f_code is Ending.hear_unraisable.__code__:
            return True
        frame = frame.f_back
    return False


@contextmanager
def noted() -> Iterator[list[int]]:
    """Only note the signals that something in this process answers, while the context lasts."""
    caught: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        caught.append(number)

    with _handled(dict.fromkeys(answered(), note)):
        yield caught


def answered() -> dict[int, Any]:
    """The handlers, by signal, of those that this thread answers in Python."""
    if not _in_main_thread():
        return {}
    handlers = {number: signal.getsignal(number) for number in ENDING}
    return {number: handler for number, handler in handlers.items() if callable(handler)}


@contextmanager
def interrupts_named() -> Iterator[None]:
    """Raise KeyboardInterrupt for whatever compiled wrappers make of one that is signalled in the context.

    They take it for an argument that does not fit, and complain of that, or for an error of the system.
    """
    signalled: list[int] = []
    try:
        with _handled({number: _Noting(answer, signalled) for number, answer in answered().items()}):
            yield
    except (OedError, OSError):
        raise
    except Exception as error:
        if not (signalled or _tells_of_interrupt(error)):
            raise
        raise _interrupt(error) from None


def _tells_of_interrupt(error: Exception) -> bool:
    cause = error.__cause__ or error.__context__
    return isinstance(error, SystemError) and isinstance(cause, KeyboardInterrupt)


def _interrupt(error: Exception) -> KeyboardInterrupt:
    # With what has been said of what was done by then.
    interrupt = KeyboardInterrupt()
    for note in getattr(error, "__notes__", ()):
        interrupt.add_note(note)
    return interrupt


@contextmanager
def undisturbed() -> Iterator[None]:
    """Let signals that end the program wait for the end of the context."""
    with noted() as caught:
        yield
    if caught:
        signal.raise_signal(caught[0])


@contextmanager
def interrupts_blocked() -> Iterator[None]:
    """Start processes that never hear Ctrl-C: a terminal sends it to them too, and only their parent answers.

    In this process it waits for the end of the context, whichever of its threads the system gives it to.
    """
    with undisturbed():
        if sys.platform == "win32":
            yield
            return
        from multiprocessing import resource_tracker

        # It lets Ctrl-C through again when it is started, which is with the first process otherwise.
        resource_tracker.ensure_running()
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


def end_with(parent: int) -> None:
    """End this process, whatever it is doing, when its parent has ended, however that ended."""
    if sys.platform == "linux":
        # A thread that watches would have to wait for compiled code that does not let go of Python.
        ctypes.CDLL(None).prctl(PARENT_DIED, signal.SIGKILL)
    else:
        threading.Thread(target=_watch, args=(parent,), daemon=True).start()
    if os.getppid() != parent:
        os._exit(1)


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(WATCH)
    os._exit(1)
