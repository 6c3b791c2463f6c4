"""Base class of solvers: frozen sets of options that can search a problem."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from oed.foundation.arrays import Array
from oed.foundation.component import Component, OneOf, Seed
from oed.foundation.errors import Failure, ProblemError
from oed.foundation.text import NAME
from oed.foundation.work.parallel import Workers, default_workers
from oed.foundation.work.progress import Progress, Silent
from oed.kernel.criteria import CRITERION_CHOICES, Criterion
from oed.kernel.problem import Problem
from oed.kernel.solution import Solution
from oed.optimize.transcription.design import DesignExpressions


@dataclass(frozen=True)
class Context:
    """Circumstances of a search; only the seed and the earlier solutions may change its result.

    Attributes:
        seed: seed of all random numbers.
        workers: number of processes, or a cluster.
        progress: listener to the progress of the search.
        earlier: solutions of earlier searches, by name.
        refining_since: begin, by `time.perf_counter`, of the search whose design this one only improves on a
            finer spline; that design is among the earlier solutions, by the solver's name. None for a search
            from scratch.
    """

    seed: int = 0
    workers: Workers = field(default_factory=default_workers)
    progress: Progress = field(default_factory=Silent)
    earlier: Mapping[str, Solution] = field(default_factory=dict)
    refining_since: float | None = None

    def with_earlier(self, solution: Solution) -> Context:
        """Return the context of a further search that may start from a solution, by its name."""
        return replace(self, earlier={**self.earlier, solution.name: solution})

    def rng(self, stream: int) -> np.random.Generator:
        """Return an independent generator for each part of a search."""
        return np.random.default_rng([self.seed, stream])


def earlier_design(earlier: Mapping[str, Solution], name: str, design: DesignExpressions) -> Array:
    """Return the unknowns of the design of an earlier search.

    Of designs on several splines it is the finest one that the splines of this problem can represent.

    Args:
        earlier: solutions by name.
        name: name of the search.
        design: expressions of the problem that it starts.

    Raises:
        ProblemError: no earlier search has that name.
        Failure: the search found no design.
        ValueError: the splines of the design are not those of the problem.
    """
    solution = earlier.get(name)
    if solution is None:
        names = ", ".join(earlier) or "none"
        text = f"expected the name of an earlier search ({names}), got {name!r}"
        raise ProblemError.about(("solvers", "start_from"), text)
    if solution.trajectory is None:
        raise Failure(f"{name} found no design to start from: {solution.message}")
    *finer, coarsest = solution.designs
    for trajectory in finer:
        with suppress(ValueError):
            return design.unknowns_of(trajectory)
    return design.unknowns_of(coarsest)


class Solver(Component, ABC):
    """Options of one kind of search.

    Attributes:
        name: name of the solution; the kind by default.
        seed: seed instead of the study's.
        criterion: criterion to maximise instead of the problem's, which still scores the design.
        without_drift: True to search without process noise; the design is still scored with it, which shows
            the cost of neglecting it.
        refines: True where the search can continue from a design on a finer spline.
    """

    refines: ClassVar[bool] = False

    kind: str
    name: Annotated[str, Field(pattern=NAME)] | None = None
    seed: Seed | None = None
    criterion: Annotated[Criterion, OneOf(CRITERION_CHOICES)] | None = None
    without_drift: bool = False

    def problem_to_search(self, problem: Problem) -> Problem:
        """Return the problem with the criterion and the process noise of this search."""
        searched = problem.steady if self.without_drift else problem
        return searched if self.criterion is None else replace(searched, criterion=self.criterion)

    @property
    def label(self) -> str:
        """Name of the solver's solution."""
        return self.name or self.kind

    def again(self, *, quick: bool = True) -> Solver:
        """Return the options of a further search, where an earlier solution of the same name is a good start.

        A quick search starts from that solution alone. By default the options stay the same.
        """
        return self

    @abstractmethod
    def search(self, problem: Problem, context: Context) -> Solution:
        """Return the best design found for `problem`; every number in it comes from `evaluate`."""
