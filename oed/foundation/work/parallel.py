"""The one seam for parallel work: independent tasks over processes here (loky) or on a Dask cluster.

Results are the same whoever does the tasks and however often one is done again, for a task depends on
nothing but itself.
"""

from __future__ import annotations

import os
import signal
import threading
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, as_completed
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from typing import Any, TypeVar

from oed.foundation.errors import Failure
from oed.foundation.work.cluster import Cluster
from oed.foundation.work.signals import end_with, interrupts_blocked, undisturbed

Task = TypeVar("Task")
Result = TypeVar("Result")

Workers = int | Cluster
"""Who does parallel work: so many processes of this machine, or a cluster."""

IDLE = 300
"""Time [s] after which processes that have nothing to do end."""
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Environment variables by which libraries of linear algebra learn how many threads to use."""
FEEDER = "QueueFeederThread"
"""Name of the threads by which tasks are sent to processes."""
PATIENCE = 1.0
"""Time [s] for such a thread to end when the processes have; that of another queue goes on."""
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


def load_ahead(workers: Workers, modules: Sequence[str]) -> None:
    """Start the processes of this machine that tasks will be given to, and have them load modules meanwhile.

    Args:
        workers: processes; of a single one, which does tasks here, and of a cluster nothing is started.
        modules: by their full names.
    """
    if not isinstance(workers, int) or workers == 1:
        return
    with interrupts_blocked():
        executor = _processes(workers)
        for _ in range(workers):
            executor.submit(_load, tuple(modules))


def _load(modules: Sequence[str]) -> None:
    # What cannot be loaded says so where it is needed.
    for one in modules:
        with suppress(Exception):
            import_module(one)


def waiting() -> int:
    """The number of processes that were started here and wait for tasks; 1 for none, as in `run_tasks`."""
    return _waiting


def run_tasks(
    function: Callable[[Task], Result],
    tasks: Sequence[Task],
    workers: Workers,
    take: Callable[[int, Result], None],
) -> None:
    """Call `take(index, function(task))` for every task, as they end; here when one worker is enough.

    What `take` raises, and KeyboardInterrupt, reaches the caller; the workers' unfinished tasks are given up.
    Those of a worker that dies are done again by others.

    Args:
        function: of a task.
        tasks: of any number.
        workers: processes, a cluster, or a number of processes.
        take: called with the place of a task and its result.

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
    jobs = [_Job(function, index, task) for index, task in tasks.items()]
    give_up: Callable[[], None] = end_processes
    try:
        if isinstance(workers, int):
            # Processes are started here, and hear no Ctrl-C from their first moment.
            with interrupts_blocked():
                executor = _processes(workers)
                futures = [executor.submit(job) for job in jobs]
        else:
            executor = workers.executor()
            give_up = partial(executor.shutdown, wait=False)
            futures = [executor.submit(job) for job in jobs]
        yield (_result(future, workers) for future in as_completed(futures))
    except BaseException:
        # Leaving early is meant: an interrupt keeps what is done and gives up the rest.
        with undisturbed():
            give_up()
        raise


_waiting = 1
_pool: Any = None


def end_processes() -> None:
    """End the processes that were started here, whatever they do, and wait until they have ended."""
    global _waiting, _pool
    if _pool is None:
        return
    _pool.shutdown(kill_workers=True)
    _waiting, _pool = 1, None
    # Nothing else waits for the thread that has sent the tasks. It signs semaphores off: a program that ends
    # in the middle of that is warned of one that is left.
    for thread in threading.enumerate():
        if thread.name == FEEDER:
            thread.join(PATIENCE)


def _processes(count: int) -> Any:
    from loky import get_reusable_executor

    global _waiting, _pool
    _waiting = count
    # What a process keeps of its tasks, so as not to write it anew, is no leak.
    warnings.filterwarnings("ignore", message="A worker was restarted", category=UserWarning)
    # Each has its share of the processors for its linear algebra.
    threads = str(max(1, default_workers() // count))
    env = {name: os.environ.get(name, threads) for name in THREADS}
    _pool = get_reusable_executor(count, timeout=IDLE, initializer=end_with, initargs=(os.getpid(),), env=env)
    return _pool


def _result(future: Future[tuple[int, Any]], workers: Workers) -> tuple[int, Any]:
    try:
        return future.result()
    except Exception as error:
        failure = None if isinstance(workers, int) else workers.failure(error)
        if failure is None:
            raise
        raise failure from None


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
