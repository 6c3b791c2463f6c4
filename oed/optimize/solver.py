"""The Solver seam: a frozen set of options that can search a problem."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from oed.foundation.component import Component, OneOf, Seed
from oed.foundation.text import NAME
from oed.foundation.work.parallel import Workers, default_workers
from oed.foundation.work.progress import Progress, Silent
from oed.kernel.criteria import CRITERION_CHOICES, Criterion
from oed.kernel.problem import Problem
from oed.kernel.solution import Solution


@dataclass(frozen=True)
class Context:
    """The circumstances of a search; of these only the seed and the earlier searches may change its result.

    Attributes:
        seed: of every random draw.
        workers: processes to use, or a cluster.
        progress: who is informed how far it is.
        earlier: solutions of the searches before this one, by name.
    """

    seed: int = 0
    workers: Workers = field(default_factory=default_workers)
    progress: Progress = field(default_factory=Silent)
    earlier: Mapping[str, Solution] = field(default_factory=dict)

    def rng(self, stream: int) -> np.random.Generator:
        """An independent generator for each part of a search."""
        return np.random.default_rng([self.seed, stream])


class Solver(Component, ABC):
    """Options of one kind of search.

    Attributes:
        name: of its result; the kind by default.
        seed: instead of the study's.
        criterion: instead of the problem's, to maximise; the design is scored by the problem's all the same.
        without_drift: whether to search as if the process had no noise; the design is scored with it all the
            same, to see what leaving it out costs.
        refines: whether it can go on from a design on a finer spline.
    """

    refines: ClassVar[bool] = False

    kind: str
    name: Annotated[str, Field(pattern=NAME)] | None = None
    seed: Seed | None = None
    criterion: Annotated[Criterion, OneOf(CRITERION_CHOICES)] | None = None
    without_drift: bool = False

    def own(self, problem: Problem) -> Problem:
        """The problem as it is searched."""
        seen = problem.steady if self.without_drift else problem
        return seen if self.criterion is None else replace(seen, criterion=self.criterion)

    @property
    def label(self) -> str:
        """The result's name."""
        return self.name or self.kind

    def again(self, *, quick: bool = True) -> Solver:
        """The options to search with once more, where an earlier solution of the same name is a good start:
        from that alone if `quick`. The same ones by default.
        """
        return self

    def refine(self, problem: Problem, context: Context, spent: float) -> Solution:
        """The best design found from the earlier solution of its name; of those that refine splines.

        Args:
            problem: with the earlier solution's spline, or a finer one.
            context: that knows the earlier solution.
            spent: seconds that the search has taken so far.
        """
        return self.search(problem, context)

    @abstractmethod
    def search(self, problem: Problem, context: Context) -> Solution:
        """The best design found for `problem`; every number in it comes from `evaluate`."""
