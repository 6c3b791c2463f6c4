"""The Solver seam: a frozen set of options that can search a problem."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field

import numpy as np

from oed.component import Component
from oed.problem import Problem
from oed.solution import Solution
from oed.solve.parallel import default_workers
from oed.solve.progress import Progress, Silent


@dataclass(frozen=True)
class Context:
    """The circumstances of a search, which must not change its result: seed apart.

    Attributes:
        seed: of every random draw.
        workers: processes to use.
        progress: who is told how far it is.
    """

    seed: int = 0
    workers: int = field(default_factory=default_workers)
    progress: Progress = field(default_factory=Silent)

    def rng(self, stream: int) -> np.random.Generator:
        """An independent generator for each part of a search."""
        return np.random.default_rng([self.seed, stream])


class Solver(Component, ABC):
    """Options of one kind of search."""

    kind: str

    @abstractmethod
    def search(self, problem: Problem, context: Context) -> Solution:
        """The best design found for `problem`; every number in it comes from `evaluate`."""
