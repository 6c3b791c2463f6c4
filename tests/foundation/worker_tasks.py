"""Tasks of worker processes, in a module that takes them no time to load."""

from __future__ import annotations

import os
import signal
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
