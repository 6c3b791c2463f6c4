"""What surrounds a call of a compiled solver."""

from __future__ import annotations

from threading import Event, Thread

import pytest

from oed.optimize.transcription import solver_calls
from oed.optimize.transcription.solver_calls import one_thread


@pytest.fixture
def threads(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The number of threads of a linear algebra that begins with two, in a list."""
    number = [2]
    monkeypatch.setattr(
        solver_calls, "_openblas", lambda: (lambda: number[0], lambda new: number.__setitem__(0, new))
    )
    return number


def test_one_thread_while_it_lasts(threads: list[int]):
    with one_thread():
        assert threads == [1]
        with one_thread():
            assert threads == [1]
        assert threads == [1]
    assert threads == [2]


def test_solves_in_two_threads(threads: list[int]):
    """The second begins within the first and ends after it: one thread until both have ended."""
    first, second, seen = Event(), Event(), list[int]()

    def early() -> None:
        with one_thread():
            first.set()
            second.wait(10)

    def late() -> None:
        first.wait(10)
        with one_thread():
            second.set()
            begun.join(10)
            seen.append(threads[0])

    begun, other = Thread(target=early), Thread(target=late)
    begun.start()
    other.start()
    other.join(10)
    assert seen == [1]
    assert threads == [2]


def test_an_error_inside(threads: list[int]):
    with pytest.raises(ValueError, match="inside"), one_thread():
        raise ValueError("inside")
    assert threads == [2]
