"""Local searches as tasks for workers, each of which builds a search's programs once."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from oed.foundation.arrays import Array
from oed.kernel.problem import Problem
from oed.optimize.local import local_search
from oed.optimize.local_results import Local, Settings


@dataclass(frozen=True)
class Task:
    """One local search.

    Attributes:
        token: of the whole search.
        problem: to be solved.
        settings: of the search.
        unknowns: z to begin at.
        share: of the objective there that a second stage has to keep; None for the criterion itself.
        barrier: as of `Program.solve`.
        binary: slots, and the file with what is compiled for these, once it is there.
    """

    token: str
    problem: Problem
    settings: Settings
    unknowns: Array
    share: float | None = None
    barrier: float | None = None
    binary: tuple[int, Path] | None = None


def work(task: Task) -> Local:
    """Do one, in any process."""
    search = local_search(task.token, task.problem, task.settings)
    if task.binary is not None:
        search.design.terms.take(*task.binary)
    if task.share is None:
        return search.maximise(task.unknowns, task.barrier)
    return search.second_stage(task.unknowns, task.share)
