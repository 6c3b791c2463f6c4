"""Local searches in several processes, each of which builds a search once and makes many solves with it."""

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
"""Largest number of local searches that a process keeps, each with its programs."""


@dataclass(frozen=True)
class SharedSearch:
    """Local search that every process builds once and uses for many solves.

    Attributes:
        token: unique name of the search.
        problem: problem to be solved.
        options: options of Ipopt and of the stages.
        deadline: end of the entire search, by `time.time`.
    """

    token: str
    problem: Problem = field(compare=False)
    options: IpoptOptions = field(compare=False)
    deadline: float = field(default=np.inf, compare=False)

    @property
    def local(self) -> LocalSearch:
        """Local search of this process."""
        return _built(self)

    def __call__(self, job: Callable[[LocalSearch], LocalResult]) -> LocalResult:
        """Return the result of a job, in any process."""
        return job(self.local)


@lru_cache(maxsize=BUILT)
def _built(shared: SharedSearch) -> LocalSearch:
    return LocalSearch(shared.problem, shared.options, shared.deadline)
