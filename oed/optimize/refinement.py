"""`coefficients: auto`: a search on a coarse spline, then solves from its design on finer and finer ones.

Every spline has all curves of the one before, so that its solves begin exactly where the last ones ended.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

from oed.foundation.text import listing, significant
from oed.kernel.dynamics.space import Spline
from oed.kernel.problem import Problem
from oed.kernel.scorer import score
from oed.kernel.solution import Level, Solution, Status
from oed.optimize.solver import Context, Solver

ENOUGH = 0.005
"""Gain of the last doubling, as a share of the objective, below which a spline is fine enough. Where gains
halve from one doubling to the next, as they mostly do, all further ones together are worth about as much
again; a design of another kind that only a finer spline can drive may still be worth more.
"""
ENDED = (Status.INTERRUPTED, Status.TIME_LIMIT)
"""How a search ends that is not to go on."""
STAGE = "refined_spline"
"""Name of the stage."""

Search = Callable[[Solver, Problem, Context], Solution]
"""What searches a problem whose spline is given."""


def refined(options: Solver, problem: Problem, context: Context, search: Search) -> Solution:
    """What `options` find for a problem whose spline is refined, with all levels.

    Args:
        options: of the search.
        problem: to be solved.
        context: seed, workers, progress, earlier solutions.
        search: of a problem whose spline is given.
    """
    began = time.perf_counter()
    first = search(options, on_spline(problem, problem.design.spline.first), context)
    if not first.status.usable or first.trajectory is None:
        return first
    found = _Refinement(options, problem, context, search, began).after(first)
    return replace(found, wall_seconds=time.perf_counter() - began)


def on_spline(problem: Problem, spline: Spline) -> Problem:
    """The problem of the same drives but for their splines."""
    return replace(problem, design=problem.design.with_spline(spline))


class _Further(Solver):
    """A search that goes on from the earlier solution of its own name, on the same spline or a finer one.

    Attributes:
        inner: options of the search.
        spent: seconds that it has taken so far.
    """

    inner: Solver
    spent: float

    def search(self, problem: Problem, context: Context) -> Solution:
        """The best design found."""
        return self.inner.refine(problem, context, self.spent)


def plan(problem: Problem, solvers: Sequence[Solver]) -> str:
    """What `coefficients: auto` means for a problem and its searches, in words; "" where the spline is given.

    Args:
        problem: to be solved.
        solvers: its searches.
    """
    spline = problem.design.spline
    if not spline.refines or not problem.designed:
        return ""
    counts = [str(one.count) for one in (spline.first, *finer_splines(problem))]
    first, *others = counts
    text = f"{first} coefficients" + (f", then {', '.join(others)} as long as that gains {100 * ENOUGH:g} %")
    staying = [one.label for one in solvers if not one.refines]
    return f"{text}; {listing(staying)} on {first} only" if staying else text


def finer_splines(problem: Problem) -> Iterator[Spline]:
    """Splines that follow the first; with a coefficient for every sample one holds what any finer one can."""
    spline = problem.design.spline.first
    while spline.count < problem.design.samples:
        spline = spline.finer
        yield spline


@dataclass
class _Refinement:
    options: Solver
    problem: Problem
    context: Context
    search: Search
    began: float
    levels: list[Level] = field(default_factory=list)

    def after(self, first: Solution) -> Solution:
        best, spline, why = self._scored(first), self.problem.design.spline.first, ""
        self.levels.append(_level(spline, best))
        if first.status is Status.INTERRUPTED:
            return self._ended(best, "the search ended before it was refined")
        for finer in finer_splines(self.problem) if self.options.refines else ():
            found = self._on(finer, best)
            if found.trajectory is None:
                why = f"no design with {finer.count} coefficients was found"
                best = replace(best, status=found.status) if found.status in ENDED else best
                break
            self.levels.append(_level(finer, found))
            gain = self._gain(self.levels[-1].objective, self.levels[-2].objective)
            best = _joined(best, found) if gain > 0 else replace(best, status=found.status)
            if gain < ENOUGH or found.status in ENDED:
                break
        else:
            why = self._why_no_finer
        return self._ended(best, why)

    def _ended(self, best: Solution, why: str) -> Solution:
        detail = f"{best.detail} {self._said(why)}".strip()
        return replace(best, levels=tuple(self.levels), detail=detail)

    @property
    def _why_no_finer(self) -> str:
        if not self.options.refines:
            return f"{self.options.kind} searches on the first spline only"
        return f"there are as many as the {self.problem.design.samples} samples of a run"

    def _on(self, spline: Spline, best: Solution) -> Solution:
        # Limits of a robust problem begin as tight as they had to be.
        own = on_spline(self.problem, spline)
        own = own if best.robust is None else replace(own, robust=best.robust)
        spent = time.perf_counter() - self.began
        options = _Further(kind=self.options.kind, name=self.options.label, inner=self.options, spent=spent)
        context = replace(self.context, earlier={**self.context.earlier, options.label: best})
        return self._scored(self.search(options, own, context))

    def _scored(self, solution: Solution) -> Solution:
        # By the problem as it was given.
        if solution.trajectory is None:
            return solution
        return replace(solution, evaluation=score(self.problem, solution.trajectory))

    def _gain(self, value: float, before: float) -> float:
        size = sum(len(one.judged) for one in self.problem.any_estimations)
        return self.problem.objective.change(value, before, size)

    def _said(self, why: str) -> str:
        counts = listing([str(one.coefficients) for one in self.levels])
        text = f"Splines of {counts} coefficients were searched"
        if len(self.levels) > 1:
            *_, before, last = (one.objective for one in self.levels)
            whole, step = (
                f"{significant(2)(100 * self._gain(last, one))} %"
                for one in (self.levels[0].objective, before)
            )
            text += f": refining gained {whole}, the last doubling {step}"
        return f"{text}; {why}." if why else f"{text}."


def _level(spline: Spline, found: Solution) -> Level:
    assert found.evaluation is not None
    assert found.trajectory is not None
    return Level(
        spline.count,
        found.evaluation.objective,
        sum(one.iterations for one in found.starts),
        found.trajectory,
    )


def _joined(before: Solution, found: Solution) -> Solution:
    # The finer design, with what the search went through before it.
    assert found.evaluation is not None
    spent = before.history[-1].evaluations if before.history else 0
    known = before.history[-1].objective if before.history else -float("inf")
    risen = (
        replace(one, evaluations=one.evaluations + spent) for one in found.history if one.objective > known
    )
    return replace(
        found,
        starts=before.starts,
        stages={**before.stages, STAGE: found.evaluation.objective},
        history=(*before.history, *risen),
        detail=before.detail,
    )
