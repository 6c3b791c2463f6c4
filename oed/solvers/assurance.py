"""A search for a robust drive: simulated with many robots, more careful until enough keep the limits."""

from __future__ import annotations

from dataclasses import replace

from oed.evaluation import evaluate
from oed.leaving import Leaving, leaving
from oed.problem import Problem
from oed.robust import Robust
from oed.solution import Solution, Status
from oed.solvers.solver import Context, Solver

ROUNDS = 12
"""Searches, each more careful than the last, before giving up."""
NARROWER = (
    "The limits are tightened for what is uncertain; a short drive that stays well inside would narrow it."
)


def assured(options: Solver, problem: Problem, context: Context) -> Solution:
    """What `options` find for a problem; of a robust one, kept by as many robots as its confidence asks."""
    return (
        options.search(problem, context)
        if problem.robust is None
        else _Assured(problem, context).run(options)
    )


class _Assured:
    def __init__(self, problem: Problem, context: Context) -> None:
        assert problem.robust is not None
        self.problem, self.context = problem, context
        self.robust: Robust = problem.robust
        self.solutions: list[Solution] = []
        self.found: Leaving | None = None

    def run(self, options: Solver) -> Solution:
        careful, context = self.robust, self.context
        for index in range(ROUNDS):
            solution = options.search(replace(self.problem, robust=careful), context)
            self.solutions.append(solution)
            if solution.trajectory is None:
                return self._without_design(solution)
            self.found = self._simulated(solution, index)
            if self.found.interval[1] <= 1 - careful.confidence or solution.status is Status.INTERRUPTED:
                return self._told(solution, careful)
            careful = careful.safer(self.found.worst)
            options = options.again()
            context = replace(context, earlier={**context.earlier, solution.name: solution})
        return self._without_design(replace(solution, status=Status.FAILED))

    def _simulated(self, solution: Solution, index: int) -> Leaving:
        # With draws of its own each time, lest the drive suit the draws that it is judged by.
        assert solution.trajectory is not None
        self.context.progress.begin(f"simulate {self.robust.draws} robots", 1)
        seed = self.context.seed + index
        found = leaving(self.problem, solution.trajectory, draws=self.robust.draws, seed=seed)
        self.context.progress.advance(f"{found.probability:.2%} leave")
        return found

    def _told(self, solution: Solution, careful: Robust) -> Solution:
        # Scored by the problem as it was given, whatever more was kept in reserve.
        assert solution.trajectory is not None
        return self._whole(
            replace(
                solution,
                evaluation=evaluate(self.problem, solution.trajectory),
                leaving=self.found,
                robust=careful,
            )
        )

    def _without_design(self, solution: Solution) -> Solution:
        detail = solution.detail
        if self.found is not None:
            detail = (
                f"{self.found.probability:.2%} of {self.found.draws} robots left the limits on the best "
                f"drive so far, more than {1 - self.robust.confidence:.2%}. {detail}"
            )
        detail = f"{detail} {NARROWER}".strip()
        return self._whole(replace(solution, trajectory=None, evaluation=None, detail=detail))

    def _whole(self, solution: Solution) -> Solution:
        return replace(
            solution,
            starts=tuple(start for one in self.solutions for start in one.starts),
            wall_seconds=sum(one.wall_seconds for one in self.solutions),
        )
