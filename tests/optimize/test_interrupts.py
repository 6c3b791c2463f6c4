"""Ctrl-C inside compiled code is not lost."""

from __future__ import annotations

import contextlib
import signal
import sys
import threading
import time

import casadi as ca
import pytest

from oed.foundation.errors import UserMistake
from oed.foundation.work.signals import SOON, ending_alike, interrupts_answered, interrupts_named
from oed.optimize.transcription.solver_calls import interrupts_kept

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


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_every_signal_that_ends_the_program_is_answered_alike(number: int, capsys):
    def work() -> None:
        with interrupts_kept():
            with contextlib.suppress(KeyboardInterrupt):
                signal.raise_signal(number)
            sys.stderr.write("what CasADi says of it")

    before = signal.getsignal(signal.SIGTERM)
    with ending_alike(), pytest.raises(KeyboardInterrupt):
        work()
    with ending_alike(), pytest.raises(KeyboardInterrupt):
        signal.raise_signal(number)
    assert signal.getsignal(signal.SIGTERM) is before
    assert capsys.readouterr().err == ""


def test_what_casadi_makes_of_an_interrupt_in_a_call_is_one():
    with pytest.raises(KeyboardInterrupt), interrupts_named():
        raise SystemError("returned a result with an exception set") from KeyboardInterrupt()
    with pytest.raises(SystemError), interrupts_named():
        raise SystemError("something else")


def mistaken(error: Exception) -> None:
    """What compiled wrappers do: an interrupt while they read an argument makes it one that does not fit."""
    swallow_interrupt()
    raise error


def test_an_interrupt_taken_for_a_wrong_argument_is_one():
    before, error = signal.getsignal(signal.SIGINT), TypeError("Wrong number or type of arguments")
    error.add_note("kept")
    with pytest.raises(KeyboardInterrupt) as caught, interrupts_named():
        mistaken(error)
    assert caught.value.__notes__ == ["kept"]
    assert signal.getsignal(signal.SIGINT) is before
    # What is told on purpose is told all the same, and what has nothing to do with an interrupt.
    with pytest.raises(UserMistake), interrupts_named():
        mistaken(UserMistake("no room"))
    with pytest.raises(TypeError), interrupts_named():
        raise error


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


class Odd:
    """A number that CasADi's wrappers ask for its value; a signal comes at that moment."""

    def __init__(self, number: int) -> None:
        self.number, self.asked = number, 0

    def __DM__(self) -> ca.DM:
        self.asked += 1
        signal.raise_signal(self.number)
        return ca.DM(1)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_casadis_wrappers_lose_no_signal(number: int):
    odd, reached = Odd(number), []

    def work() -> None:
        reached.append(ca.DM(2) + odd)
        time.sleep(5)

    before = time.monotonic()
    with ending_alike(), pytest.raises(KeyboardInterrupt):
        work()
    assert time.monotonic() - before < 1
    assert odd.asked
    assert reached == [3]


def test_nor_do_those_within_a_search_of_somebodys_program():
    """Which has Python's own answer to Ctrl-C: it was lost, or an error of the system."""
    odd, reached = Odd(signal.SIGINT), []

    @interrupts_answered()
    def work(seconds: float) -> None:
        reached.append(ca.DM(2) + odd)
        time.sleep(seconds)

    for seconds in (5, 0):
        before = time.monotonic()
        with pytest.raises(KeyboardInterrupt):
            work(seconds)
        assert time.monotonic() - before < 1
    assert reached == [3, 3]


def test_a_solver_hears_of_it_at_once():
    def work() -> None:
        with interrupts_kept(), contextlib.suppress(KeyboardInterrupt, TypeError):
            # As the wrapper has it, that is no number then.
            ca.DM(2) + Odd(signal.SIGTERM)

    before = time.monotonic()
    with ending_alike(), pytest.raises(KeyboardInterrupt):
        work()
    assert time.monotonic() - before < 1


def test_a_solver_that_heard_of_it_is_the_last_to_hear():
    # Whoever has its name for what the wrappers make of it: answered once, it does not come again.
    after = []

    def work() -> None:
        with interrupts_named():
            with contextlib.suppress(KeyboardInterrupt), interrupts_kept(), contextlib.suppress(TypeError):
                ca.DM(2) + Odd(signal.SIGINT)
            time.sleep(20 * SOON)
            after.append(True)

    with ending_alike():
        work()
    assert after


def test_a_signal_that_repeats_an_interrupt_does_nothing():
    with ending_alike() as ending:
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGTERM)
        ending.over = True
    with ending_alike() as ending:
        ending.over = True
        signal.raise_signal(signal.SIGINT)


class Finalised:
    """An object that a signal comes to while Python finalises it."""

    def __del__(self) -> None:
        signal.raise_signal(signal.SIGINT)


def test_an_interrupt_in_a_finaliser_is_raised_after_it_and_not_printed(capsys):
    def work() -> None:
        Finalised()
        time.sleep(5)

    before = time.monotonic()
    with ending_alike(), pytest.raises(KeyboardInterrupt):
        work()
    assert time.monotonic() - before < 1
    assert capsys.readouterr().err == ""


def test_an_interrupt_sent_again_before_the_finaliser_has_ended_is_not_lost(monkeypatch, capsys):
    late = [0.02]

    class BusyTimer(threading.Timer):
        """A timer whose signal comes before its start is over, the first time."""

        def start(self) -> None:
            super().start()
            time.sleep(late.pop() if late else 0)

    def work() -> None:
        Finalised()
        time.sleep(5)

    monkeypatch.setattr(threading, "Timer", BusyTimer)
    before = time.monotonic()
    with ending_alike(), pytest.raises(KeyboardInterrupt):
        work()
    assert not late
    assert time.monotonic() - before < 1
    assert capsys.readouterr().err == ""
