"""Ctrl-C inside compiled code is not lost."""

from __future__ import annotations

import contextlib
import signal
import threading

import pytest

from oed.solvers.interrupts import interrupts_kept

pytestmark = pytest.mark.usefixtures("interruptible")


def swallow_interrupt() -> None:
    """What a compiled solver does: the exception that the signal raises never comes out."""
    with contextlib.suppress(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)


def test_a_swallowed_interrupt_is_raised_at_the_end():
    before, reached = signal.getsignal(signal.SIGINT), []

    def work() -> None:
        with interrupts_kept():
            swallow_interrupt()
            reached.append(True)

    with pytest.raises(KeyboardInterrupt):
        work()
    assert reached == [True]
    assert signal.getsignal(signal.SIGINT) is before


def test_nothing_happens_without_an_interrupt():
    before = signal.getsignal(signal.SIGINT)
    with interrupts_kept():
        assert signal.getsignal(signal.SIGINT) is not before
    assert signal.getsignal(signal.SIGINT) is before


def test_an_ignored_interrupt_stays_ignored():
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with interrupts_kept():
            swallow_interrupt()
    finally:
        signal.signal(signal.SIGINT, before)


def test_other_errors_pass_and_the_handler_is_put_back():
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(RuntimeError, match="inside"), interrupts_kept():
        raise RuntimeError("inside")
    assert signal.getsignal(signal.SIGINT) is before


def test_other_threads_are_left_alone():
    seen = []

    def work() -> None:
        with interrupts_kept():
            seen.append(signal.getsignal(signal.SIGINT))

    before = signal.getsignal(signal.SIGINT)
    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [before]
