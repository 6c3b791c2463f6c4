"""A command of the package: in this process, or in one of its own, watched for time and memory."""

from __future__ import annotations

import contextlib
import io
import os
import resource
import signal
import subprocess
import sys
import threading
import time
import traceback
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from ..cases import MEMORY, SECONDS

CEILING = 6 * MEMORY
"""Address space that a process of its own may have, so that a machine survives."""
ROOT = Path(__file__).parents[3]


@dataclass(frozen=True)
class Ran:
    """What became of a command.

    Attributes:
        code: exit code, None where it was ended for its time.
        out, err: what it said.
        seconds: it took.
        peak: memory that it needed [bytes], 0 where that is not known.
        raised: the traceback, "" without one.
    """

    code: int | None
    out: str
    err: str
    seconds: float
    peak: int = 0
    raised: str = ""


class TooLong(BaseException):
    """Not an Exception: no handler of the package's may take it for an error of its own."""


@contextlib.contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """Raise `TooLong` where a block takes longer; of no effect but in a main thread."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def ring(*_: object) -> None:
        raise TooLong

    before, began = signal.signal(signal.SIGALRM, ring), time.monotonic()
    # Again and again: what swallows one is rung once more.
    left, interval = signal.setitimer(signal.ITIMER_REAL, seconds, 1.0)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
        if left:
            # A limit around this one goes on.
            signal.setitimer(signal.ITIMER_REAL, max(left - time.monotonic() + began, 1e-3), interval)


def run_here(arguments: Sequence[str], folder: Path) -> Ran:
    """A command in this process, within a folder."""
    from oed.cli import main

    out, err = io.StringIO(), io.StringIO()
    began, code, raised = time.perf_counter(), None, ""
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), contextlib.chdir(folder):
        try:
            with time_limit(SECONDS), warnings.catch_warnings():
                warnings.simplefilter("ignore")
                code = main(list(arguments))
        except TooLong:
            code = None
        except SystemExit as left:
            code = left.code if isinstance(left.code, int) else 1
        except BaseException:
            code, raised = 1, traceback.format_exc()
    return Ran(code, out.getvalue(), err.getvalue(), time.perf_counter() - began, raised=raised)


def run_apart(arguments: Sequence[str], folder: Path) -> Ran:
    """A command in a process of its own, within a folder."""
    began = time.perf_counter()
    with (folder / ".stdout").open("w+b") as out, (folder / ".stderr").open("w+b") as err:
        process = subprocess.Popen(
            [sys.executable, "-m", "oed", *arguments],
            cwd=folder,
            env=environment(),
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=err,
            start_new_session=True,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (CEILING, CEILING)),
        )
        code, peak = _ended(process)
        texts = []
        for stream in (out, err):
            stream.seek(0)
            texts.append(stream.read().decode("utf-8", "replace"))
    raised = texts[1] if "Traceback (most recent call last)" in texts[1] else ""
    return Ran(code, *texts, time.perf_counter() - began, peak, raised)


def environment(**more: str) -> dict[str, str]:
    """Of a process of its own: this package, one thread."""
    return {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1", **more}


def _ended(process: subprocess.Popen[bytes]) -> tuple[int | None, int]:
    # Its exit code, None where it had to be ended, and its peak memory.
    def end() -> None:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)

    timer = threading.Timer(SECONDS, end)
    timer.start()
    _, status, usage = os.wait4(process.pid, 0)
    late = not timer.is_alive()
    timer.cancel()
    process.returncode = os.waitstatus_to_exitcode(status)
    return None if late else process.returncode, usage.ru_maxrss * 1024
