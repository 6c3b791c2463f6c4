"""Results of local searches, and the messages about them during a search."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from oed.foundation.arrays import ROUNDING, Array
from oed.foundation.text import deviation_text, listing, significant, words
from oed.foundation.work.progress import Progress, announce
from oed.kernel.problem import Problem
from oed.kernel.results import Evaluation
from oed.kernel.solution import Start, Status
from oed.optimize.transcription.program import OUT_OF_TIME, IpoptOutcome

_STATUS = {
    "Solve_Succeeded": Status.CONVERGED,
    "Solved_To_Acceptable_Level": Status.ACCEPTABLE,
    "Feasible_Point_Found": Status.ACCEPTABLE,
    "Search_Direction_Becomes_Too_Small": Status.ACCEPTABLE,
    "Maximum_Iterations_Exceeded": Status.ITERATION_LIMIT,
    "Maximum_CpuTime_Exceeded": Status.TIME_LIMIT,
    OUT_OF_TIME: Status.TIME_LIMIT,
    "Infeasible_Problem_Detected": Status.INFEASIBLE,
    "Restoration_Failed": Status.INFEASIBLE,
}

Round: TypeAlias = tuple[IpoptOutcome, Evaluation]
"""Outcome of a solve, and the scores of its drive."""


@dataclass(frozen=True, eq=False)
class LocalResult:
    """Result of one local search.

    Attributes:
        unknowns: unknowns z of its drive, (size,).
        iterations: number of iterations of Ipopt.
        wall_seconds: duration of the search [s].
        status: status at its end.
        evaluations: number of evaluations of drives.
        evaluation: scores of the drive; None unless it is a feasible design.
        sketched: objective on the grid of a sketch, without scores; minus infinity where limits are exceeded.
        reason: reason of a failure; "" without a known reason.
        gains: gains by wider limits, see `Solution`.
    """

    unknowns: Array
    iterations: int
    wall_seconds: float
    status: Status
    evaluations: int = 0
    evaluation: Evaluation | None = None
    sketched: float = -np.inf
    reason: str = ""
    gains: Mapping[str, float] = field(default_factory=dict)

    @property
    def objective(self) -> float:
        """Objective at the end of the search; minus infinity without a feasible design."""
        return self.sketched if self.evaluation is None else self.evaluation.objective

    @property
    def start(self) -> Start:
        """Entry for this search in the starts of a solution."""
        objective = self.objective if np.isfinite(self.objective) else None
        return Start(objective, self.status, self.wall_seconds, self.iterations)


def is_better(objective: float, reference: float) -> bool:
    """Return True if an objective exceeds a reference by more than rounding."""
    return bool(np.isfinite(objective)) and objective > reference + ROUNDING * abs(objective)


def best_round(rounds: Sequence[Round]) -> int:
    """Return the place of the best feasible round, the last of equal ones; without any, of the last round."""
    best, reference = len(rounds) - 1, -np.inf
    for place, (_, evaluation) in reversed(list(enumerate(rounds))):
        if evaluation.feasible and is_better(evaluation.objective, reference):
            best, reference = place, evaluation.objective
    return best


def local_result(rounds: Sequence[Round], place: int, seconds: float, failure: str) -> LocalResult:
    """Return the result of a local search, by one of its rounds.

    A drive that does not identify the judged parameters is a design, too; the solution reports it as
    singular.

    Args:
        rounds: rounds of the search, at least one.
        place: place of the round that counts.
        seconds: duration of the search [s].
        failure: reason why a further round was not finite; "" if every round was.
    """
    outcome, evaluation = rounds[place]
    status = _STATUS.get(outcome.return_status, Status.FAILED)
    usable = evaluation.feasible and (np.isfinite(evaluation.objective) or not evaluation.identifiable)
    if not usable:
        status = status if status is Status.INFEASIBLE else Status.FAILED
    elif status in (Status.INFEASIBLE, Status.FAILED) or failure or place < len(rounds) - 1:
        # A feasible end is a design, whatever made Ipopt stop there and whatever failed afterwards.
        status = Status.ACCEPTABLE
    return LocalResult(
        outcome.unknowns,
        sum(end.iterations for end, _ in rounds),
        seconds,
        status,
        evaluations=sum(end.evaluations for end, _ in rounds),
        evaluation=evaluation if usable else None,
        reason="" if usable else failure,
    )


def announce_drive(listener: Progress, problem: Problem, evaluation: Evaluation, seconds: float) -> None:
    """Announce the standard errors of a feasible drive, so that users see early what to expect.

    Args:
        listener: listener to the progress of the search.
        problem: problem that is searched.
        evaluation: scores of the drive.
        seconds: time since the search began [s].
    """
    if not evaluation.identifiable:
        return
    first = "first feasible drive" if problem.robust is None else "first drive, untried with other robots,"
    estimations = problem.any_estimations
    units = {
        name: unit
        for estimation in estimations
        for name, unit in zip(estimation.parameters, estimation.units, strict=True)
    }
    shown = problem.model.shown_units
    errors = [
        f"{words(name)} {deviation_text(size, units[name], shown.get(name))}"
        for name, size in evaluation.standard_deviations.items()
    ]
    objective = significant(4)(evaluation.objective)
    worth = f"standard errors {listing(errors)}" if errors else f"objective {objective}"
    # A later drive may be better by the criterion, and yet less precise about some parameter.
    names = [words(name) for estimation in estimations for name in estimation.judged]
    minimised = problem.criterion.standard_error(names)
    aim = f": to make {minimised} as small as possible" if minimised else ""
    text = f"{first} after {significant(2)(seconds)} s: {worth}; the search for a better one goes on{aim}"
    announce(listener, text)
