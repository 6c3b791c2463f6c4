"""Independent tasks over worker processes, with the same results whatever their number."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeVar

import joblib

Task = TypeVar("Task")
Result = TypeVar("Result")


def default_workers() -> int:
    """The number of processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def run_tasks(
    function: Callable[[Task], Result], tasks: Sequence[Task], workers: int
) -> Iterator[tuple[int, Result]]:
    """(index, result) of every task, as they end; in this process when one worker is enough.

    An interrupt reaches the caller as KeyboardInterrupt; the workers are then stopped.
    """
    if min(workers, len(tasks)) <= 1:
        for index, task in enumerate(tasks):
            yield index, function(task)
        return
    pool = joblib.Parallel(n_jobs=workers, backend="loky", return_as="generator_unordered")
    calls = (joblib.delayed(_worker)(function, index, task) for index, task in enumerate(tasks))
    yield from pool(calls)


def _worker(function: Callable[[Any], Any], index: int, task: Any) -> tuple[int, Any]:
    # The main process alone answers Ctrl-C: it keeps what is done and stops the workers.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    return index, function(task)
