"""How much work a search for a bound may be, who hears of it, and what helps the next one."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from oed.foundation.arrays import Array
from oed.foundation.work.parallel import Workers, at_once, run_tasks
from oed.foundation.work.progress import Progress, Silent

Task = TypeVar("Task")
Result = TypeVar("Result")

STAGE = "bound what any drive could reach"
"""What progress calls the work."""


@dataclass(frozen=True)
class Effort:
    """What may be spent.

    Attributes:
        nodes: of a search, at most; None for as many as take some seconds.
        deadline: by the clock [s].
        progress: who hears how far it is.
        found: centres that a search found, by what room it was for.
        workers: processes, or a cluster; does not change what is found.
    """

    nodes: int | None = None
    deadline: float = np.inf
    progress: Progress = field(default_factory=Silent)
    found: dict[tuple[float, ...], Array] = field(default_factory=dict)
    workers: Workers = 1

    @property
    def spent(self) -> bool:
        """Whether the time is up."""
        return time.perf_counter() > self.deadline

    def shared(
        self, function: Callable[[Task], Result], tasks: Sequence[Task], take: Callable[[Result], None]
    ) -> None:
        """Call `take(function(task))` for every task, as they end, until the time is up; for one at least.

        Args:
            function: of a task.
            tasks: independent of each other.
            take: called with each result.
        """
        together = at_once(self.workers) if np.isfinite(self.deadline) else max(len(tasks), 1)

        def taken(_: int, result: Result) -> None:
            take(result)
            self.progress.advance()

        for first in range(0, len(tasks), together):
            if not first or not self.spent:
                run_tasks(function, tasks[first : first + together], self.workers, taken)

    def most(self, usual: int) -> int:
        """Nodes of a search that are allowed, where so many are usual."""
        return usual if self.nodes is None else max(1, min(usual, self.nodes))

    def known_centres(self, key: tuple[float, ...]) -> Array | None:
        """What was found for a room like this one."""
        return self.found.get(key)

    def remember(self, key: tuple[float, ...], centres: Array) -> None:
        """Keep what was found for others like it."""
        self.found[key] = centres
