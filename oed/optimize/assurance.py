"""Search for a robust drive: limits are tightened until enough simulated robots satisfy them."""

from __future__ import annotations

from dataclasses import replace

from oed.foundation.text import chance_text
from oed.kernel.problem import Problem
from oed.kernel.scorer import score
from oed.kernel.solution import Solution, Status, Violation
from oed.optimize.solver import Context, Solver
from oed.uncertainty.departures import violation_probability
from oed.uncertainty.robust import Robust

ROUNDS = 12
"""Largest number of searches, each with tighter limits than the one before."""
NARROWER = (
    "The limits are tightened for what is uncertain; a short drive that stays well inside would narrow it."
)
"""Advice where no back-off suffices."""
MORE_DRAWS = "More of them (`draws`) can verify more drives."
"""Advice where the draws are too few to verify another drive."""
FINAL = 0
"""Random stream of the verification samples, by which limits are never tightened.

They choose among up to `ROUNDS` + 1 drives, so reported intervals hold for all these drives together."""
UNTRIED = "It was not tried with other robots."
"""Note on a design whose verification was interrupted."""


def search_with_assurance(options: Solver, problem: Problem, context: Context) -> Solution:
    """Return the best design; for a robust problem, one whose limits hold with the required confidence.

    Args:
        options: options of the search.
        problem: problem to be solved.
        context: seed, workers, progress, earlier solutions.
    """
    robust = problem.robust
    if not isinstance(robust, Robust):
        return options.search(problem, context)
    return _Assurance(problem, robust, context).run(options)


class _Assurance:
    def __init__(self, problem: Problem, robust: Robust, context: Context) -> None:
        self.problem, self.robust, self.context = problem, robust, context
        self.solutions: list[Solution] = []
        # One drive per round may be verified by the same samples, and that of the last, thorough search.
        self.drives = robust.verifications(ROUNDS + 1)
        self.verified = 0

    def run(self, options: Solver) -> Solution:
        tightened, solver, context = self.robust, options, self.context
        last: Violation | None = None
        for _ in range(ROUNDS):
            solution = self._search(solver, tightened, context)
            if solution.trajectory is None:
                return self._fail(solution, last)
            violation = solution.violation
            if solution.status is Status.INTERRUPTED or violation is None:
                return self._total(solution)
            if self._is_enough(solution):
                solution = self._verify(solution)
                if solution.status is Status.INTERRUPTED:
                    return self._total(solution)
                if self._is_enough(solution):
                    return self._improve(options, solution, tightened)
            last = solution.violation
            if self.verified == self.drives:
                solution = replace(solution, detail=f"{solution.detail} {MORE_DRAWS}".strip())
                break
            # Limits are tightened by the violations of other samples than those of the verification.
            tightened, solver = tightened.tighter(violation.worst), options.again()
            context = self.context.with_earlier(solution)
        return self._fail(replace(solution, status=Status.FAILED), last)

    def _improve(self, options: Solver, solution: Solution, tightened: Robust) -> Solution:
        # Quick searches found how tight the limits have to be: a thorough search follows from the best of
        # them, unless the last search was thorough already.
        thorough, refining = options.again(quick=False), self.context.refining_since is not None
        if len(self.solutions) == 1 or refining or thorough == options.again():
            return self._total(solution)
        further = self._search(thorough, tightened, self.context.with_earlier(solution))
        better = self._is_enough(further) and _objective(further) > _objective(solution)
        if better and self.verified < self.drives:
            further = self._verify(further)
            solution = further if self._is_enough(further) else solution
        if further.status is Status.INTERRUPTED:
            solution = replace(solution, status=Status.INTERRUPTED)
        return self._total(solution)

    def _search(self, options: Solver, tightened: Robust, context: Context) -> Solution:
        solution = options.search(replace(self.problem, robust=tightened), context)
        self.solutions.append(solution)
        if solution.trajectory is None:
            return solution
        # The score is by the limits of the study, not by tightened ones.
        scored = replace(solution, evaluation=score(self.problem, solution.trajectory), robust=tightened)
        # Every drive gets new draws, lest it be fitted to the draws that judge it.
        return self._simulate(scored, FINAL + len(self.solutions))

    def _verify(self, solution: Solution) -> Solution:
        self.verified += 1
        return self._simulate(solution, FINAL)

    def _simulate(self, solution: Solution, stream: int) -> Solution:
        assert solution.trajectory is not None
        progress, draws, seed = self.context.progress, self.robust.draws, self.context.seed
        progress.begin(f"simulate {draws} robots", 1)
        try:
            violation = violation_probability(
                self.problem, solution.trajectory, draws=draws, seed=seed, stream=stream, drives=self.drives
            )
        except KeyboardInterrupt:
            detail = solution.detail if solution.violation else f"{solution.detail} {UNTRIED}".strip()
            return replace(solution, status=Status.INTERRUPTED, detail=detail)
        progress.advance(f"{chance_text(violation.probability)} violate the limits")
        return replace(solution, violation=violation)

    def _is_enough(self, solution: Solution) -> bool:
        return solution.violation is not None and solution.violation.surely_below(1 - self.robust.confidence)

    def _fail(self, solution: Solution, last: Violation | None) -> Solution:
        detail = solution.detail
        if last is not None:
            detail = (
                f"On the last drive {chance_text(last.probability)} of {last.draws} robots violated the "
                f"limits (up to {chance_text(last.interval[1])} with 95 % confidence), where "
                f"{chance_text(1 - self.robust.confidence)} may. {detail}"
            )
        detail = f"{detail.strip()} {NARROWER}".strip()
        nothing = replace(solution, trajectory=None, evaluation=None, violation=None, detail=detail)
        return self._total(nothing)

    def _total(self, solution: Solution) -> Solution:
        explored = [step.explored for step in self.solutions if step.explored is not None]
        return replace(
            solution,
            explored=sum(explored[1:], explored[0]) if explored else None,
            starts=tuple(start for step in self.solutions for start in step.starts),
            wall_seconds=sum(step.wall_seconds for step in self.solutions),
        )


def _objective(solution: Solution) -> float:
    return float("-inf") if solution.evaluation is None else solution.evaluation.objective
