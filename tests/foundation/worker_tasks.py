"""Tasks of worker processes, in a module that takes them no time to load."""

from __future__ import annotations

import os
import signal
import threading
import time
from pathlib import Path

from oed.foundation.errors import Failure


def dying_once(task: tuple[Path, int]) -> int:
    """Task 1 ends its process the first time."""
    marker, number = task
    if number == 1 and not marker.exists():
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number**2


def slow(number: int) -> int:
    """The same number, after a while."""
    time.sleep(0.2)
    return number


def refusing(number: int) -> int:
    """Fails in the user's words."""
    raise Failure(f"no {number}")


def sleeping(task: Path) -> None:
    """Says which process does it, and takes for ever."""
    (task / str(os.getpid())).touch()
    time.sleep(600)


def with_a_slow_feeder() -> None:
    """From here on the thread that sends tasks ends late, and takes its time to sign semaphores off."""
    from loky.backend import queues, resource_tracker

    feed, sign_off = queues.Queue._feed, resource_tracker.unregister

    def fed(*given: object) -> None:
        feed(*given)
        time.sleep(0.1)

    def signed_off(*given: object) -> None:
        if threading.current_thread() is not threading.main_thread():
            time.sleep(0.3)
        sign_off(*given)

    queues.Queue._feed = staticmethod(fed)
    resource_tracker.unregister = signed_off
