"""The one seam for parallel work: independent tasks over processes here or on a Dask cluster, by joblib.

Results are the same whoever does the tasks and however often one is done again, for a task depends on
nothing but itself.
"""

from __future__ import annotations

import os
import signal
import threading
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TypeVar

from oed.foundation.errors import Failure
from oed.foundation.work.cluster import Cluster
from oed.foundation.work.signals import end_with, interrupts_blocked

Task = TypeVar("Task")
Result = TypeVar("Result")

Workers = int | Cluster
"""Who does parallel work: so many processes of this machine, or a cluster."""

BREAKDOWNS = 3
"""Times in a row that worker processes may die before any task is done."""
BROKEN = (
    f"worker processes died {BREAKDOWNS} times before any of them had done a task, perhaps for want of "
    "memory: use fewer of them (--workers)"
)


def default_workers() -> int:
    """The number of processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def at_once(workers: Workers) -> int:
    """How many tasks are worked on at a time."""
    return workers if isinstance(workers, int) else workers.size


def run_tasks(
    function: Callable[[Task], Result],
    tasks: Sequence[Task],
    workers: Workers,
    take: Callable[[int, Result], None],
) -> None:
    """Call `take(index, function(task))` for every task, as they end; here when one worker is enough.

    What `take` raises, and KeyboardInterrupt, reaches the caller; the workers' unfinished tasks are given up.
    Those of a worker that dies are done again by others.

    Raises:
        Failure: workers die whatever they are given, or the cluster is gone.
    """
    if len(tasks) <= 1 or workers == 1:
        for index, task in enumerate(tasks):
            take(index, function(task))
        return
    # What starts processes takes long to load, and most commands start none.
    from concurrent.futures.process import BrokenProcessPool

    left, breakdowns = dict(enumerate(tasks)), 0
    while left:
        before = len(left)
        try:
            with _outputs(function, left, workers) as outputs:
                for index, result in outputs:
                    del left[index]
                    take(index, result)
        except BrokenProcessPool:
            # Not raised by a cluster, which gives a dead worker's tasks to others by itself.
            breakdowns = breakdowns + 1 if len(left) == before else 1
            if breakdowns >= BREAKDOWNS:
                raise Failure(BROKEN) from None


@contextmanager
def _outputs(
    function: Callable[[Any], Any], tasks: Mapping[int, Any], workers: Workers
) -> Iterator[Iterator[tuple[int, Any]]]:
    import joblib

    from oed.foundation.work.cluster_backend import ClusterBackend

    jobs = [joblib.delayed(_Job(function, index, task))() for index, task in tasks.items()]
    if isinstance(workers, int):
        begun = {"initializer": end_with, "initargs": (os.getpid(),)}
        pool = joblib.Parallel(n_jobs=workers, backend="loky", return_as="generator_unordered", **begun)
        # Processes are started here, and hear no Ctrl-C from their first moment.
        with interrupts_blocked():
            outputs = pool(jobs)
    else:
        # A cluster is given everything at once, so that workers that join later find some.
        backend = ClusterBackend(workers.connect())
        pool = joblib.Parallel(
            n_jobs=workers.size, backend=backend, pre_dispatch="all", return_as="generator_unordered"
        )
        outputs = pool(jobs)
    try:
        yield outputs
    finally:
        with warnings.catch_warnings():
            # Leaving early is meant: an interrupt keeps what is done and gives up the rest.
            warnings.filterwarnings("ignore", message=".*tasks.*", category=UserWarning)
            outputs.close()


# CasADi's solvers share state in a process, and a Dask worker may have several threads.
_ONE_AT_A_TIME = threading.Lock()


@dataclass(frozen=True, eq=False)
class _Job:
    """A task on its way to a worker and, called there, its result."""

    function: Callable[[Any], Any]
    index: int
    task: Any

    def __call__(self) -> tuple[int, Any]:
        if threading.current_thread() is threading.main_thread():
            # The process that sent the task alone answers Ctrl-C: it keeps what is done and stops the
            # workers. In other threads nobody hears it.
            signal.signal(signal.SIGINT, signal.SIG_IGN)
        with _ONE_AT_A_TIME:
            return self.index, self.function(self.task)
