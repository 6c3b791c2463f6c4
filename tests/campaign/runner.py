"""Running cases: each from its own seed, on so many processes, none of which can take the others with it."""

from __future__ import annotations

import contextlib
import faulthandler
import multiprocessing
import time
import traceback
import warnings
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .cases import MEMORY, SECONDS, Outcome, Verdict, place_of
from .damage.running import TooLong, time_limit
from .experiments import experiment_case
from .faults import fault_case
from .files import file_case
from .problems import problem_case

SORTS = ("problem", "file", "signal", "experiment")
JUDGED = {"problem": problem_case, "experiment": experiment_case}
"""Sorts of cases that are drawn from random numbers alone."""
CHUNKS = {"problem": 20, "file": 5, "signal": 1, "experiment": 20}
"""Cases that a process takes at a time."""
REUSED = 25
"""Chunks after which a process makes room for a fresh one."""
STUCK = 6 * SECONDS
"""Seconds after which a process that no signal reaches ends itself."""
FAULT = 5 * SECONDS
"""Seconds that a case may take whose commands are timed by themselves."""


@dataclass(frozen=True)
class Task:
    """One case.

    Attributes:
        sort: one of `SORTS`.
        index: among its sort.
        seed: of the campaign.
        material: folder of sound files.
        quick: whether to leave out what takes long.
    """

    sort: str
    index: int
    seed: int
    material: Path
    quick: bool = False

    @property
    def rng(self) -> np.random.Generator:
        """The case's own random numbers."""
        return np.random.default_rng([self.seed, SORTS.index(self.sort), self.index])

    @property
    def command(self) -> str:
        """What repeats exactly this case."""
        quick = " --quick" if self.quick else ""
        return f"python -m tests.campaign --seed {self.seed} --only {self.sort}:{self.index}{quick}"


def run_case(task: Task) -> Outcome:
    """One case; whatever the package raises is a verdict on it."""
    began, verdicts = time.perf_counter(), list[Verdict]()
    _forget_peak()
    try:
        with time_limit(SECONDS if task.sort in JUDGED else FAULT), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            verdicts.extend(_verdicts(task))
        if task.sort in JUDGED:
            verdicts.append(Verdict("no traceback"))
    except TooLong:
        verdicts.append(Verdict("no hang", f"not ended after {time.perf_counter() - began:.0f} s"))
    except Exception:
        verdicts.append(Verdict("no traceback", place_of(traceback.format_exc())))
    peak = _peak()
    verdicts.append(Verdict("memory below 2 GB", f"{peak / 2**30:.1f} GB" if peak > MEMORY else ""))
    return Outcome(task.sort, task.index, tuple(verdicts), time.perf_counter() - began)


def _verdicts(task: Task) -> Iterator[Verdict]:
    if task.sort in JUDGED:
        return JUDGED[task.sort](task.rng)
    if task.sort == "file":
        return file_case(task.rng, task.material, quick=task.quick)
    return fault_case(task.rng, task.material, quick=task.quick)


def _forget_peak() -> None:
    # Linux measures a process's largest memory anew after this.
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def _peak() -> int:
    with contextlib.suppress(OSError):
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024
    return 0


def run_cases(tasks: Sequence[Task], workers: int) -> Iterator[Outcome]:
    """All cases, as they end. What they say does not depend on the number of processes: those that are timed
    come last, one at a time.
    """
    timed = [task for task in tasks if task.sort == "signal"]
    yield from _shared([task for task in tasks if task.sort != "signal"], workers)
    yield from _shared(timed, 1)


def _shared(tasks: Sequence[Task], workers: int) -> Iterator[Outcome]:
    chunks = list(_chunks(tasks))[::-1]
    while chunks:
        lost: list[list[Task]] = []
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(workers, context, max_tasks_per_child=REUSED) as pool:
            running: dict[Future[list[Outcome]], list[Task]] = {}
            while (chunks or running) and not lost:
                while chunks and len(running) < 2 * workers:
                    chunk = chunks.pop()
                    running[pool.submit(_run_chunk, chunk)] = chunk
                done, _ = wait(running, return_when=FIRST_COMPLETED)
                for future in done:
                    chunk = running.pop(future)
                    try:
                        yield from future.result()
                    except BrokenProcessPool:
                        lost.append(chunk)
            lost += running.values()
        for chunk in lost:
            # One of these ended its process: each gets one of its own.
            yield from map(_run_alone, chunk)


def _chunks(tasks: Sequence[Task]) -> Iterator[list[Task]]:
    for sort in SORTS:
        own, size = [task for task in tasks if task.sort == sort], CHUNKS[sort]
        yield from (own[first : first + size] for first in range(0, len(own), size))


def _run_chunk(chunk: list[Task]) -> list[Outcome]:
    found = []
    for task in chunk:
        # Native code that never returns hears no alarm.
        faulthandler.dump_traceback_later(STUCK, exit=True)
        found.append(run_case(task))
    faulthandler.cancel_dump_traceback_later()
    return found


def _run_alone(task: Task) -> Outcome:
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        try:
            return pool.submit(_run_chunk, [task]).result()[0]
        except BrokenProcessPool:
            text = "the process ended: native code crashed or never returned"
            return Outcome(task.sort, task.index, (Verdict("no crash", text),))
