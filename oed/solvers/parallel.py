"""Independent tasks over worker processes, with the same results whatever their number."""

from __future__ import annotations

import os
import signal
import warnings
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import joblib

Task = TypeVar("Task")
Result = TypeVar("Result")


def default_workers() -> int:
    """The number of processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def run_tasks(
    function: Callable[[Task], Result],
    tasks: Sequence[Task],
    workers: int,
    take: Callable[[int, Result], None],
) -> None:
    """Call `take(index, function(task))` for every task, as they end; here when one worker is enough.

    What `take` raises, and KeyboardInterrupt, reaches the caller; the workers' unfinished tasks are given up.
    """
    if min(workers, len(tasks)) <= 1:
        for index, task in enumerate(tasks):
            take(index, function(task))
        return
    pool = joblib.Parallel(n_jobs=workers, backend="loky", return_as="generator_unordered")
    outputs = pool(joblib.delayed(_worker)(function, index, task) for index, task in enumerate(tasks))
    try:
        for index, result in outputs:
            take(index, result)
    finally:
        with warnings.catch_warnings():
            # Leaving early is meant: an interrupt keeps what is done and gives up the rest.
            warnings.filterwarnings("ignore", message=".*tasks.*", category=UserWarning)
            outputs.close()


def _worker(function: Callable[[Any], Any], index: int, task: Any) -> tuple[int, Any]:
    # The main process alone answers Ctrl-C: it keeps what is done and stops the workers.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    return index, function(task)
