"""The Solver seam: a frozen set of options that can search a problem."""

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
    """The circumstances of a search; of these only the seed and the earlier searches may change its result.

    Attributes:
        seed: of every random draw.
        workers: processes to use, or a cluster.
        progress: who is informed how far it is.
        earlier: solutions of the searches before this one, by name.
        refining_since: when the search began (by `time.perf_counter`) whose design this one only improves, on
            a finer spline; it is among the earlier ones, by the solver's name. None for a search of its own.
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
    """Return the unknowns of an earlier search's design: of those on several splines, of the finest one that
    can be driven here.

    Args:
        earlier: solutions by name.
        name: name of the search.
        design: expressions of the problem that it is a start for.

    Raises:
        ProblemError: no search of that name.
        Failure: it has no design.
        ValueError: a design of splines that are not those of the problem.
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
        """Return the problem as it is searched."""
        searched = problem.steady if self.without_drift else problem
        return searched if self.criterion is None else replace(searched, criterion=self.criterion)

    @property
    def label(self) -> str:
        """Name of the solver's solution."""
        return self.name or self.kind

    def again(self, *, quick: bool = True) -> Solver:
        """The options to search with once more, where an earlier solution of the same name is a good start:
        from that alone if `quick`. The same ones by default.
        """
        return self

    @abstractmethod
    def search(self, problem: Problem, context: Context) -> Solution:
        """The best design found for `problem`; every number in it comes from `evaluate`."""
