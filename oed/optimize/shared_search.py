"""Local searches that processes share: each builds its own once, and then makes many solves by it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from oed.kernel.problem import Problem
from oed.optimize.ipopt_options import IpoptOptions
from oed.optimize.local import LocalSearch
from oed.optimize.results import LocalResult

BUILT = 4
"""Local searches that a process keeps, each with its programs."""


@dataclass(frozen=True)
class SharedSearch:
    """A local search that every process builds once, and then makes many solves by.

    Attributes:
        token: name of the search, by which processes know it.
        problem: problem to be solved.
        options: options of Ipopt and of the stages.
        deadline: when the whole search ends, by `time.time`.
    """

    token: str
    problem: Problem = field(compare=False)
    options: IpoptOptions = field(compare=False)
    deadline: float = field(default=np.inf, compare=False)

    @property
    def local(self) -> LocalSearch:
        """The local search of this process."""
        return _built(self)

    def __call__(self, job: Callable[[LocalSearch], LocalResult]) -> LocalResult:
        """Do a job, in any process."""
        return job(self.local)


@lru_cache(maxsize=BUILT)
def _built(shared: SharedSearch) -> LocalSearch:
    return LocalSearch(shared.problem, shared.options, shared.deadline)
